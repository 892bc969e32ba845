//! Light of surfaces and sky at a point: a grid of rays, one for each cell of a hemisphere of equal cosine weight. Cells are divided where
//! neighbours differ, as at the edges of a window, of a bright part of the sky or of a sunlit wall.

use super::cells_around::{RINGS, RayCell, Surroundings, UNDIVIDED};
use super::gather_point::GatherPoint;
use super::gatherer::{Buffers, FinalGather, PathVertex};
use super::hemisphere::Hemisphere;
use super::paths::EndOfPaths;
use super::sky_light::SkyLight;
use super::uneven_cells::{
    DEFAULT_ERROR, TOLERANCE, UnevenCell, all_cells, bound_of_errors, largest_errors, next_tolerance,
};
use crate::embree::Hits;
use crate::math::sampling::{mix, numbers};
use crate::radiosity::rgb::{Rgb, mean};
use crate::ray::{LANES, Packet};
use glam::{DVec3, Vec3};

/// Largest number of halvings of a cell: of 1,024 cells, edges are then known to a 64th of a cell.
const MAX_LEVEL: u32 = 6;
/// Largest number of rays in the divided cells of a point for [`DEFAULT_ERROR`]; for a smaller error in proportion to 1 / error². Grids
/// that are refined as a whole are not limited. 2,048, 4,096, 8,192 and 16,384 leave errors of 1.7 %, 0.8 %, 0.8 % and 0.6 % below trees in
/// 3.5, 3.5, 3.9 and 4.2 s (`constants.py solve --scene orchard.obj --points 200 --options='--sky overcast:1000'`).
const MAX_RAYS: f64 = 8192.0;
/// Largest number of these rays for any error: limits the time of a point to some 0.1 s.
const MAX_RAYS_OF_ALL: f64 = 131_072.0;
/// Largest number of rays in cells that are divided for the light of surfaces, over the number of rays of the undivided grid. 1, 2, 4 and
/// any number leave errors of 0.72 %, 0.66 %, 0.61 % and 0.59 % below trees in the sun, the last in a tenth more time (`constants.py solve
/// --scene orchard.obj --points 200 --options='--sky clear:3 --sun 135,60'`).
const MAX_SURFACE_RAYS_RATIO: usize = 4;
/// Smallest number of cells whose rays reach the sky: a grid with fewer is refined as a whole, because it may miss a window smaller than
/// a cell.
const MIN_OPEN_CELLS: usize = 64;
/// Number of cells from which on a grid is not refined as a whole. An opening that shows a thousandth of the light of an open sky then
/// has four cells, and the cells at its edges are divided.
const MAX_WHOLE_CELLS: usize = 1 << 12;

/// The ray of a cell.
#[derive(Clone, Copy)]
struct CellRay {
    /// Direction of the ray, of any length.
    direction: Vec3,
    seen: CellHit,
}

/// The result of the ray of a cell.
#[derive(Clone, Copy)]
enum CellHit {
    /// The ray leaves the scene.
    Sky,
    /// A side that no light reaches.
    Dark,
    /// A surface: its radiosity, and that of its element, W/m².
    Surface(Vec3, Vec3),
}

