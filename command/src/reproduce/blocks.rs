//! Small scenes of boxes and rectangles.

use glam::DVec3;
use mrvis::internals::scene::{Soup, SoupMaterial, resolve};
use mrvis::{LoadOptions, Result, Scene};
use sobol_burley::sample_4d;

/// Smallest distance between the centres of two cubes, edges: they do not touch.
const MIN_DISTANCE: f64 = 1.1;
/// Number of places that are tried: all that `sample_4d` has.
const CANDIDATE_PLACES: u32 = 1 << 16;

/// A scene under construction; each box is an object.
pub struct Blocks {
    soup: Soup,
}

impl Blocks {
    pub fn new(name: &str) -> Blocks {
        Blocks::with_reflectance(name, 0.5)
    }

    /// Boxes and rectangles with this reflectance.
    pub fn with_reflectance(name: &str, reflectance: f32) -> Blocks {
        let mut soup = Soup::new(name);
        soup.material(SoupMaterial::diffuse("grey", [reflectance; 3]));
        soup.material(SoupMaterial::light("light", [100.0; 3]));
        Blocks { soup }
    }

    /// Adds a rectangle with edges `u` and `v` around `centre` that faces along `u × v`.
    pub fn rectangle(&mut self, centre: DVec3, u: DVec3, v: DVec3, emits: bool) {
        let object = self.soup.object(format!("rectangle {}", self.soup.objects.len()));
        let (u, v) = (0.5 * u, 0.5 * v);
        let corners = [centre - u - v, centre + u - v, centre + u + v, centre - u + v];
        self.soup.polygon(object, u32::from(emits), &corners);
    }

    /// Adds a closed box between two corners.
    pub fn cuboid(&mut self, min: DVec3, max: DVec3) {
        let object = self.soup.object(format!("box {}", self.soup.objects.len()));
        let along = |k: u32, axis: usize| if k >> axis & 1 == 1 { max[axis] } else { min[axis] };
        self.soup.closed_box(object, 0, |k| DVec3::new(along(k, 0), along(k, 1), along(k, 2)));
    }

    /// Adds a cube of two boxes without the faces between them: 24 triangles, so that it has clusters of its own.
    fn halved_cube(&mut self, centre: DVec3, edge: f64) {
        let object = self.soup.object(format!("box {}", self.soup.objects.len()));
        let first = self.soup.positions.len() as u32;
        let at = |k: u32, bit: u32| f64::from(k >> bit & 1) - 0.5;
        for z in [-0.5, 0.0, 0.5] {
            self.soup.positions.extend((0..4).map(|k| centre + edge * DVec3::new(at(k, 0), at(k, 1), z)));
        }
        let mut face = |corners: [u32; 4]| self.soup.indexed_polygon(object, 0, corners.map(|i| first + i));
        face([0, 2, 3, 1]);
        face([8, 9, 11, 10]);
        for low in [0, 4] {
            for side in [[0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]] {
                face(side.map(|i| low + i));
            }
        }
    }

    /// Adds cubes of one size.
    pub fn halved_cubes(&mut self, centres: &[DVec3], edge: f64) {
        centres.iter().for_each(|&centre| self.halved_cube(centre, edge));
    }

    /// Adds cubes of one size that do not touch, at low-discrepancy places in a cubic box around `centre`; fewer if they do not fit.
    pub fn random_cubes(&mut self, count: usize, edge: f64, centre: DVec3, side: f64) {
        for at in places(count, edge, side, DVec3::max_element) {
            self.cuboid(centre + at - 0.5 * edge, centre + at + 0.5 * edge);
        }
    }

    /// The scene.
    pub fn scene(self) -> Result<Scene> {
        resolve(self.soup, &LoadOptions::default())
    }
}

/// Centres of at most `count` cubes of one size in a cubic box around `centre`, of which no two overlap seen along y.
pub fn apart_along_y(count: usize, edge: f64, centre: DVec3, side: f64) -> Vec<DVec3> {
    places(count, edge, side, |d| d.x.max(d.z)).into_iter().map(|at| centre + at).collect()
}

/// Centres of at most `count` cubes of one size in a cubic box of this side around the origin, low-discrepancy points whose differences
/// have a `distance` above [`MIN_DISTANCE`].
fn places(count: usize, edge: f64, side: f64, distance: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let mut places: Vec<DVec3> = Vec::new();
    for k in 0..CANDIDATE_PLACES {
        let [x, y, z, _] = sample_4d(k, 0, 7);
        let at = (DVec3::new(x.into(), y.into(), z.into()) - 0.5) * (side - edge);
        let apart = |other: &DVec3| distance((at - *other).abs()) > MIN_DISTANCE * edge;
        if places.len() < count && places.iter().all(apart) {
            places.push(at);
        }
    }
    places
}
