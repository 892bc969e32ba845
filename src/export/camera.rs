//! Pictures of a mesh by ray casting.
//!
//! The mesh is made from a solution: its triangles are parts of one-sided elements, with light at their vertices. A
//! [`crate::model::Model`] holds the triangles of the input, and a hit on one of them names no element. So a [`Stage`] has Embree
//! scenes of its own. They need no clusters and no cache, and are dropped after the pictures are written.

use super::Mesh;
use crate::Result;
use crate::embree::{CommittedScene, Device, Hits, SceneBuilder, Traversal};
use crate::math::on_plane;
use crate::math::parallel;
use crate::progress::Progress;
use crate::radiosity::mesh::RadiosityMesh;
use crate::ray::{LANES, Occluder, Packet};
use crate::sky::Environment;
use glam::Vec3;

/// A pinhole camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Name of the picture files.
    pub name: String,
    /// Position relative to [`RadiosityMesh::origin`].
    pub eye: Vec3,
    /// Viewing direction, a unit vector.
    pub forward: Vec3,
    /// Upward direction of the picture; not parallel to `forward`.
    pub up: Vec3,
    /// Angle of view from top to bottom, radians.
    pub angle: f32,
}

/// A picture of radiance.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Radiance in linear RGB, W/(m² sr), row by row from the top; black where no surface is visible.
    pub radiance: Vec<[f32; 3]>,
    /// First hit of one ray per pixel (the central one if there is one ray); `None` without a hit.
    pub first: Vec<Option<First>>,
}

/// First hit of a ray.
#[derive(Clone, Copy, Debug)]
pub struct First {
    /// Distance from the eye, scene units.
    pub distance: f32,
    /// Position relative to [`RadiosityMesh::origin`].
    pub position: Vec3,
    /// Index of the element.
    pub element: u32,
    /// Irradiance, W/m².
    pub irradiance: [f32; 3],
}

/// Radiance and first hit of a pixel.
pub(super) type Pixel = ([f32; 3], Option<First>);

/// A mesh in an Embree scene.
pub struct Stage<'a> {
    /// The mesh.
    pub mesh: &'a Mesh,
    /// Fronts and backs of sheets coincide: one Embree scene for each side, with the index in `mesh` of each triangle.
    sides: [(CommittedScene, Vec<u32>); 2],
    /// By element, whether another surface stands across it.
    crossed: Vec<bool>,
    /// Whether surfaces are transparent from sides that have no elements, as the outside of a closed room; otherwise they are black.
    looks_inside: bool,
    /// Sky that rays see if they meet no surface; none: black.
    sky: Option<&'a Environment>,
}

/// Embree's ray call for packets of neighbouring pixels: the widest needs the fewest calls. Does not change results.
const TRAVERSAL: Traversal = Traversal { width: 16, coherent: false };
/// Distance of segments within an element from its plane and its corners, as a fraction of its diameter: far above rounding, and
/// surfaces that are nearer hide less than this fraction of the element.
const INSET: f32 = 1.0 / 128.0;
/// Largest difference of the distances at which a ray meets the two sides of a sheet, relative to them: a hundred roundings of 32 bits.
const SHEET: f32 = 1e-5;
/// Largest number of back sides that a ray passes: limits the time of a ray to 64 queries.
const MAX_LAYERS: usize = 64;

impl<'a> Stage<'a> {
    /// Builds the Embree scenes of `mesh`, which belongs to `solution`.
    ///
    /// # Errors
    /// Embree fails.
    pub fn new(mesh: &'a Mesh, solution: &RadiosityMesh) -> Result<Stage<'a>> {
        let device = Device::for_triangles(mesh.triangles.len())?;
        let side = |front: bool| -> Result<(CommittedScene, Vec<u32>)> {
            let of = |t: &u32| solution.elements[mesh.element[*t as usize] as usize].front == front;
            let chosen: Vec<u32> = (0..mesh.triangles.len() as u32).filter(of).collect();
            let triangles: Vec<[u32; 3]> = chosen.iter().map(|&t| mesh.triangles[t as usize]).collect();
            let mut builder = SceneBuilder::new(&device)?;
            builder.add_triangles(&mesh.positions, &triangles)?;
            Ok((builder.commit()?, chosen))
        };
        let crossed = solution.elements.iter().map(|e| e.crossed).collect();
        Ok(Stage { mesh, sides: [side(true)?, side(false)?], crossed, looks_inside: false, sky: None })
    }

    /// Whether rooms can be seen from outside through their walls; by default walls are black there.
    pub fn looking_inside(self, looks_inside: bool) -> Stage<'a> {
        Stage { looks_inside, ..self }
    }

