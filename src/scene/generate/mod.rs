//! Procedural scenes: the paper's cube groups, forests, small rooms, a town. Each has an emitter; metres and z up (the
//! Cornell box has its original coordinates: millimetres, y up).

mod cornell;
mod cubes;
mod forest;
mod indoor;
mod office;
pub(super) mod shapes;
mod urban;

use super::{LoadOptions, MAX_PLACEMENTS, PlacedSoup, Scene, Soup, instances::resolve_placed, resolve};
use crate::{Error, Result, error::quote, memory};

#[cfg(test)]
pub use forest::ground_and_sky;
pub use office::{DESKS, ROOM};

/// A kind of generated scene.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// Name, see [`Spec::name`].
    pub name: &'static str,
    /// One-line description with the relevant fields of [`Spec`] and their defaults.
    pub about: &'static str,
    /// Length unit of the coordinates.
    pub unit: &'static str,
    make: fn(&Spec) -> Result<Soup>,
}

/// All kinds of scenes that can be generated.
pub const KINDS: &[Kind] = &[
    Kind {
        name: "cube-groups",
        about: "four groups of cubes before a wall with a small light, as in the paper's Figures 1 and 9",
        unit: "m",
        make: cubes::groups,
    },
    Kind {
        name: "forest",
        about: "trees of two-sided leaves under a large sky panel (trees, leaves, trunks, instances, species, light_size)",
        unit: "m",
        make: forest::forest,
    },
    Kind {
        name: "cubes",
        about: "randomly turned cubes above a floor (count: 200)",
        unit: "m",
        make: cubes::random,
    },
    Kind {
        name: "brick-wall",
        about: "bricks that touch without mortar, each an object of its own (count of courses: 12)",
        unit: "m",
        make: indoor::brick_wall,
    },
    Kind { name: "louvres", about: "a blind of tilted slats (count: 30)", unit: "m", make: indoor::louvres },
    Kind {
        name: "bookshelf",
        about: "a shelf full of books that touch (count of boards: 5)",
        unit: "m",
        make: indoor::bookshelf,
    },
    Kind {
        name: "desk-room",
        about: "a closed room with a desk, a chair and small things, lit by a ceiling panel",
        unit: "m",
        make: indoor::desk_room,
    },
    Kind {
        name: "office",
        about: "a closed office of 5,380 polygons: seven desks with small things, as in the paper's Figures 7 and 8",
        unit: "m",
        make: office::office,
    },
    Kind {
        name: "urban-block",
        about: "streets and houses in a box of sky, closed, cut into facets (count: about 5000)",
        unit: "m",
        make: urban::urban_block,
    },
    Kind {
        name: "cornell",
        about: "the Cornell box with the original measurements in mm (unit: mm)",
        unit: "mm",
        make: cornell::cornell,
    },
];

options! {
    /// Parameters of a generated scene.
    #[derive(Clone, Debug)]
    pub struct Spec {
        /// Name of a kind in [`KINDS`].
        pub name: String = String::new();
        /// Seed of all random numbers.
        pub seed: u64 = 1;
        /// Number of items, see [`Kind::about`]; the kind's default if `None`.
        pub count: Option<usize> = None, in 1..=MAX_ITEMS;
        /// Forest: number of trees.
        pub trees: usize = 100, in 1..=MAX_ITEMS;
        /// Forest: number of leaves per tree; at most 100 million leaves in all.
        pub leaves: usize = 1000, in 1..=MAX_ITEMS;
        /// Forest: whether trees have trunks.
        pub trunks: bool = false;
        /// Forest: whether trees are placements of shared meshes, see [`placed`].
        pub instances: bool = false;
        /// Forest of instances: number of different trees.
        pub species: usize = 1;
        /// Edge of the emitter in the kind's unit; the kind's default if `None`.
        pub light_size: Option<f64> = None, above 0.0, at most 1e6;
    }
}

/// Largest number of items: limits a forest to 12 GB.
const MAX_ITEMS: usize = 100_000_000;
/// Memory of a leaf, bytes: four vertices (96), their indices (16), and end, object and material of the polygon (12).
const BYTES_PER_LEAF: u64 = 124;
/// Smallest memory of another item, bytes: its place.
const BYTES_PER_ITEM: u64 = 24;

