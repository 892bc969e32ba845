//! Direct light of many points on a plane: found by rays at the corners of cells that have nothing close to them, and interpolated at the
//! points in between (docs/method.md, Far-field cache).

use super::direct_light::CHUNK;
use super::gatherer::{Buffers, FinalGather};
use crate::math::sampling::mix;
use crate::radiosity::links::{Tally, VisibilityEngine};
use crate::radiosity::rgb::Rgb;
use crate::visibility::{Cut, Probe};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Sets of shadow rays at a corner: the mean of four corners errs by a quarter of what a point by itself does, a corner by half.
const SETS: u64 = 4;
/// Fewest points of a cell: its light takes about as long as that of one corner, which is twice as much for as many points.
const MIN_POINTS: usize = 2 * SETS as usize;
/// Largest number of halvings of a plane.
const MAX_LEVEL: u32 = 16;

/// Direct light that is interpolated.
#[derive(Default)]
pub(super) struct SmoothLight {
    /// By point, the corners of its cell and their weights; none for points whose light is found by rays.
    places: Vec<Option<([u32; 4], [f32; 4])>>,
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
struct Cell {
    level: u32,
    at: [u32; 2],
    points: Vec<(u32, Vec2)>,
}

impl Cell {
    /// Its corners, as columns and rows of the finest level.
    fn corners(&self) -> [[u32; 2]; 4] {
        let [x, y] = self.at;
        [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]].map(|at| at.map(|k| k << (MAX_LEVEL - self.level)))
    }

    /// Weights of the corners at a place of the plane.
    fn weights(&self, place: Vec2) -> [f32; 4] {
        let within = place * (1u32 << self.level) as f32 - Vec2::new(self.at[0] as f32, self.at[1] as f32);
        let [u, v] = within.clamp(Vec2::ZERO, Vec2::ONE).to_array();
        [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v]
    }

    /// Its quarters.
    fn parts(self) -> [Cell; 4] {
        let mut parts = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| Cell {
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
        cut: &Cut,
        engines: &[VisibilityEngine],
    ) -> SmoothLight {
        let mut smooth = SmoothLight { places: vec![None; points.len()], ..SmoothLight::default() };
        let mut corners = Vec::new();
        for plane in planes(points, 8.0 * self.slack) {
            self.add_plane(plane, cut, &mut corners, &mut smooth.places);
        }
        let made: Vec<(Vec<Rgb>, Tally)> = corners
            .par_chunks(CHUNK)
            .map_init(Buffers::default, |buffers, corners| {
                buffers.scratch.tally = Tally::default();
                let points: Vec<_> = corners
                    .iter()
                    .map(|&(at, normal): &(Vec3, Vec3)| self.gather_point(at, normal, seed_of(at)))
                    .collect();
                (self.direct(&points, SETS, engines, &mut buffers.scratch), buffers.scratch.tally)
            })
            .collect();
        for (light, tally) in made {
            smooth.corners.extend(light);
            smooth.tally.add(tally);
        }
        smooth
    }

    /// Divides a plane into cells; adds the corners of those with nothing close to them, and the places of their points. Cells are no larger
    /// than the feature size, because shadows as wide as a cell are blurred.
    fn add_plane(
        &self,
        plane: Plane,
        cut: &Cut,
        corners: &mut Vec<(Vec3, Vec3)>,
        places: &mut [Option<([u32; 4], [f32; 4])>],
    ) {
        let Plane { normal, corner, axes, side, points } = plane;
        let at = |[x, y]: [u32; 2]| {
            let part = |k: u32| side * k as f32 / (1u32 << MAX_LEVEL) as f32;
            corner + part(x) * axes[0] + part(y) * axes[1]
        };
        let mut numbers: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut cells = vec![Cell { level: 0, at: [0; 2], points }];
        while let Some(cell) = cells.pop() {
            if cell.points.len() < MIN_POINTS {
                continue;
            }
            let apart = side / (1u32 << cell.level) as f32;
            let clear = cell.corners().iter().all(|&corner| {
                let point = self.gather_point(at(corner), normal, 0);
                let probe = Probe::lifted(point.at, normal, point.end);
                apart <= point.feature_size && probe.is_clear(cut, self.model.samplers(), apart)
            });
            if clear {
                let of_cell = cell.corners().map(|corner| {
                    *numbers.entry(corner).or_insert_with(|| {
                        corners.push((at(corner), normal));
                        corners.len() as u32 - 1
                    })
                });
                for &(point, place) in &cell.points {
                    places[point as usize] = Some((of_cell, cell.weights(place)));
                }
            } else if cell.level < MAX_LEVEL {
                cells.extend(cell.parts());
            }
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
        let points = of.into_iter().zip(places).map(|(k, place)| (k, (place - low) / side)).collect();
        Plane { normal, corner: first + low.x * axes[0] + low.y * axes[1], axes, side, points }
    };
    groups.into_values().filter(|of| of.len() >= MIN_POINTS).map(plane).collect()
}

/// Seed of a corner: neighbours have different ones, whatever other points there are.
fn seed_of(at: Vec3) -> u64 {
    at.to_array().iter().fold(0, |seed, x| mix(seed ^ u64::from(x.to_bits())))
}
