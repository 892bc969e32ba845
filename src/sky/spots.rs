//! Small bright spots of a sky map, such as its sun, become discs: rays are then sent to them as to any sun. The directions of
//! a point rarely meet a spot of a few texels, and a single hit then accounts for all the light that other directions missed.

use super::frame::Frame;
use super::map::SkyMap;
use super::radiance::Sky;
use super::sun::Sun;
use glam::DVec3;
use std::collections::HashSet;
use std::f64::consts::PI;

/// Directions in which a point looks up a map with default options: sixteen in each of 192 cells.
const LOOKUPS_PER_POINT: f64 = 3072.0;
/// Cosine-weighted directions that meet the widest spot on average. A wider one, of 10° and more, is found by every point, which then
/// traces finer rays around it.
const MAX_HITS: f64 = 24.0;
/// Standard error that a spot causes at a point that sees all of the map, relative to the irradiance there, above which it becomes a
/// disc: half of the error that users ask for by default.
const MAX_ERROR: f64 = 0.01;
/// Radiance at the edge of a spot over its largest. What is darker around it may be a wider spot of its own.
const EDGE: f64 = 1.0 / 16.0;
/// Largest number of discs. Each takes a ray at all places where elements receive light, and 16 or more at each point.
const MAX_DISCS: usize = 8;
/// Smallest fraction of its bounding circle that a spot must fill to become one disc; others are halved. A row of five texels fills a
/// quarter.
const MIN_COMPACT: f64 = 0.25;

/// Texels of a sky's map and their light.
struct Texels<'a> {
    sky: &'a Sky,
    map: &'a SkyMap,
}

/// A part of the map that becomes a disc.
struct Spot {
    texels: Vec<usize>,
    /// Unit vector to its middle, weighted by radiance.
    middle: DVec3,
    /// sr
    solid_angle: f64,
    /// Standard error that it causes at a point, relative to the irradiance.
    error: f64,
}

impl Texels<'_> {
    fn direction(&self, k: usize) -> DVec3 {
        self.map.direction(k)
    }

    /// Mean radiance over the channels at the centre of a texel.
    fn radiance(&self, k: usize) -> f64 {
        self.sky.radiance_of_texel(k).iter().sum::<f64>() / 3.0
    }

    /// Neighbours of a texel, the columns around the sphere.
    fn around(&self, k: usize) -> impl Iterator<Item = usize> + use<> {
        let [width, height] = self.map.size();
        let (x, y) = (k % width, k / width);
        let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
        rows.flat_map(move |y| [x + width - 1, x, x + 1].map(|x| y * width + x % width))
            .filter(move |&n| n != k)
    }

    fn spot(&self, texels: Vec<usize>, irradiance: f64) -> Spot {
        let (mut flow, mut solid_angle, mut light) = (DVec3::ZERO, 0.0, 0.0);
        for &k in &texels {
            let size = self.map.solid_angle(k);
            let power = self.radiance(k) * size;
            flow += power * self.direction(k);
            (solid_angle, light) = (solid_angle + size, light + power);
        }
        let hits = LOOKUPS_PER_POINT * solid_angle / PI;
        Spot { texels, middle: flow.normalize(), solid_angle, error: light / irradiance / hits.sqrt() }
    }

    /// Connected texels from the brightest of them down to [`EDGE`] of its radiance, without those of other spots.
    fn connected(&self, seed: usize, floor: f64, is_taken: &mut HashSet<usize>) -> Vec<usize> {
        let limit = floor.max(EDGE * self.radiance(seed));
        let (mut found, mut next) = (vec![seed], 0);
        is_taken.insert(seed);
        while next < found.len() {
            for k in self.around(found[next]) {
                if self.radiance(k) >= limit && is_taken.insert(k) {
                    found.push(k);
                }
            }
            next += 1;
        }
        found
    }

    /// A spot, or its halves if it is far from round.
    fn divided(&self, spot: Spot, irradiance: f64, into: &mut Vec<Spot>) {
        let far = |&k: &usize| self.direction(k).distance_squared(spot.middle);
        let Some(end) = spot.texels.iter().copied().max_by(|a, b| far(a).total_cmp(&far(b))) else { return };
        if spot.solid_angle >= MIN_COMPACT * PI * far(&end) {
            return into.push(spot);
        }
        let axis = self.direction(end) - spot.middle;
        let is_near = |&k: &usize| (self.direction(k) - spot.middle).dot(axis) < 0.0;
        let (one, other): (Vec<usize>, Vec<usize>) = spot.texels.iter().partition(|&k| is_near(k));
        if one.is_empty() || other.is_empty() {
            return into.push(spot);
        }
        for half in [one, other] {
            self.divided(self.spot(half, irradiance), irradiance, into);
        }
    }

    /// The spots that become discs, and the texels of these and of others.
    fn spots(&self) -> (Vec<Spot>, HashSet<usize>) {
        let [width, height] = self.map.size();
        let count = width * height;
        // Irradiance of a plane under the same light from all sides.
        let irradiance = 0.5 * (0..count).map(|k| self.radiance(k) * self.map.solid_angle(k)).sum::<f64>();
        // The least radiance of the widest spot that matters: its light is MAX_ERROR × √MAX_HITS of the irradiance.
        let floor = MAX_ERROR * irradiance * LOOKUPS_PER_POINT / (PI * MAX_HITS.sqrt());
        let bright = |k: usize| Some((self.radiance(k), k)).filter(|(radiance, _)| *radiance > floor);
        let mut seeds: Vec<(f64, usize)> = (0..count).filter_map(bright).collect();
        seeds.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let (mut is_taken, mut spots) = (HashSet::new(), Vec::new());
        for (_, seed) in seeds {
            if !is_taken.contains(&seed) {
                let spot = self.spot(self.connected(seed, floor, &mut is_taken), irradiance);
                if spot.error > MAX_ERROR && spot.solid_angle * LOOKUPS_PER_POINT <= MAX_HITS * PI {
                    self.divided(spot, irradiance, &mut spots);
                }
            }
        }
        spots.sort_by(|a, b| b.error.total_cmp(&a.error));
        spots.truncate(MAX_DISCS);
        (spots, is_taken)
    }

    /// Texels of a spot and beside it.
    fn rim(&self, spot: &Spot) -> Vec<usize> {
        let mut rim: Vec<usize> = spot.texels.iter().flat_map(|&k| self.around(k)).collect();
        rim.sort_unstable();
        rim.dedup();
        rim
    }

    /// Mean of the texels around a spot that belong to none, which stays where the spot was; black if there are none.
    fn background(&self, spot: &Spot, is_taken: &HashSet<usize>) -> [f32; 3] {
        let mut rim = self.rim(spot);
        rim.retain(|&k| !is_taken.contains(&k) && self.radiance(k) > 0.0);
        let mean = |c: usize| rim.iter().map(|&k| f64::from(self.map.texel(k)[c])).sum::<f64>();
        [0, 1, 2].map(|c| (mean(c) / rim.len().max(1) as f64) as f32)
    }
}