impl Spec {
    /// The defaults of the kind `name`.
    pub fn new(name: impl Into<String>) -> Self {
        Spec { name: name.into(), ..Spec::default() }
    }

    /// The kind with this name.
    ///
    /// # Errors
    /// [`Error::Argument`] if no kind has this name.
    pub fn kind(&self) -> Result<&'static Kind> {
        KINDS.iter().find(|k| k.name == self.name).ok_or_else(|| {
            let names: Vec<&str> = KINDS.iter().map(|k| k.name).collect();
            let problem = format!("no scene is called `{}`", quote(&self.name));
            Error::argument("name", "", problem).with_cure(format!("there are {}", names.join(", ")))
        })
    }

    fn check_instances(&self) -> Result<()> {
        if self.name != "forest" {
            return Err(Error::argument(
                "instances",
                "",
                format!("`{}` has none: only `forest` has", self.name),
            ));
        }
        // The ground, the light and each tree are a node of the file.
        let trees = MAX_PLACEMENTS - 2;
        if self.trees > trees {
            let problem = format!("a scene has at most {trees} instances");
            return Err(Error::argument("trees", self.trees, problem));
        }
        if self.species == 0 || self.species > self.trees {
            let problem = format!("must lie in 1..={}, the number of ⟨trees⟩", self.trees);
            return Err(Error::argument("species", self.species, problem));
        }
        if self.species.saturating_mul(self.leaves) > MAX_ITEMS {
            return Err(Error::arguments(format!(
                "more than {MAX_ITEMS} leaves are stored: lower ⟨species⟩ or ⟨leaves⟩"
            )));
        }
        Ok(())
    }

    fn check(&self) -> Result<()> {
        self.check_ranges()?;
        if self.instances {
            self.check_instances()?;
        } else if self.name == "forest" && self.trees.saturating_mul(self.leaves) > MAX_ITEMS {
            return Err(Error::arguments(format!("more than {MAX_ITEMS} leaves: lower ⟨trees⟩ or ⟨leaves⟩")));
        }
        let (items, bytes, what) = match (self.name.as_str(), self.instances) {
            ("forest", true) => (self.species * self.leaves, BYTES_PER_LEAF, "leaves"),
            ("forest", false) => (self.trees * self.leaves, BYTES_PER_LEAF, "leaves"),
            _ => (self.count.unwrap_or(0), BYTES_PER_ITEM, "items"),
        };
        memory::check_room(bytes * items as u64, || format!("{items} {what}"))
    }
}

/// Generates the polygons of a scene.
///
/// # Errors
/// [`Error::Argument`] if the name is unknown, a number is out of range, or instances are asked for: [`placed`] makes
/// those.
pub fn soup(spec: &Spec) -> Result<Soup> {
    let kind = spec.kind()?;
    spec.check()?;
    if spec.instances {
        let what = "a scene of instances is no list of polygons: write it as .gltf or .glb";
        return Err(Error::arguments(what.into()));
    }
    let mut soup = (kind.make)(spec)?;
    round(&mut soup);
    Ok(soup)
}

/// The polygons and placements of a generated scene of instances: a forest.
///
/// # Errors
/// The kind is not `forest`, the specification does not ask for instances, or a count is out of range.
pub fn placed(spec: &Spec) -> Result<PlacedSoup> {
    spec.kind()?;
    spec.check()?;
    if !spec.instances {
        return Err(Error::arguments("the specification does not ask for instances".into()));
    }
    let mut placed = forest::placed(spec);
    round(&mut placed.soup);
    placed.meshes.iter_mut().for_each(round);
    Ok(placed)
}

/// Rounds coordinates to f32, the precision of scenes: more digits would only enlarge files.
fn round(soup: &mut Soup) {
    soup.positions.iter_mut().for_each(|p| *p = p.as_vec3().as_dvec3());
}

/// Generates a scene and resolves it in memory, like a scene read from a file.
///
/// # Errors
/// As for [`soup`].
pub fn build(spec: &Spec) -> Result<Scene> {
    let unit = spec.kind()?.unit.to_owned();
    let options = LoadOptions { unit, ..LoadOptions::default() };
    if spec.instances { resolve_placed(placed(spec)?, &options) } else { resolve(soup(spec)?, &options) }
}