    /// The same before a sky; none is black.
    pub fn under(self, sky: Option<&'a Environment>) -> Stage<'a> {
        Stage { sky, ..self }
    }

    /// First triangle that each ray of a packet hits on its front, and the distance; none where a surface without elements on that side is
    /// in front of it, unless the stage looks inside.
    pub(super) fn first(&self, rays: &Packet) -> [Option<(u32, f32)>; LANES] {
        self.first_and_missed(rays).0
    }

    /// The same, and a bit for each ray that meets no surface at all.
    fn first_and_missed(&self, rays: &Packet) -> ([Option<(u32, f32)>; LANES], u32) {
        let mut best: [Option<(u32, f32)>; LANES] = [None; LANES];
        let mut behind = [f32::INFINITY; LANES];
        let mut missed = rays.active;
        for (scene, chosen) in &self.sides {
            let mut rays = rays.clone();
            for _ in 0..MAX_LAYERS {
                let mut hits = [Hits::NONE];
                scene.first_hits(TRAVERSAL, std::slice::from_ref(&rays), &mut hits);
                let mut again = 0;
                for lane in rays.lanes() {
                    let hit = hits[0].triangle[lane];
                    if hit == Hits::NO_HIT {
                        continue;
                    }
                    missed &= !(1 << lane);
                    let (triangle, t) = (chosen[hit as usize], hits[0].t[lane]);
                    let normal = self.mesh.normals[self.mesh.triangles[triangle as usize][0] as usize];
                    if normal.dot(Vec3::from(rays.direction.map(|axis| axis[lane]))) < 0.0 {
                        if best[lane].is_none_or(|b| t < b.1) {
                            best[lane] = Some((triangle, t));
                        }
                    } else {
                        behind[lane] = behind[lane].min(t);
                        rays.near[lane] = t * (1.0 + SHEET);
                        again |= u32::from(self.looks_inside) << lane;
                    }
                }
                rays.active = again;
                if again == 0 {
                    break;
                }
            }
        }
        if !self.looks_inside {
            // The two sides of a sheet lie in one place.
            for (best, behind) in best.iter_mut().zip(behind) {
                *best = best.filter(|(_, t)| *t <= behind * (1.0 + SHEET));
            }
        }
        (best, missed)
    }

    /// Radiance in a direction in which no surface is, W/(m² sr).
    fn beyond(&self, direction: Vec3) -> [f32; 3] {
        let radiance = |sky: &Environment| sky.radiance_with_suns(direction.as_dvec3().normalize_or_zero());
        self.sky.map_or([0.0; 3], radiance).map(|l| l as f32)
    }

    /// Radiance at a point of a triangle.
    fn radiance(&self, triangle: u32, point: Vec3) -> [f32; 3] {
        self.interpolate(triangle, point, &self.mesh.radiosity).map(|b| b / std::f32::consts::PI)
    }

    /// Interpolates values at the vertices of a triangle; in an element that another surface stands across, those on the side of the point
    /// alone.
    fn interpolate(&self, triangle: u32, point: Vec3, values: &[[f32; 3]]) -> [f32; 3] {
        let [a, b, c] = self.mesh.corners(triangle as usize);
        let normal = (b - a).cross(c - a);
        let square = normal.length_squared();
        let share = |p: Vec3, q: Vec3| ((q - p).cross(point - p).dot(normal) / square).clamp(0.0, 1.0);
        let mut weights = [share(b, c), share(c, a), share(a, b)];
        if self.crossed[self.mesh.element[triangle as usize] as usize] {
            self.leave_out_blocked([a, b, c], point, &mut weights);
        }
        let values = self.mesh.triangles[triangle as usize].map(|v| values[v as usize]);
        std::array::from_fn(|k| (0..3).map(|i| weights[i] * values[i][k]).sum())
    }

    /// Sets the weights of those corners to 0 that a surface hides from the point; the others then have the sum 1, if there are any.
    fn leave_out_blocked(&self, corners: [Vec3; 3], point: Vec3, weights: &mut [f32; 3]) {
        let [a, b, c] = corners;
        let middle = (a + b + c) / 3.0;
        let diameter = corners.iter().map(|p| 2.0 * p.distance(middle)).fold(0.0, f32::max);
        let above = INSET * diameter * (b - a).cross(c - a).normalize_or_zero();
        let mut rays = Packet::EMPTY;
        for (k, corner) in corners.into_iter().enumerate() {
            let to = corner + INSET * (middle - corner);
            rays.set_between(k, point + above, to + above, [0.0, 1.0]);
        }
        let blocked = self.sides.iter().fold(0, |blocked, (scene, _)| {
            let mut found = [0];
            scene.occluded(std::slice::from_ref(&rays), &mut found);
            blocked | found[0]
        });
        (0..3).filter(|k| blocked >> k & 1 != 0).for_each(|k| weights[k] = 0.0);
        let sum: f32 = weights.iter().sum();
        if sum > 0.0 {
            weights.iter_mut().for_each(|w| *w /= sum);
        }
    }

    /// Irradiance at the first hit of each ray of a packet, W/m²; `None` without a hit.
    pub(super) fn irradiance(&self, rays: &Packet) -> [Option<[f32; 3]>; LANES] {
        let met = self.first(rays);
        std::array::from_fn(|lane| {
            let (triangle, t) = met[lane]?;
            Some(self.interpolate(triangle, rays.point(lane, t), &self.mesh.irradiance))
        })
    }
}

impl Camera {
    /// Directions of rays through places of a picture of this size; places are in pixels from its upper left corner.
    fn directions(&self, [width, height]: [usize; 2]) -> impl Fn(f32, f32) -> Vec3 {
        let right = self.forward.cross(self.up).normalize();
        let up = right.cross(self.forward);
        let half = (0.5 * self.angle).tan();
        let forward = self.forward;
        move |x, y| {
            let (u, v) = (2.0 * x / width as f32 - 1.0, 1.0 - 2.0 * y / height as f32);
            (forward + right * (u * half * width as f32 / height as f32) + up * (v * half)).normalize()
        }
    }
}

/// Radiance at [`LANES`] places of a pixel, W/(m² sr); black where no surface is visible.
pub(super) fn samples_of_pixel(
    stage: &Stage,
    camera: &Camera,
    size: [usize; 2],
    pixel: usize,
) -> [[f32; 3]; LANES] {
    /// Places along a side of the pixel: the places of a pixel fill a packet.
    const SIDE: usize = 4;
    const { assert!(SIDE * SIDE == LANES) };
    let direction = camera.directions(size);
    let (column, row) = (pixel % size[0], pixel / size[0]);
    let mut rays = Packet::EMPTY;
    for lane in 0..LANES {
        let within = |k: usize| (k as f32 + 0.5) / SIDE as f32;
        let d = direction(column as f32 + within(lane % SIDE), row as f32 + within(lane / SIDE));
        rays.set_ray(lane, camera.eye, d);
    }
    let (met, missed) = stage.first_and_missed(&rays);
    std::array::from_fn(|lane| match met[lane] {
        Some((triangle, t)) => stage.radiance(triangle, rays.point(lane, t)),
        None if missed >> lane & 1 != 0 => stage.beyond(rays.point(lane, 1.0) - rays.point(lane, 0.0)),
        None => [0.0; 3],
    })
}

/// Renders a picture with `samples` × `samples` rays per pixel. Empty if `progress` has stopped.
pub fn render(
    stage: &Stage,
    camera: &Camera,
    [width, height]: [usize; 2],
    samples: usize,
    progress: &dyn Progress,
) -> Frame {
    progress.stage("rendering", height as u64);
    let direction = camera.directions([width, height]);
    let samples = samples.max(1);
    let share = 1.0 / (samples * samples) as f32;
    let step = 1.0 / samples as f32;
    let rows: Vec<Vec<Pixel>> = parallel::map(0..height, |y| {
        if progress.stopped() {
            return Vec::new();
        }
        progress.advance(1);
        let mut row = vec![([0f32; 3], None); width];
        for left in (0..width).step_by(LANES) {
            let lanes = LANES.min(width - left);
            for k in 0..samples * samples {
                let mut rays = Packet::EMPTY;
                for lane in 0..lanes {
                    let (i, j) = ((k % samples) as f32 + 0.5, (k / samples) as f32 + 0.5);
                    let d = direction((left + lane) as f32 + i * step, y as f32 + j * step);
                    rays.set_ray(lane, camera.eye, d);
                }
                let (met, missed) = stage.first_and_missed(&rays);
                for (lane, hit) in met.into_iter().enumerate().take(lanes) {
                    let Some((triangle, t)) = hit else {
                        if missed >> lane & 1 != 0 {
                            let light = stage.beyond(rays.point(lane, 1.0) - rays.point(lane, 0.0));
                            row[left + lane].0.iter_mut().zip(light).for_each(|(s, x)| *s += share * x);
                        }
                        continue;
                    };
                    // Embree's distances of hits near edges can be a hundred roundings off.
                    let position = on_plane(stage.mesh.corners(triangle as usize), rays.point(lane, t));
                    let radiance = stage.radiance(triangle, position);
                    let (sum, first) = &mut row[left + lane];
                    sum.iter_mut().zip(radiance).for_each(|(s, x)| *s += share * x);
                    if k == samples * samples / 2 {
                        let element = stage.mesh.element[triangle as usize];
                        let irradiance = stage.interpolate(triangle, position, &stage.mesh.irradiance);
                        *first = Some(First { distance: t, position, element, irradiance });
                    }
                }
            }
        }
        row
    });
    if progress.stopped() {
        return Frame { radiance: Vec::new(), first: Vec::new() };
    }
    let (radiance, first) = rows.into_iter().flatten().unzip();
    Frame { radiance, first }
}
