//! Places around a given point at which its surface is searched for.

use super::Model;
use crate::embree::Hits;
use crate::error::number;
use crate::math::sampling::{cosine_direction, numbers};
use crate::math::{Aabb, edge_distance, off_edges, parallel, places_around};
use crate::ray::{EndRule, LANES, Packet};
use crate::scene::magnitude;
use glam::Vec3;
use smallvec::SmallVec;

/// Pairs of places around a point between which all walls at the point pass: the sides of two squares, one of which stands on its corner,
/// so that no wall passes through the ends of all.
const AROUND: [[usize; 2]; 8] = [[5, 6], [6, 7], [7, 8], [8, 5], [1, 3], [3, 2], [2, 4], [4, 1]];

/// Which surfaces count as that of a point.
#[derive(Clone, Copy)]
pub(crate) struct SurfaceSearch {
    /// Smallest cosine between the normals of the point and of the surface.
    pub min_cosine: f32,
    /// Whether the surface lies within rounding of the point; otherwise it may lie above it, as files contain few digits.
    pub is_near: bool,
}

/// The searches for the surface of a point, in their order: a point where a wall meets a sloping roof lies on both, and belongs to the one
/// with about its normal (within 26°); then any surface within 60°, as files hold smoothed normals.
const SEARCHES: [SurfaceSearch; 2] =
    [SurfaceSearch { min_cosine: 0.9, is_near: true }, SurfaceSearch { min_cosine: 0.5, is_near: false }];

/// Smallest distance of a place around a point from a wall, relative to that from the point. Places are 45 degrees apart, so that in a
/// corner of 90 degrees some place has sin 22.5° = .38; in one below 75 degrees all may have less than this, sin 14.5°.
const MIN_WALL_DISTANCE: f32 = 0.25;

/// Smallest coordinate of a point, relative to the largest of the scene, for which faces around it are not asked for theirs: places are
/// then at a distance (4e-6) of at least 2.5 times the rounding of any of them (4e-7).
const MIN_MAGNITUDE: f32 = 0.25;

/// Distance from surfaces, as a fraction of the scene's diagonal, above which a point is reported as off all surfaces: 1 cm in a room
/// of 10 m, above the rounding of files with four digits.
const FAR_OFF: f32 = 1e-3;

/// Largest number of points that are tested for walls close to them, evenly spread: limits the time to 32,000 short rays.
const MAX_TESTED_POINTS: usize = 4096;
/// Distances of the places around a point within which a wall is close: at 5 km, walls within 1 cm gave the light of their other side, and
/// reflected light erred by up to a quarter up to 10 cm before them.
const COARSE_DISTANCES: f32 = 4.0;
/// Coordinates of a point relative to the second largest extent of a face from which on they are coarse for it: that of a wall of a room is
/// 2.5 m, and rooms up to 1.3 km from the middle of a scene had no wrong light.
const COARSE_MAGNITUDE: f32 = 500.0;
/// Fraction of the points for which coordinates are coarse from which on they are told of: of random points on furniture some lie beside
/// very small parts.
const MIN_COARSE_POINTS: f64 = 0.01;

/// Distance of a point from a plane that is rounding of their coordinates, relative to these: of the point, and of the plane's corners.
const ROUNDING: f32 = 4e-7;
/// Smallest cosine between the normals of the faces of one wall, which need not be exactly parallel: within 26 degrees.
const MIN_PARALLEL: f32 = 0.9;

/// Fraction of its way to an emitter at which a ray to it ends, before the emitter's own faces.
const BEFORE_EMITTER: f32 = 0.999;

/// The plane of a face, with the unit normal of its front.
struct Plane {
    corner: Vec3,
    normal: Vec3,
}

impl Plane {
    fn height(&self, place: Vec3) -> f32 {
        self.normal.dot(place - self.corner)
    }

    /// Whether a place lies on the other side than a point. Points within the rounding of coordinates of this `size` lie on the front.
    fn parts(&self, point: Vec3, place: Vec3, size: f32) -> bool {
        let is_in_front = |height: f32| height > -ROUNDING * size;
        is_in_front(self.height(point)) != is_in_front(self.height(place))
    }
}

/// Walls that stand at a point.
struct WallsAt {
    point: Vec3,
    /// Distance of the places around the point, scene units.
    distance: f32,
    /// Instances and edge-connected parts.
    parts: SmallVec<[(u32, u32); 4]>,
}

