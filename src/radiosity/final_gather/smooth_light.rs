//! Direct light of many points on a plane: found by rays at the corners of cells that have nothing close to them, and interpolated at the
//! points in between (docs/method.md, Far-field cache).

use super::direct_light::CHUNK;
use super::gather_point::GatherPoint;
use super::gatherer::{Buffers, FinalGather};
use crate::math::parallel;
use crate::math::sampling::mix;
use crate::radiosity::links::{Tally, VisibilityEngine};
use crate::radiosity::rgb::Rgb;
use crate::visibility::{DistanceCut, Probe};
use glam::{Vec2, Vec3};
use std::collections::{BTreeMap, BTreeSet};

/// Sets of shadow rays at a corner: the error of one corner is half that of a single point, the error of the mean of four corners a
/// quarter.
const SETS: u64 = 4;
/// Smallest number of points of a cell. A corner costs as many rays as [`SETS`] points, and a lattice has one corner per cell: the
/// light of cells with this many points takes half as long as by rays from every point.
const MIN_POINTS: usize = 2 * SETS as usize;
/// Largest number of halvings of a plane: to 1/65,536 of its width, where coordinates of corners still have 8 bits more.
const MAX_LEVEL: u32 = 16;

/// The corners of the cell of a point, and their weights.
type Interpolation = ([u32; 4], [f32; 4]);

/// A corner with nothing close to it, and the light there without blockers, W/m².
type FreeCorner = (GatherPoint, f64);

/// Interpolated direct light.
#[derive(Default)]
pub(super) struct SmoothLight {
    /// By point; none for points whose light is found by rays.
    places: Vec<Option<Interpolation>>,
    /// Irradiance at the corners, W/m².
    corners: Vec<Rgb>,
    /// Cost of the rays.
    pub tally: Tally,
}

impl SmoothLight {
    /// Irradiance at a point by emitters, W/m², if it is interpolated.
    pub fn at(&self, point: usize) -> Option<Rgb> {
        let (corners, weights) = self.places.get(point)?.as_ref()?;
        let mut light = [0.0; 3];
        for (&corner, &weight) in corners.iter().zip(weights) {
            let of = self.corners[corner as usize];
            (0..3).for_each(|channel| light[channel] += f64::from(weight) * of[channel]);
        }
        Some(light)
    }
}

/// Points in a common plane.
struct Plane {
    normal: Vec3,
    /// A corner of the square around the points, and its sides.
    corner: Vec3,
    axes: [Vec3; 2],
    side: f32,
    /// Points and their places in the square, in [0, 1].
    points: Vec<(u32, Vec2)>,
}

/// A square of a plane: level of division, column and row, and its points.
struct Square {
    level: u32,
    at: [u32; 2],
    points: Vec<(u32, Vec2)>,
}

impl Square {
    /// Its corners, as columns and rows of the finest level.
    fn corners(&self) -> [[u32; 2]; 4] {
        let [x, y] = self.at;
        [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]].map(|at| at.map(|k| k << (MAX_LEVEL - self.level)))
    }

    /// Its centre, as column and row of the finest level.
    fn centre(&self) -> [u32; 2] {
        let half = (1 << (MAX_LEVEL - self.level)) / 2;
        self.corners()[0].map(|k| k + half)
    }

    /// Weights of the corners at a place of the plane.
    fn weights(&self, place: Vec2) -> [f32; 4] {
        let within = place * (1u32 << self.level) as f32 - Vec2::new(self.at[0] as f32, self.at[1] as f32);
        let [u, v] = within.clamp(Vec2::ZERO, Vec2::ONE).to_array();
        [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v]
    }

    /// Its quarters.
    fn parts(self) -> [Square; 4] {
        let mut parts = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| Square {
            level: self.level + 1,
            at: [2 * self.at[0] + i, 2 * self.at[1] + j],
            points: Vec::new(),
        });
        let middle = (Vec2::new(self.at[0] as f32, self.at[1] as f32) + 0.5) / (1u32 << self.level) as f32;
        for point in self.points {
            let [right, above] = [point.1.x >= middle.x, point.1.y >= middle.y];
            parts[usize::from(right) + 2 * usize::from(above)].points.push(point);
        }
        parts
    }
}

