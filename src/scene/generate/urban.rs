//! Town blocks inside a box of sky: closed, so that all emitted light arrives at a facet.

use super::{
    Spec,
    shapes::{Builder, Random},
};
use crate::{Result, scene::Soup};
use glam::DVec3;

/// Number of buildings along each side.
const BUILDINGS: usize = 4;
/// Width of a building and of a street, height of a storey and of the sky; metres.
const BUILDING: f64 = 16.0;
const STREET: f64 = 10.0;
const STOREY: f64 = 3.0;
const SKY: f64 = 60.0;
/// Default number of facets.
const FACETS: usize = 5000;

/// Streets, houses of two to ten storeys, and a box-shaped emitting sky, in nearly square facets of one size: the
/// number of facets is as close to `count` as one size allows. No ground below houses; all fronts face the air.
pub(super) fn urban_block(spec: &Spec) -> Result<Soup> {
    let wanted = spec.count.unwrap_or(FACETS);
    let build = |edge: f64| {
        let mut town = Town { b: Builder::new("urban-block"), edge };
        town.build(&mut Random::new(spec.seed));
        town.b.soup
    };
    let (mut edge, mut best) = (3.0, build(1e9));
    for _ in 0..12 {
        let soup = build(edge);
        edge *= (soup.polygons() as f64 / wanted as f64).sqrt();
        if soup.polygons().abs_diff(wanted) < best.polygons().abs_diff(wanted) {
            best = soup;
        }
    }
    Ok(best)
}

struct Town {
    b: Builder,
    edge: f64,
}

impl Town {
    fn build(&mut self, random: &mut Random) {
        let pitch = BUILDING + STREET;
        // Start of each street and block along both axes.
        let mut lines: Vec<f64> =
            (0..BUILDINGS).flat_map(|k| [k as f64 * pitch, k as f64 * pitch + STREET]).collect();
        let size = BUILDINGS as f64 * pitch + STREET;
        lines.extend([BUILDINGS as f64 * pitch, size]);
        for (i, x) in lines.windows(2).enumerate() {
            for (j, y) in lines.windows(2).enumerate() {
                let (at, u, v) =
                    (DVec3::new(x[0], y[0], 0.0), DVec3::X * (x[1] - x[0]), DVec3::Y * (y[1] - y[0]));
                if i % 2 == 1 && j % 2 == 1 {
                    let storeys = random.between(2.0, 11.0).floor();
                    self.b.object(format!("building {}", i / 2 * BUILDINGS + j / 2 + 1));
                    self.b.material("facade", [0.5, 0.47, 0.42]);
                    let up = DVec3::Z * (STOREY * storeys);
                    self.tiles(at, u, up);
                    self.tiles(at + u, v, up);
                    self.tiles(at + u + v, -u, up);
                    self.tiles(at + v, -v, up);
                    self.b.material("roof", [0.3, 0.25, 0.22]);
                    self.tiles(at + up, u, v);
                } else {
                    self.b.object(format!("ground {i} {j}")).material("asphalt", [0.2; 3]);
                    self.tiles(at, u, v);
                }
            }
        }
        let (u, v, up) = (DVec3::X * size, DVec3::Y * size, DVec3::Z * SKY);
        self.b.emissive(0.0, [0.9, 0.95, 1.0]);
        self.tiles(up, v, u);
        self.tiles(DVec3::ZERO, up, u);
        self.tiles(u, up, v);
        self.tiles(u + v, up, -u);
        self.tiles(v, up, -v);
    }

    /// Adds a rectangle with edges `u` and `v` at `corner` that faces along `u × v`, divided into tiles.
    fn tiles(&mut self, corner: DVec3, u: DVec3, v: DVec3) {
        let cuts = |side: DVec3| (side.length() / self.edge).round().max(1.0) as usize;
        let (m, n) = (cuts(u), cuts(v));
        let at = |i: usize, j: usize| corner + u * (i as f64 / m as f64) + v * (j as f64 / n as f64);
        for i in 0..m {
            for j in 0..n {
                self.b.polygon(&[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }
}
