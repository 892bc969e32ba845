//! What the benches and the tests of the whole crate need besides the public interface. Not part of it: names here change
//! without notice.

/// The measurement behind `mrvis bench`.
pub mod bench {
    pub use crate::bench::workload::{Order, Workload, surface_points};
    pub use crate::bench::{Options, Record, run};
}

/// Clusters.
pub mod clusters {
    pub use crate::clusters::{Builder, Options, build};
}

/// Files of measured clusters.
pub mod cache {
    pub use crate::model::cache::{CacheLocation, Options, Origin, PreparedClusters, load_or_make};
}

/// The Embree binding.
pub mod embree {
    pub use crate::embree::{CommittedScene, Traversal};
}

/// Readers of files, for tests with damaged files.
pub mod readers {
    use crate::model::cache;
    use crate::scene::{self, LoadOptions, Scene};
    use crate::{Result, points};
    use std::path::Path;

    /// Names of the readers.
    pub const NAMES: [&str; 11] =
        ["obj", "mtl", "ply", "gltf", "glb", "cache", "csv", "toml", "ies", "ldt", "placements"];

    /// Reads the content of a file with a reader of [`NAMES`]. Files that it names do not exist.
    ///
    /// # Errors
    /// Those of the reader.
    ///
    /// # Panics
    /// If there is no such reader, or a scene that it accepts cannot be used.
    pub fn read(reader: &str, bytes: &[u8]) -> Result<()> {
        let folder = Path::new("/nonexistent");
        match reader {
            "obj" | "ply" | "gltf" | "glb" => {
                let options = LoadOptions { max_memory: Some(1 << 30), ..LoadOptions::default() };
                let scene = scene::read_from_memory(Some(folder), reader, bytes, &options)?;
                assert!(scene.bounds.diagonal().is_finite() && !scene.triangles.is_empty());
            }
            "mtl" => drop(scene::read_materials(folder, bytes)?),
            "cache" => {
                if let Some(table) = cache::decode(bytes, &sample()) {
                    assert_eq!(table.optics.len(), table.hierarchy.micro.clusters.len());
                }
            }
            "csv" => drop(points::irradiance_of(folder, bytes)?),
            "toml" => drop(crate::cli::feature_sizes(folder, bytes)?),
            "ies" | "ldt" | "placements" => {
                let scene = scene::lit_from_memory(reader, bytes)?;
                let power = scene.emitters.iter().flat_map(|emitter| scene.power(emitter));
                assert!(scene.bounds.diagonal().is_finite() && power.sum::<f64>().is_finite());
            }
            other => panic!("no reader is called {other}"),
        }
        Ok(())
    }

    /// The scene whose cache files the reader `cache` reads, 40 cubes.
    pub fn sample() -> Scene {
        let spec = scene::generate::Spec { count: Some(40), ..scene::generate::Spec::new("cubes") };
        let soup = scene::generate::soup(&spec).expect("a scene");
        scene::resolve(soup, &LoadOptions::default()).expect("a scene")
    }

    /// Content of a cache file of [`sample`].
    pub fn sample_cache() -> Vec<u8> {
        let (scene, options) = (sample(), cache::Options::default());
        let hierarchy = crate::clusters::build(&scene, &options.clusters);
        let optics = crate::optics::measure(&scene, &hierarchy.micro, &options.optics);
        cache::encode(&cache::PreparedClusters { hierarchy, optics }).expect("bytes")
    }
}

/// The C interface.
pub mod capi {
    pub use crate::capi::{layouts, model_handle};
}

/// Form factors between facets.
pub mod form_factors {
    pub use crate::form_factors::matrix::{Facets, Grouping, Matrix, Settings, compute};
}

/// Images in files.
pub mod image_io {
    pub use crate::image_io::read_image;
}

/// Cluster optics.
pub mod optics {
    pub use crate::optics::{Extinction, Options, measure};
}

/// Points in files.
pub mod points {
    pub use crate::points::Point;
}

/// The light in a scene.
pub mod radiosity {
    pub use crate::radiosity::links::Link;
    pub use crate::radiosity::{Options, run};
}

/// Bit images.
pub mod raster {
    pub use crate::raster::{BitImage, Edt, Morphology, Outside};
}

/// Segments.
pub mod ray {
    pub use crate::ray::{Occluder, Packet};
}

/// Scenes from polygons and generators.
pub mod scene {
    pub use crate::scene::{LoadOptions, Scene, Soup, SoupMaterial, generate, resolve, write_obj};
}

/// Instruction sets.
pub mod simd {
    pub use crate::simd::Isa;
}

/// Visibility engines.
pub mod visibility {
    pub use crate::visibility::steps::Steps;
    pub use crate::visibility::{
        Answer, Bundle, Cut, Exact, LeafMode, Mode, MultiResolution, Sums, Workspace, fastest_traversal,
    };
}

use crate::embree::{CommittedScene, Traversal};
use crate::model::Model;
use crate::visibility::{Cut, LeafMode, MultiResolution};

/// The multi-resolution engine over a model with optics, without a budget.
///
/// # Panics
/// If the model was prepared without optics.
pub fn multi_resolution(model: &Model, traversal: Traversal, leaf: LeafMode) -> MultiResolution {
    model.engine(traversal, leaf).expect("optics")
}

/// The distance cut of a model, if it has one.
pub fn cut(model: &Model) -> Option<Cut> {
    model.cut().map(|cut| (*cut).clone())
}

/// The Embree scene of a model.
pub fn traced(model: &Model) -> &CommittedScene {
    model.traced()
}

/// Rays in the widest packet that Embree traces natively on this machine.
pub fn native_width(model: &Model) -> usize {
    model.native_width()
}