impl FinalGather<'_> {
    /// The direct light of those points (scene units, unit normals) that lie densely in planes with nothing close to them.
    pub(super) fn smooth_light(
        &self,
        points: &[(Vec3, Vec3)],
        cut: &DistanceCut,
        engines: &[VisibilityEngine],
    ) -> SmoothLight {
        let mut smooth = SmoothLight { places: vec![None; points.len()], ..SmoothLight::default() };
        let mut corners = Vec::new();
        for plane in planes(points, 2.0 * self.slack) {
            self.add_plane(plane, cut, &mut corners, &mut smooth.places);
        }
        let rows = self.ranks.rows(corners.len().div_ceil(CHUNK));
        let made: Vec<(Vec<Rgb>, Tally)> =
            parallel::map_with(rows.numbers(), Buffers::default, |buffers, chunk| {
                buffers.scratch.tally = Tally::default();
                let corners = &corners[CHUNK * chunk..corners.len().min(CHUNK * (chunk + 1))];
                (self.direct(corners, SETS, engines, &mut buffers.scratch), buffers.scratch.tally)
            });
        for (light, tally) in rows.gather(made) {
            smooth.corners.extend(light);
            smooth.tally.add(tally);
        }
        smooth
    }

    /// Divides a plane into cells; adds the corners of those in which light is smooth, and the places of their points.
    fn add_plane(
        &self,
        plane: Plane,
        cut: &DistanceCut,
        corners: &mut Vec<GatherPoint>,
        places: &mut [Option<Interpolation>],
    ) {
        let Plane { normal, corner, axes, side, points } = plane;
        let at = |[x, y]: [u32; 2]| {
            let part = |k: u32| side * k as f32 / (1u32 << MAX_LEVEL) as f32;
            let at = corner + part(x) * axes[0] + part(y) * axes[1];
            self.gather_point(at, normal, mix(self.linked.settings.seed ^ seed_of(at)))
        };
        let mut numbers: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut cells = vec![Square { level: 0, at: [0; 2], points }];
        for level in 0..=MAX_LEVEL {
            cells.retain(|cell| cell.points.len() >= MIN_POINTS);
            let apart = side / (1u32 << level) as f32;
            // For the corners of the cells: whether no surface is close, and the unoccluded light there.
            let asked: BTreeSet<[u32; 2]> = cells.iter().flat_map(Square::corners).collect();
            let asked: Vec<[u32; 2]> = asked.into_iter().collect();
            let probes: Vec<([u32; 2], Option<FreeCorner>)> = parallel::map(&asked, |&place| {
                let point = at(place);
                let probe = Probe::lifted(point.at, normal, point.end);
                let clear = apart <= point.feature_size && probe.is_clear(cut, self.model.samplers(), apart);
                (place, clear.then(|| (point, self.unblocked_at(&point))))
            });
            let probes: BTreeMap<[u32; 2], Option<FreeCorner>> = probes.into_iter().collect();
            let smooth: Vec<Option<[FreeCorner; 4]>> = parallel::map(&cells, |cell| {
                let [a, b, c, d] = cell.corners().map(|corner| probes[&corner]);
                let found = [a?, b?, c?, d?];
                let centre = at(cell.centre());
                let mean = 0.25 * found.iter().map(|(_, free)| free).sum::<f64>();
                let free = self.unblocked_at(&centre);
                let linear = (mean - free).abs() <= self.visibility_tolerance() * free;
                (linear && apart <= centre.feature_size).then_some(found)
            });
            let mut parts = Vec::new();
            for (cell, smooth) in cells.into_iter().zip(smooth) {
                let Some(found) = smooth else {
                    if level < MAX_LEVEL {
                        parts.extend(cell.parts());
                    }
                    continue;
                };
                let places_of = cell.corners();
                let of_cell = std::array::from_fn(|k| {
                    *numbers.entry(places_of[k]).or_insert_with(|| {
                        corners.push(found[k].0);
                        corners.len() as u32 - 1
                    })
                });
                for &(point, place) in &cell.points {
                    places[point as usize] = Some((of_cell, cell.weights(place)));
                }
            }
            cells = parts;
        }
    }
}