impl Sky {
    /// Takes small bright spots out of the sky's map: discs with their direction, solid angle and light. The background around spots
    /// replaces them.
    pub(super) fn take_spots(&mut self, frame: &Frame) -> Vec<Sun> {
        let Some(map) = self.map() else { return Vec::new() };
        let texels = Texels { sky: self, map };
        let (spots, is_taken) = texels.spots();
        if spots.is_empty() {
            return Vec::new();
        }
        let dimmed = |spot: &Spot| {
            let background = texels.background(spot, &is_taken);
            let darker = |k: usize| [0, 1, 2].map(|c| background[c].min(map.texel(k)[c]));
            // Texels below the horizon have no light, but are interpolated with those above.
            let is_below = |&k: &usize| texels.radiance(k) == 0.0;
            let below = texels.rim(spot).into_iter().filter(is_below);
            spot.texels.iter().copied().chain(below).map(|k| (k, darker(k))).collect::<Vec<_>>()
        };
        let replaced: Vec<(usize, [f32; 3])> = spots.iter().flat_map(dimmed).collect();
        let place = |&k: &usize| (map.direction(k), map.solid_angle(k));
        let places: Vec<Vec<_>> = spots.iter().map(|spot| spot.texels.iter().map(place).collect()).collect();
        // Irradiance of a plane towards the middle of a spot.
        let facing = |sky: &Sky, spot: usize| {
            let mut sum = [0.0; 3];
            for &(direction, solid_angle) in &places[spot] {
                let (l, cosine) = (sky.radiance(direction), direction.dot(spots[spot].middle));
                (0..3).for_each(|c| sum[c] += solid_angle * cosine * l[c]);
            }
            sum
        };
        let with: Vec<[f64; 3]> = (0..spots.len()).map(|k| facing(self, k)).collect();
        self.set_texels(replaced);
        let disc = |k: usize| {
            let (spot, without) = (&spots[k], facing(self, k));
            let irradiance = [0, 1, 2].map(|c| (with[k][c] - without[c]).max(0.0));
            // 2π (1 − cos(diameter / 2)) is the solid angle.
            let diameter = 4.0 * (spot.solid_angle / (4.0 * PI)).sqrt().asin();
            Sun { direction: frame.world(spot.middle), diameter, irradiance }
        };
        (0..spots.len()).map(disc).collect()
    }
}