/// What a place sees of walls at its point.
struct WallsSeen {
    /// Number of [`LANES`] cosine-weighted rays from the place that meet none of the walls, less half of the number of those that meet
    /// their backs, as from below a ground, plus the mean distance to which all rays go, as a fraction of the longest in the scene.
    openness: f32,
    /// Whether none of these rays meets the back of a face whose plane passes within two distances of places of the point.
    is_before: bool,
    /// Whether the place sees the sky, a sun or an emitter.
    is_lit: bool,
}

impl Model {
    /// What `find` returns for the first place around a point for which it finds something: places by the rounding of the point, then by
    /// that of the largest face within `distance` of it; in turn for each of the [`SEARCHES`].
    pub(crate) fn find_around<T>(
        &self,
        point: Vec3,
        normal: Vec3,
        distance: f32,
        find: impl Fn(Vec3, SurfaceSearch) -> Option<T>,
    ) -> Option<T> {
        let own = magnitude([point]);
        let near = |size, search| {
            self.places_of(point, normal, size).into_iter().find_map(|place| find(place, search))
        };
        // No face has much larger coordinates.
        let is_large = own >= MIN_MAGNITUDE * self.magnitude();
        let smallest = if is_large { own } else { self.sizes_around(point, normal, distance)[0] };
        let among_all = |search| {
            near(smallest, search).or_else(|| near(self.sizes_around(point, normal, distance)[1], search))
        };
        SEARCHES.into_iter().find_map(among_all)
    }

    /// The places where the surface of a point is looked for, in this order: the point, then those around it ([`places_around`]). Where
    /// walls stand on the surface at the point, the places come first that lie off all walls before fronts that light reaches directly, as
    /// inside of a hut of sheets on a ground; then others off all walls; of these those of the largest [`WallsSeen::openness`]: on the line
    /// where a box touches a floor, light is that of the floor beside the box, not that of the floor in it.
    /// `size` is the coordinate by whose rounding the places differ, see [`Model::sizes_around`].
    fn places_of(&self, point: Vec3, normal: Vec3, size: f32) -> [Vec3; 9] {
        let distance = edge_distance(size);
        let mut places = places_around(point, normal, distance);
        let lifted = places.map(|place| EndRule::new(size).lifted(place, normal));
        let mut across = Packet::EMPTY;
        // Both ways: where two walls pass between places, a ray meets the nearer one alone.
        for (lane, [a, b]) in AROUND.into_iter().enumerate() {
            across.set_between(lane, lifted[a], lifted[b], [0.0, 1.0]);
            across.set_between(AROUND.len() + lane, lifted[b], lifted[a], [0.0, 1.0]);
        }
        let mut hits = [Hits::NONE];
        self.traced().first_hits(self.widest_packets(), std::slice::from_ref(&across), &mut hits);
        // In a corner each wall counts: from inside of one of them all rays would pass the other.
        let parts: SmallVec<[_; 4]> =
            across.lanes().filter_map(|lane| self.part_met(&hits[0], lane)).collect();
        if parts.is_empty() {
            return places;
        }
        let walls: SmallVec<[Plane; LANES]> =
            across.lanes().filter_map(|lane| self.plane_met(&hits[0], lane)).collect();
        // Rays from a place in a wall may meet it or not, and a wall between a place and its rays belongs to neither side.
        let is_in_wall: [bool; 9] = std::array::from_fn(|k| {
            walls.iter().any(|wall| {
                let [low, high] = [places[k], lifted[k]].map(|at| wall.height(at));
                low.abs().min(high.abs()) < MIN_WALL_DISTANCE * distance || low * high < 0.0
            })
        });
        // Both faces of a thin wall stand between the point and a place in the next room.
        let is_beyond_body: [bool; 9] = std::array::from_fn(|k| {
            let passed: SmallVec<[&Plane; LANES]> =
                walls.iter().filter(|wall| wall.parts(point, lifted[k], size)).collect();
            passed.iter().any(|a| passed.iter().any(|b| a.normal.dot(b.normal) < -MIN_PARALLEL))
        });
        let at = WallsAt { point, distance, parts };
        let seen = lifted.map(|place| self.walls_seen(place, normal, &at));
        let mut order: [usize; 9] = std::array::from_fn(|k| k);
        order.sort_by(|&a, &b| seen[b].openness.total_cmp(&seen[a].openness));
        let rank = |k: usize| match &seen[k] {
            // The point itself lies in the wall.
            _ if k == 0 => 4,
            _ if is_beyond_body[k] => 5,
            // In an acute corner all places of the room may be near a wall: they come before those inside of bodies.
            _ if is_in_wall[k] => 2,
            WallsSeen { is_before: true, is_lit: true, .. } => 0,
            of if of.is_before || of.openness >= 1.0 => 1,
            _ => 3,
        };
        order.sort_by_key(|&k| rank(k));
        places = order.map(|k| places[k]);
        places
    }