impl FinalGather<'_> {
    /// Irradiance at a point by surfaces and the sky, W/m². `known` is the light of emitters and suns, mean over the channels: in the
    /// sun, the light of the sky needs less accuracy than in a shadow. `openings` are those of [`FinalGather::openings`].
    pub(super) fn irradiance_of_rays(
        &self,
        point: &GatherPoint,
        known: f64,
        openings: &[Vec3],
        buffers: &mut Buffers,
    ) -> Rgb {
        let hemisphere = self.hemisphere_of(point);
        let rays_of_cells = self.trace_whole(&hemisphere, point, buffers);
        if let Some(light) = self.even_light(&rays_of_cells, known) {
            return light;
        }
        let rays_of_cells = hemisphere.in_rows(&rays_of_cells);
        let whole = hemisphere.places();
        let mut levels = vec![self.cells(&hemisphere, 0, &whole, &[], &rays_of_cells, point)];
        // Where all rays met sides that no light reaches, as from below the ground, or the sky is dark, no opening is searched for.
        let is_dark = rays_of_cells.iter().all(|ray| matches!(ray.seen, CellHit::Dark))
            || levels[0].iter().all(|cell| cell.sky == 0.0);
        // A cell with an opening is divided even if neither its ray nor a neighbouring ray passes through the opening.
        let is_searched = !is_dark && levels[0].iter().filter(|cell| cell.is_open).count() < MIN_OPEN_CELLS;
        let openings = if is_searched { openings } else { &[] };
        let openings = self.seen_openings(openings, point, hemisphere.frame, buffers);
        let (share, mut sum) = (1.0 / whole.len() as f64, light_of(&levels[0]) / whole.len() as f64);
        let mut sky = SkyLight::default();
        sky.add(levels[0].iter(), share, 1.0);
        // `left` is the sum of the squared errors of cells that are not divided.
        let (mut left, mut rays, mut divided, mut for_surfaces) = (0.0, whole.len(), 0, 0);
        for level in 0..MAX_LEVEL {
            let area = share * 0.25f64.powi(level as i32);
            let cells = &levels[level as usize];
            let open = cells.iter().filter(|cell| cell.is_open && cell.sky > 0.0).count();
            let is_undivided = cells.len() == whole.len() << (2 * level) && cells.len() < MAX_WHOLE_CELLS;
            let is_whole = is_undivided && open < MIN_OPEN_CELLS && !is_dark;
            let tolerance = self.tolerance_at(known + mean(sum.to_array()));
            let surroundings = Surroundings::new(&levels, hemisphere.size, self.rings());
            let (mut uneven, inner) = surroundings.uneven(area, &openings);
            sum += area * inner.iter().map(|k| cells[*k as usize].smoothing().as_dvec3()).sum::<DVec3>();
            let next =
                if is_whole { Some(tolerance) } else { next_tolerance(&mut uneven, left, tolerance, rays) };
            let Some(tolerance) = next else { break };
            let least = tolerance / (2 * uneven.len().max(1)) as f64;
            let mut chosen = match is_whole {
                true => all_cells(cells, &surroundings, &uneven, least),
                false => {
                    let most = MAX_SURFACE_RAYS_RATIO * whole.len();
                    largest_errors(&surroundings, &uneven, least, &mut for_surfaces, most)
                }
            };
            if !is_whole {
                chosen.truncate((self.most_divided() - divided) / 4);
                divided += 4 * chosen.len();
            }
            if chosen.is_empty() {
                break;
            }
            left += uneven.iter().map(UnevenCell::error).filter(|e| !is_whole && *e <= least).sum::<f64>();
            chosen.sort_unstable_by_key(|(cell, _)| *cell);
            rays += 4 * chosen.len();
            let cells = &mut levels[level as usize];
            inner.iter().for_each(|k| cells[*k as usize].smooth());
            for (k, &(cell, _)) in chosen.iter().enumerate() {
                let cell = &mut cells[cell as usize];
                cell.quarters = 4 * k as u32;
                sum -= cell.light.as_dvec3() * area;
                sky.add(std::iter::once(&*cell), area, -1.0);
            }
            let chosen: Vec<([u32; 2], Option<Vec3>)> =
                chosen.iter().map(|&(k, surfaces)| (cells[k as usize].place, surfaces)).collect();
            let quarters = self.quarters(&chosen, level + 1, &hemisphere, point, buffers);
            sum += light_of(&quarters) * (0.25 * area);
            sky.add(quarters.iter(), 0.25 * area, 1.0);
            levels.push(quarters);
        }
        buffers.scratch.tally.add_rays(rays - whole.len());
        if let Some(environment) = self.environment {
            sum += sky.compared_with(environment.sky_irradiance(point.normal.as_dvec3()).into());
        }
        sum.to_array()
    }

    /// The mean light along the rays of the undivided grid, if no light comes from beyond the scene and no cell needs to be divided, as
    /// for most points of rooms.
    fn even_light(&self, rays: &[CellRay], known: f64) -> Option<Rgb> {
        if self.has_environment() {
            return None;
        }
        let (mut sum, mut range) = (DVec3::ZERO, [f32::INFINITY, f32::NEG_INFINITY]);
        for ray in rays {
            let level = match ray.seen {
                CellHit::Sky => continue,
                CellHit::Dark => 0.0,
                CellHit::Surface(light, of_element) => {
                    sum += light.as_dvec3();
                    of_element.element_sum() / 3.0
                }
            };
            range = [range[0].min(level), range[1].max(level)];
        }
        let light = (sum / rays.len() as f64).to_array();
        (bound_of_errors(rays.len(), range, self.rings()) <= self.tolerance_at(known + mean(light)))
            .then_some(light)
    }

    /// The tolerated sum of squared errors of cells at a point with this irradiance, (W/m²)².
    fn tolerance_at(&self, irradiance: f64) -> f64 {
        (TOLERANCE * self.error * irradiance).powi(2)
    }

    /// Rings of neighbours that are compared. Without a sky there are no thin strips of it. One ring instead of three leaves the errors
    /// at points of three furnished rooms as they are and takes a sixth less time in a Cornell box, whose light changes gradually over
    /// several cells.
    fn rings(&self) -> usize {
        if self.has_environment() { RINGS } else { 1 }
    }

    /// The largest number of rays in divided cells of a point.
    fn most_divided(&self) -> usize {
        (MAX_RAYS * (DEFAULT_ERROR / self.error).powi(2)).clamp(MAX_RAYS, MAX_RAYS_OF_ALL) as usize
    }

    /// The grid of a point, turned by a random angle about its normal.
    fn hemisphere_of(&self, point: &GatherPoint) -> Hemisphere {
        let (x, y) = point.normal.any_orthonormal_pair();
        let [turn, ..] = numbers(point.seed, 1);
        let (sin, cos) = (std::f32::consts::TAU * turn).sin_cos();
        let frame = [cos * x + sin * y, cos * y - sin * x, point.normal];
        Hemisphere { frame, size: self.hemisphere_grid, reach: self.reach_from(point.at) }
    }

    /// Hits of the rays of the undivided grid, in blocks of 4 by 4 cells.
    fn trace_whole(
        &self,
        hemisphere: &Hemisphere,
        point: &GatherPoint,
        buffers: &mut Buffers,
    ) -> Vec<CellRay> {
        let [x, y, z] = hemisphere.frame.map(|axis| hemisphere.reach * axis);
        let directions = &self.hemispheres[(point.seed % self.hemispheres.len() as u64) as usize];
        let packets = &mut buffers.packets;
        packets.resize(directions.len() / LANES, Packet::EMPTY);
        for (packet, directions) in packets.iter_mut().zip(directions.chunks_exact(LANES)) {
            for (lane, d) in directions.iter().enumerate() {
                let to = d.x * x + d.y * y + d.z * z;
                for axis in 0..3 {
                    packet.origin[axis][lane] = point.at[axis];
                    packet.direction[axis][lane] = to[axis];
                }
            }
            (packet.near, packet.far, packet.active) = ([0.0; LANES], [1.0; LANES], 0xffff);
        }
        buffers.scratch.tally.add_rays(directions.len());
        self.seen(&vec![None; directions.len()], point.seed, buffers)
    }

    /// The results of the first rays of `buffers.packets`, one for each of `surfaces`. Where the light of surfaces is known
    /// approximately, one ray in four is evaluated, with four times the weight.
    fn seen(&self, surfaces: &[Option<Vec3>], seed: u64, buffers: &mut Buffers) -> Vec<CellRay> {
        let Buffers { packets, hits, vertices, .. } = buffers;
        hits.clear();
        hits.resize(packets.len(), Hits::NONE);
        self.traced.first_hits(self.traversal, packets, hits);
        vertices.clear();
        // Rays that end too near go on as paths.
        let mut near = Vec::new();
        let mut see = |k: usize| {
            let (packet, hits, lane) = (&packets[k / LANES], &hits[k / LANES], k % LANES);
            if hits.triangle[lane] == Hits::NO_HIT {
                return CellHit::Sky;
            }
            let weight = if surfaces[k].is_some() { 4.0 } else { 1.0 };
            if surfaces[k].is_some() && k % 4 != (mix(seed ^ (k as u64 / 4)) % 4) as usize {
                return CellHit::Surface(Vec3::ZERO, Vec3::ZERO);
            }
            let Some(met) = self.met(packet, hits, lane) else { return CellHit::Dark };
            if self.direct_only || self.is_bright(met.leaf) {
                return CellHit::Surface(Vec3::ZERO, Vec3::ZERO);
            }
            let of_element = self.reflected_from(met.leaf);
            let distance = packet.point(lane, 0.0).distance(packet.point(lane, hits.t[lane]));
            // In a dim corner the elements around have up to a quarter more light than their points in the corner.
            let radius = self.linked.elements.elements[met.leaf as usize].radius;
            let light = self.reflected_or_next(met, distance, radius, near.len() as u32);
            let light = light.unwrap_or_else(|vertex| {
                near.push(k);
                vertices.push(PathVertex { share: weight * vertex.share, ..vertex });
                Vec3::ZERO
            });
            CellHit::Surface(weight * light, of_element)
        };
        let mut rays: Vec<CellRay> = (0..surfaces.len())
            .map(|k| {
                let (packet, lane) = (&packets[k / LANES], k % LANES);
                CellRay { direction: packet.point(lane, 1.0) - packet.point(lane, 0.0), seen: see(k) }
            })
            .collect();
        let mut sums = vec![[0.0; 3]; near.len()];
        self.follow(seed, EndOfPaths::Read, &mut sums, buffers);
        for (k, sum) in near.into_iter().zip(sums) {
            if let CellHit::Surface(light, _) = &mut rays[k].seen {
                *light = Vec3::from(sum.map(|s| s as f32));
            }
        }
        rays
    }

    /// The quarters of cells, given by their places and the light of surfaces in them if it is known, by one ray each.
    fn quarters(
        &self,
        cells: &[([u32; 2], Option<Vec3>)],
        level: u32,
        hemisphere: &Hemisphere,
        point: &GatherPoint,
        buffers: &mut Buffers,
    ) -> Vec<RayCell> {
        let surfaces: Vec<Option<Vec3>> = cells.iter().flat_map(|(_, known)| [*known; 4]).collect();
        let parts: Vec<[u32; 2]> = cells
            .iter()
            .flat_map(|([i, j], _)| [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[a, b]| [2 * i + a, 2 * j + b]))
            .collect();
        let seed = mix(point.seed ^ u64::from(level) << 32);
        let packets = &mut buffers.packets;
        packets.clear();
        packets.resize(parts.len().div_ceil(LANES), Packet::EMPTY);
        for (k, [i, j]) in parts.iter().enumerate() {
            let [u, v, ..] = numbers(seed, k as u64);
            let direction = hemisphere.direction(level, [*i as f32 + u, *j as f32 + v]);
            let to = point.at + hemisphere.reach * direction;
            packets[k / LANES].set_between(k % LANES, point.at, to, [0.0, 1.0]);
        }
        let rays = self.seen(&surfaces, seed, buffers);
        self.cells(hemisphere, level, &parts, &surfaces, &rays, point)
    }

    /// Cells at these places of a level, with the light of the sky at two places in each. If the sky has a map, it may have bright parts
    /// smaller than a cell, and is looked up at sixteen places in each cell of the first levels.
    fn cells(
        &self,
        hemisphere: &Hemisphere,
        level: u32,
        places: &[[u32; 2]],
        surfaces: &[Option<Vec3>],
        rays: &[CellRay],
        point: &GatherPoint,
    ) -> Vec<RayCell> {
        let seed = mix(!point.seed ^ u64::from(level) << 32);
        let has_map = self.environment.is_some_and(|of| of.has_map());
        // The light of the sky in a cell, mean of a few places, and the square of its error, mean over the channels.
        let sky_in = |place: [u32; 2]| {
            if !self.has_environment() {
                return (Vec3::ZERO, 0.0);
            }
            let [u, v, ..] = numbers(seed, u64::from(place[0]) << 32 | u64::from(place[1]));
            let sky_at = |[u, v]: [f32; 2]| {
                self.sky_of_ray(hemisphere.direction(level, [place[0] as f32 + u, place[1] as f32 + v]))
            };
            if has_map && level < 3 {
                let side = [4, 4, 2][level as usize];
                let part = |k: u32| [(k % side) as f32 + u, (k / side) as f32 + v].map(|at| at / side as f32);
                let count = (side * side) as f32;
                let (mut sum, mut squares) = (Vec3::ZERO, 0.0);
                for sky in (0..side * side).map(|k| sky_at(part(k))) {
                    (sum, squares) = (sum + sky, squares + (sky.element_sum() / 3.0).powi(2));
                }
                let mean = sum / count;
                return (mean, (squares / count - (mean.element_sum() / 3.0).powi(2)).max(0.0) / count);
            }
            // The mean of places that mirror each other has no error where the sky is linear over the cell.
            let (a, b) = (sky_at([u, v]), sky_at([1.0 - u, 1.0 - v]));
            (0.5 * (a + b), ((a - b).element_sum() / 6.0).powi(2))
        };
        let cell = |(k, (&place, ray)): (usize, (&[u32; 2], &CellRay))| {
            let is_open = matches!(ray.seen, CellHit::Sky);
            let at_ray = self.sky_of_ray(ray.direction);
            let (sky, error) = sky_in(place);
            let (light, of_element) = match ray.seen {
                CellHit::Sky => (at_ray, sky),
                CellHit::Dark => (Vec3::ZERO, Vec3::ZERO),
                CellHit::Surface(light, of_element) => (light, of_element),
            };
            let surfaces = surfaces.get(k).copied().flatten().unwrap_or(of_element);
            RayCell {
                place,
                is_open,
                light,
                surfaces,
                sky: sky.element_sum() / 3.0,
                unblocked: sky,
                at_ray,
                error,
                quarters: UNDIVIDED,
            }
        };
        places.iter().zip(rays).enumerate().map(cell).collect()
    }
}

/// Sum of the light of cells.
fn light_of(cells: &[RayCell]) -> DVec3 {
    cells.iter().map(|cell| cell.light.as_dvec3()).sum()
}