/// Points by plane: those with the same normal and, to a tolerance, the same distance along it.
fn planes(points: &[(Vec3, Vec3)], tolerance: f32) -> Vec<Plane> {
    let mut groups: BTreeMap<([u32; 3], i64), Vec<u32>> = BTreeMap::new();
    for ((at, normal), k) in points.iter().zip(0..) {
        let distance = (normal.dot(*at) / tolerance).round() as i64;
        groups.entry((normal.to_array().map(f32::to_bits), distance)).or_default().push(k);
    }
    let plane = |of: Vec<u32>| {
        let (first, normal) = points[of[0] as usize];
        let axes = <[Vec3; 2]>::from(normal.any_orthonormal_pair());
        let places = of.iter().map(|&k| {
            let from = points[k as usize].0 - first;
            Vec2::new(axes[0].dot(from), axes[1].dot(from))
        });
        let places: Vec<Vec2> = places.collect();
        let low = places.iter().fold(Vec2::INFINITY, |low, place| low.min(*place));
        let high = places.iter().fold(Vec2::NEG_INFINITY, |high, place| high.max(*place));
        let side = (high - low).max_element().max(tolerance);
        // The plane of the corners goes through the lowest point, so that surfaces above this point are close to the corners.
        let height = |k: &u32| normal.dot(points[*k as usize].0 - first);
        let depth = of.iter().map(height).fold(f32::INFINITY, f32::min);
        let corner = first + low.x * axes[0] + low.y * axes[1] + depth * normal;
        let points = of.into_iter().zip(places).map(|(k, place)| (k, (place - low) / side)).collect();
        Plane { normal, corner, axes, side, points }
    };
    groups.into_values().filter(|of| of.len() >= MIN_POINTS).map(plane).collect()
}

/// Seed of a corner, from its position alone: neighbouring corners have different seeds, whatever the other points are.
fn seed_of(at: Vec3) -> u64 {
    at.to_array().iter().fold(0, |seed, x| mix(seed ^ u64::from(x.to_bits())))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nothing that lies above the deepest point of a plane is below its corners, in whichever order points come.
    #[test]
    fn planes_lie_at_their_deepest_points() {
        let place = |k: usize| Vec3::new((k % 5) as f32, (k / 5) as f32, if k < 10 { 1e-4 } else { 0.0 });
        let mut points: Vec<(Vec3, Vec3)> = (0..20).map(|k| (place(k), Vec3::Z)).collect();
        for _ in 0..2 {
            let planes = planes(&points, 1e-3);
            assert_eq!((planes.len(), planes[0].points.len()), (1, 20));
            assert!(planes[0].corner.z.abs() < 1e-6 && planes[0].side == 4.0, "{:?}", planes[0].corner);
            points.reverse();
        }
        points[0].0.z = 0.1;
        points[1].1 = -Vec3::Z;
        assert_eq!(planes(&points, 1e-3)[0].points.len(), 18);
    }

    /// The weights of the corners sum to 1, and are those of the corner at a corner; each quarter holds the points in it.
    #[test]
    fn cells_hold_their_points() {
        let points: Vec<(u32, Vec2)> =
            (0..100).map(|k| (k, Vec2::new((k % 10) as f32, (k / 10) as f32) / 9.0)).collect();
        let cell = Square { level: 0, at: [0; 2], points };
        assert_eq!(cell.weights(Vec2::new(1.0, 0.0)), [0.0, 1.0, 0.0, 0.0]);
        let parts = cell.parts();
        assert_eq!(parts.iter().map(|part| part.points.len()).sum::<usize>(), 100);
        for part in &parts {
            for &(_, place) in &part.points {
                let weights = part.weights(place);
                assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                let corners = part.corners().map(|c| Vec2::new(c[0] as f32, c[1] as f32) / 65_536.0);
                let mean: Vec2 = weights.iter().zip(corners).map(|(w, c)| *w * c).sum();
                assert!((mean - place).length() < 1e-6, "{mean} {place}");
            }
        }
    }
}