    /// The coordinates by whose rounding a point may miss its surface: the larger one of its own and of those of the smallest face within
    /// `distance` of it, as coordinates of the point may be 0; then those of the largest of these faces.
    fn sizes_around(&self, point: Vec3, normal: Vec3, distance: f32) -> [f32; 2] {
        let places = places_around(point, normal, distance);
        let mut packet = Packet::EMPTY;
        for (lane, place) in places.into_iter().enumerate() {
            packet.set_between(lane, place + distance * normal, place - distance * normal, [0.0, 1.0]);
        }
        for (k, ends) in AROUND.into_iter().take(LANES - places.len()).enumerate() {
            let [from, to] = ends.map(|end| places[end] + distance * normal);
            packet.set_between(places.len() + k, from, to, [0.0, 1.0]);
        }
        let mut hits = [Hits::NONE];
        self.traced().first_hits(self.widest_packets(), std::slice::from_ref(&packet), &mut hits);
        let size = |lane: usize| self.face_met(&hits[0], lane).map(magnitude);
        let own = magnitude([point]);
        let sizes = || packet.lanes().filter_map(size);
        [sizes().reduce(f32::min).map_or(own, |smallest| smallest.max(own)), sizes().fold(own, f32::max)]
    }

    /// A point of a face, moved off the edges of the face ([`off_edges`]) by the rounding of its coordinates, unless a wall stands between
    /// the point and that place. `end`: the end rule of the face.
    pub(crate) fn off_edges(&self, face: [Vec3; 3], point: Vec3, normal: Vec3, end: EndRule) -> Vec3 {
        let moved = off_edges(face, point, edge_distance(magnitude(face)));
        if moved == point {
            return point;
        }
        let mut between = Packet::EMPTY;
        between.set_between(0, end.lifted(point, normal), end.lifted(moved, normal), [0.0, 1.0]);
        let mut hits = [Hits::NONE];
        self.traced().first_hits(self.widest_packets(), &[between], &mut hits);
        if hits[0].triangle[0] == Hits::NO_HIT { moved } else { point }
    }

    /// Notes of points, given by their positions and normals, off all surfaces, and so close to walls that coordinates are too coarse.
    #[doc(hidden)]
    pub fn notes_of_points(&self, points: &[(Vec3, Vec3)]) -> Vec<String> {
        self.note_of_free_points(points).into_iter().chain(self.note_of_coarse_points(points)).collect()
    }

    /// A note if points lie so close to walls, but not on them, that rounding of coordinates there decides what light they have.
    fn note_of_coarse_points(&self, points: &[(Vec3, Vec3)]) -> Option<String> {
        let tested: Vec<&(Vec3, Vec3)> =
            points.iter().step_by(points.len().div_ceil(MAX_TESTED_POINTS).max(1)).collect();
        // The distance from a wall within which a point is too close, if there is such a wall.
        let too_close = |&&(point, normal): &&(Vec3, Vec3)| {
            let size = magnitude([point]);
            let reach = COARSE_DISTANCES * edge_distance(size);
            let lift = EndRule::new(size);
            let mut packet = Packet::EMPTY;
            for (lane, place) in places_around(point, normal, reach).into_iter().enumerate().skip(1) {
                packet.set_between(lane, lift.lifted(point, normal), lift.lifted(place, normal), [0.0, 1.0]);
            }
            let mut hits = [Hits::NONE];
            self.traced().first_hits(self.widest_packets(), std::slice::from_ref(&packet), &mut hits);
            let is_coarse = |lane: usize| {
                let Some(face) = self.face_met(&hits[0], lane) else { return false };
                let mut sides = Aabb::of(face).extent().to_array();
                sides.sort_by(f32::total_cmp);
                size > COARSE_MAGNITUDE * sides[1]
                    && self
                        .plane_met(&hits[0], lane)
                        .is_some_and(|wall| wall.height(point).abs() > ROUNDING * size)
            };
            packet.lanes().any(is_coarse).then_some(reach)
        };
        let found: Vec<f32> = parallel::flat_map(&tested, too_close);
        let reach = found.iter().copied().reduce(f32::max)?;
        (found.len() as f64 >= MIN_COARSE_POINTS * tested.len() as f64).then(|| {
            let (unit, percent) = (&self.scene().unit, number(100.0 * found.len() as f64 / tested.len() as f64));
            format!(
                "{percent} % of the points lie within {} {unit} of walls, so far from the middle of the scene that positions there are not known \
                 well enough: they may have the light of the other side of a wall; remove objects far from this part of the scene",
                number(reach.into())
            )
        })
    }

    /// A note if points lie off all surfaces.
    fn note_of_free_points(&self, points: &[(Vec3, Vec3)]) -> Option<String> {
        let reach = FAR_OFF * self.scene().ray_length();
        let misses = |places: &[(Vec3, Vec3)]| {
            let mut packet = Packet::EMPTY;
            for (lane, &(place, normal)) in places.iter().enumerate() {
                packet.set_between(lane, place + reach * normal, place - reach * normal, [0.0, 1.0]);
            }
            let mut hits = [Hits::NONE];
            self.traced().first_hits(self.widest_packets(), &[packet], &mut hits);
            hits[0].triangle.map(|triangle| triangle == Hits::NO_HIT)
        };
        // On an edge or in a corner the places around a point may be on its surface.
        let is_free = |&(at, normal): &(Vec3, Vec3)| {
            misses(&places_around(at, normal, reach).map(|place| (place, normal)))
                .iter()
                .all(|misses| *misses)
        };
        let free_of = |points: &[(Vec3, Vec3)]| {
            let missed = misses(points);
            points.iter().zip(missed).filter(|(point, missed)| *missed && is_free(point)).count()
        };
        let free: usize = parallel::map(parallel::chunks(points, LANES), free_of).into_iter().sum();
        (free > 0).then(|| {
            let some = match points.len() {
                1 => "the point lies".into(),
                all => format!("{free} of {all} points lie"),
            };
            format!(
                "{some} in free space, farther than {} {} from every surface: the results there are for a small plane with the given \
                 normal, as on a work plane",
                number(reach.into()),
                self.scene().unit
            )
        })
    }

    /// The place on the ground above a point, along its normal, and its face, if the point may lie on a face that stands for fine ground:
    /// such faces are below the ground in part. None if something else is below the point, as in a cellar.
    pub(crate) fn ground_above(&self, point: Vec3, normal: Vec3) -> Option<(Vec3, u32)> {
        let scene = self.scene();
        let ground = scene.fine_ground.as_ref()?;
        let mut rays = Packet::EMPTY;
        rays.set_between(0, point, point + ground.highest * normal, [0.0, 1.0]);
        rays.set_between(1, point, point - self.bounds().diagonal() * normal, [0.0, 1.0]);
        let mut hits = [Hits::NONE];
        self.traced().first_hits(self.widest_packets(), std::slice::from_ref(&rays), &mut hits);
        let is_ground =
            |(instance, part): (u32, u32)| instance == 0 && ground.parts.binary_search(&part).is_ok();
        let [above, below] = [0, 1].map(|lane| self.part_met(&hits[0], lane));
        if !above.is_some_and(is_ground) || !below.is_none_or(is_ground) {
            return None;
        }
        let face = hits[0].triangle[0];
        (scene.face_normal(face).dot(normal) > 0.0).then(|| (rays.point(0, hits[0].t[0]), face))
    }

    /// The instance and its edge-connected part that a ray has met.
    fn part_met(&self, hits: &Hits, lane: usize) -> Option<(u32, u32)> {
        let (triangle, instance) = (hits.triangle[lane], hits.instance[lane]);
        let part = || self.mesh_of(instance).triangle_component[triangle as usize];
        (triangle != Hits::NO_HIT).then(|| (instance, part()))
    }

    /// The corners of the face that a ray has met, where it stands.
    fn face_met(&self, hits: &Hits, lane: usize) -> Option<[Vec3; 3]> {
        let (triangle, instance) = (hits.triangle[lane], hits.instance[lane]);
        let transform = || self.instances()[instance as usize].affine();
        let placed = |corner: Vec3| transform().transform_point3(corner.as_dvec3()).as_vec3();
        (triangle != Hits::NO_HIT).then(|| self.mesh_of(instance).corners(triangle).map(placed))
    }

    /// The plane of the face that a ray has met.
    fn plane_met(&self, hits: &Hits, lane: usize) -> Option<Plane> {
        let [corner, ..] = self.face_met(hits, lane)?;
        let (triangle, instance) = (hits.triangle[lane], hits.instance[lane]);
        let normal = self.mesh_of(instance).face_normal(triangle);
        Some(Plane { corner, normal: self.instances()[instance as usize].turned(normal) })
    }

    /// What a place above a surface with this normal sees of the walls at a point near it.
    fn walls_seen(&self, from: Vec3, normal: Vec3, at: &WallsAt) -> WallsSeen {
        let length = self.scene().ray_length();
        let directions: [Vec3; LANES] = std::array::from_fn(|lane| {
            let [u, v, ..] = numbers(0, lane as u64);
            cosine_direction(normal, u, v)
        });
        let mut packets = [Packet::EMPTY; 2];
        for (lane, &direction) in directions.iter().enumerate() {
            packets[0].set_between(lane, from, from + length * direction, [0.0, 1.0]);
        }
        for (lane, to) in self.lights_before(from, normal).into_iter().enumerate() {
            packets[1].set_between(lane, from, to, [0.0, 1.0]);
        }
        let mut hits = [Hits::NONE; 2];
        self.traced().first_hits(self.widest_packets(), &packets, &mut hits);
        let is_free = |packet: usize, lane: usize| hits[packet].triangle[lane] == Hits::NO_HIT;
        let sees_sky = self.scene().sky().is_some_and(|sky| sky.sky().is_some());
        let is_lit = sees_sky && (0..LANES).any(|lane| is_free(0, lane))
            || packets[1].lanes().any(|lane| is_free(1, lane));
        let mut seen = WallsSeen { openness: 0.0, is_before: true, is_lit };
        for (lane, direction) in directions.into_iter().enumerate() {
            let Some((part, wall)) = self.part_met(&hits[0], lane).zip(self.plane_met(&hits[0], lane)) else {
                seen.openness += 1.0 + 1.0 / LANES as f32;
                continue;
            };
            seen.openness += hits[0].t[lane] / LANES as f32;
            if !at.parts.contains(&part) {
                seen.openness += 1.0;
            } else if wall.normal.dot(direction) > 0.0 {
                seen.is_before &= wall.height(at.point).abs() > 2.0 * at.distance;
            }
        }
        seen
    }

    /// Ends of rays from a place above a surface with this normal to suns and to emitters, at most [`LANES`]: they end before the emitters.
    fn lights_before(&self, from: Vec3, normal: Vec3) -> SmallVec<[Vec3; LANES]> {
        let scene = self.scene();
        let suns = scene.sky().map_or(&[][..], |sky| sky.suns());
        let to_suns = suns.iter().map(|sun| from + scene.ray_length() * sun.sample([0.5; 2]).as_vec3());
        let step = scene.emitters.len().div_ceil(LANES).max(1);
        let to_emitters = scene.emitters.iter().step_by(step).filter_map(|emitter| {
            let face = emitter.triangles[emitter.triangles.len() / 2];
            let middle = scene.corners(face).into_iter().sum::<Vec3>() / 3.0;
            let is_front = scene.face_normal(face).dot(from - middle) > 0.0;
            is_front.then(|| from + BEFORE_EMITTER * (middle - from))
        });
        to_suns.chain(to_emitters).filter(|to| (*to - from).dot(normal) > 0.0).take(LANES).collect()
    }
}

#[cfg(test)]
mod tests {
    use crate::model::{Detail, testing::model};
    use crate::scene::testing::{Pieces, facing_up};
    use glam::Vec3;

    #[test]
    fn points_off_all_surfaces_are_counted() {
        let mut pieces = Pieces::empty();
        pieces.grey("floor", 0.5).polygon(&facing_up([0.0, 1.0], [0.0, 1.0], 0.0));
        let model = model(&pieces.scene(), Detail::Rays);
        let at = |x: f32, z: f32| (Vec3::new(x, 0.5, z), Vec3::Z);
        // On the floor, on its edge and within a thousandth of the diagonal above it.
        let on = [at(0.3, 0.0), at(1.0, 0.0), at(0.3, 1e-3)];
        assert_eq!(model.note_of_free_points(&on), None);
        let free = [at(0.3, 0.1), at(1.1, 0.0)];
        let note = model.note_of_free_points(&[&on[..], &free].concat()).expect("a note");
        assert!(note.starts_with("2 of 5 points lie in free space"), "{note}");
    }
}
