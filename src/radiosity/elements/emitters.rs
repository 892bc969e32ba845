//! Emitting faces: closed forms use all faces of an emitter, single rays use one face drawn at random.

use super::emitter_tree::{EmitterCut, EmitterTree, Receiver};
use super::profiles::profile_factor;
use super::{Elements, Side};
use crate::form_factors::analytic::{point_to_far_polygon, point_to_polygon};
use crate::math::sampling::point_on;
use crate::radiosity::rgb::{Rgb, mean};
use crate::ray::EndRule;
use crate::scene::{Profile, Scene};
use glam::{DVec3, Vec3};
use rustc_hash::FxHashMap;
use std::sync::Arc;

/// One emitter of the scene.
#[derive(Default)]
pub struct Emitter {
    /// Its lit faces.
    pub faces: Vec<EmitterFace>,
    /// Its smallest width, scene units.
    pub width: f32,
}

/// A lit face with a number that the caller assigns.
pub struct NumberedFace {
    /// Index of its emitter.
    pub emitter: u32,
    /// Index among the faces of the emitter.
    pub face: u32,
    /// The number.
    pub number: u32,
}

/// The emitters, and the tables from which their faces are drawn.
pub struct Emitters {
    /// In the order of the scene.
    pub emitters: Vec<Emitter>,
    /// The smallest width of all, scene units.
    pub width: f32,
    /// The tree over all lit faces.
    tree: EmitterTree,
    /// Every lit face as (emitter, face) in the order of the tree, with the running sums of the faces' power over π.
    lit: Vec<(u32, u32)>,
    powers: Vec<f32>,
    /// By number of a face, its place in that order; [`Elements::NONE`] for numbers without a face.
    places: Vec<u32>,
    is_even: bool,
}

/// Largest exitance of a face, relative to the mean by area, up to which emitters count as evenly bright: a ray that is drawn by the
/// cosine then meets each face at least half as often as its light asks for.
const MAX_EXITANCE_RATIO: f32 = 2.0;

/// Smallest distance of points from the rim of a face, in bounds of the rounding errors of its coordinates: twice the length that
/// segments leave out at ends on unknown surfaces.
const MIN_RIM_DISTANCE: f32 = 32.0;
/// Largest fraction of the way to the middle by which points keep away from the rim, for faces that are small against the rounding
/// errors of their place: points are then in 0.9² = 81 % of the face.
const MAX_RIM_FRACTION: f32 = 0.1;

impl Emitters {
    /// The emitters of a scene, with the lit sides of their faces, which have the numbers of the sides.
    pub fn new(scene: &Scene, elements: &Elements) -> Emitters {
        let mut emitters: Vec<Emitter> =
            scene.emitters.iter().map(|e| Emitter { faces: Vec::new(), width: e.min_width }).collect();
        let mut sides = Vec::new();
        for (s, side) in (0u32..).zip(&elements.sides).filter(|(_, s)| s.exitance.iter().any(|&m| m > 0.0)) {
            let corners = *elements.corners(side);
            let emitter = scene.triangle_emitter[side.triangles[0] as usize];
            let faces = &mut emitters[emitter as usize].faces;
            sides.push(NumberedFace { emitter, face: faces.len() as u32, number: s });
            let area = elements.elements[side.element as usize].area as f32;
            let face = EmitterFace::new(corners, side, side.exitance, area);
            faces.push(EmitterFace { profile: side.profile.clone(), ..face });
        }
        Emitters::of(emitters, sides, elements.sides.len())
    }

    /// Emitters, of whose faces `numbered` lists each once, with numbers below `count`.
    pub fn of(emitters: Vec<Emitter>, numbered: Vec<NumberedFace>, count: usize) -> Emitters {
        let mut lit: Vec<(u32, u32)> = numbered.iter().map(|f| (f.emitter, f.face)).collect();
        let face = |(e, k): (u32, u32)| &emitters[e as usize].faces[k as usize];
        let tree =
            EmitterTree::build(&mut lit, &|f| face(f).corners, &|f| (face(f).normal, power_of(face(f))));
        let mut power = 0.0;
        let powers = lit.iter().map(|&f| {
            power += power_of(face(f));
            power
        });
        let powers: Vec<f32> = powers.collect();
        let faces = || lit.iter().map(|&f| face(f));
        let area: f32 = faces().map(|face| face.area).sum();
        let sent: f32 = faces().map(|face| face.area * mean(face.exitance) as f32).sum();
        let is_even = faces()
            .all(|f| f.profile.is_none() && mean(f.exitance) as f32 * area <= MAX_EXITANCE_RATIO * sent);
        let mut places = vec![Elements::NONE; count];
        let place: FxHashMap<(u32, u32), u32> = lit.iter().copied().zip(0..).collect();
        numbered.iter().for_each(|f| places[f.number as usize] = place[&(f.emitter, f.face)]);
        let width = emitters.iter().map(|e| e.width).fold(f32::MAX, f32::min);
        Emitters { width, tree, lit, powers, places, is_even, emitters }
    }

    /// Whether all faces are diffuse and none is brighter than [`MAX_EXITANCE_RATIO`] times the mean by area: few cosine-weighted rays
    /// would miss a small bright face.
    pub fn is_even(&self) -> bool {
        self.is_even
    }

    /// Finds the groups of faces that a receiver draws from.
    pub fn cut(&self, receiver: &Receiver, cut: &mut EmitterCut) {
        self.tree.cut(receiver, cut);
    }

    /// The faces that light the receiver of a cut, if they are so few that the cut has a node for each.
    pub fn faces<'c>(&'c self, cut: &'c EmitterCut) -> Option<impl Iterator<Item = &'c EmitterFace> + 'c> {
        self.tree.faces(cut).map(|places| places.map(|place| self.face(place)))
    }

    /// Those of [`Emitters::faces`] that a ray would meet if nothing blocked it, with the point and the density of [`Emitters::sample`]
    /// there over the face's exitance. The face with the number `met` is one of them also where rounding errors at its edges say
    /// otherwise.
    pub fn faces_along<'c>(
        &'c self,
        cut: &'c EmitterCut,
        [from, to]: [Vec3; 2],
        met: u32,
    ) -> impl Iterator<Item = (&'c EmitterFace, Vec3, f32)> + 'c {
        let met = self.places.get(met as usize).copied().unwrap_or(Elements::NONE);
        self.tree.faces(cut).into_iter().flatten().filter_map(move |place| {
            let face = self.face(place);
            let at = face.point_on_plane(from, to)?;
            (place == met || face.contains(at)).then(|| (face, at, self.tree.probability(cut, place)))
        })
    }

    /// A face by its place in the order of the tree.
    fn face(&self, place: u32) -> &EmitterFace {
        let (e, k) = self.lit[place as usize];
        &self.emitters[e as usize].faces[k as usize]
    }

    /// See [`EmitterTree::variation`].
    pub fn variation(&self, receiver: &Receiver, area: f32, limit: f32) -> f32 {
        self.tree.variation(receiver, area, limit)
    }

    /// A point on an emitter for two numbers in `[0, 1)`, the emitter and its face, and the density of the point on the face over the
    /// face's exitance (mean over the channels). None if no emitter can light the receiver.
    pub fn sample(&self, cut: &EmitterCut, u: f32, v: f32) -> Option<(Vec3, [usize; 2], f32)> {
        let ([first, end], u, density) = self.tree.draw(cut, u)?;
        let (first, end) = (first as usize, end as usize);
        // The face of the group by power: the part of the running sums that belongs to the group.
        let before = if first > 0 { self.powers[first - 1] } else { 0.0 };
        let target = before + u * (self.powers[end - 1] - before);
        let f = first + self.powers[first..end].partition_point(|&s| s <= target).min(end - first - 1);
        let below = if f > 0 { self.powers[f - 1] } else { 0.0 };
        // A face may be too weak to change the running sum.
        let own = (self.powers[f] - below).max(f32::MIN_POSITIVE);
        let u = ((target - below) / own).clamp(0.0, 1.0);
        let (e, k) = self.lit[f];
        let [e, k] = [e as usize, k as usize];
        let face = &self.emitters[e].faces[k];
        Some((face.off_the_rim(point_on(&face.corners, u, v)), [e, k], density))
    }

    /// The density of [`Emitters::sample`] at a point of the face with a number over the face's exitance.
    pub fn density(&self, cut: &EmitterCut, number: u32) -> f32 {
        match self.places[number as usize] {
            Elements::NONE => 0.0,
            place => self.tree.probability(cut, place),
        }
    }
}

/// The density with which a cosine-weighted ray from `from` finds the point `to` of an emitter, divided by the density of
/// [`Emitters::sample`]. Normals have unit length. Both strategies find the point. Weighted by their densities
/// (balance heuristic, Veach and Guibas 1995) each contributes less than the emitter's exitance at any distance. 0 if either point lies
/// less than `rounding` above the plane of the other, as the back of a lamp lies in the plane of its front.
pub fn density_ratio(
    from: Vec3,
    from_normal: Vec3,
    to: Vec3,
    to_normal: Vec3,
    rounding: f32,
    exitance: Rgb,
    density: f32,
) -> f32 {
    let d = to - from;
    if from_normal.dot(d) <= rounding || -to_normal.dot(d) <= rounding {
        return 0.0;
    }
    let r2 = d.length_squared().max(f32::MIN_POSITIVE);
    // Two divisions by r²: r⁴ overflows 32 bits for most lengths.
    let kernel =
        (from_normal.dot(d).max(0.0) / r2) * ((-to_normal.dot(d)).max(0.0) / r2) / std::f32::consts::PI;
    kernel / (density * mean(exitance) as f32)
}

/// One emitting face.
pub struct EmitterFace {
    /// Counterclockwise seen from its side; a triangle repeats its third corner.
    pub corners: [Vec3; 4],
    /// The same corners in double precision, for closed forms.
    pub polygon: [DVec3; 4],
    /// Number of distinct corners: 3 or 4.
    pub count: usize,
    /// Unit normal.
    pub normal: Vec3,
    /// The rule for ends of segments on the face.
    pub end: EndRule,
    /// Exitance, W/m².
    pub exitance: Rgb,
    /// Area, scene units squared.
    pub area: f32,
    /// Directions in which the face emits; none for diffuse emission.
    pub profile: Option<Arc<Profile>>,
    /// Fraction of the way to the middle of the face by which points on it are moved.
    to_middle: f32,
}

impl EmitterFace {
    /// A diffuse face on a side of a surface; its area in scene units squared.
    pub fn new(corners: [Vec3; 4], side: &Side, exitance: Rgb, area: f32) -> EmitterFace {
        let count = if corners[2] == corners[3] { 3 } else { 4 };
        let next = corners.iter().cycle().skip(1);
        let longest = corners.iter().zip(next).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
        // The middle of a parallelogram is at least area / longest / 2 from the rim, that of a triangle 2/3 of area / longest.
        let to_middle = (2.0 * MIN_RIM_DISTANCE * side.end.slack() * longest / area).min(MAX_RIM_FRACTION);
        EmitterFace {
            corners,
            polygon: corners.map(|p| p.as_dvec3()),
            count,
            normal: side.normal,
            end: side.end,
            exitance,
            area,
            profile: None,
            to_middle,
        }
    }

    /// A point of the face, moved away from the rim: a ray that ends at an edge which lies on a wall would otherwise come through the wall.
    pub fn off_the_rim(&self, at: Vec3) -> Vec3 {
        let middle = self.corners[..self.count].iter().sum::<Vec3>() / self.count as f32;
        at + self.to_middle * (middle - at)
    }

    /// Where a ray through two points meets the plane of the face from its lit side.
    fn point_on_plane(&self, from: Vec3, to: Vec3) -> Option<Vec3> {
        let (height, slope) = (self.normal.dot(from - self.corners[0]), self.normal.dot(to - from));
        (height > 0.0 && slope < 0.0).then(|| from - height / slope * (to - from))
    }

    /// Whether a point of its plane lies on the face.
    fn contains(&self, at: Vec3) -> bool {
        let corners = &self.corners[..self.count];
        let next = corners.iter().cycle().skip(1);
        corners.iter().zip(next).all(|(a, b)| (*b - *a).cross(at - *a).dot(self.normal) >= 0.0)
    }

    /// Form factor from a point (position, unit normal) to the face: of a diffuse face in closed form, or by quadrature to 0.1 % if it is
    /// far; of one with a profile with its radiance relative to a diffuse face as weight.
    pub fn factor(&self, at: DVec3, normal: DVec3) -> f64 {
        let polygon = &self.polygon[..self.count];
        match &self.profile {
            None => {
                let far = point_to_far_polygon(at, normal, polygon);
                far.unwrap_or_else(|| point_to_polygon(at, normal, polygon)).max(0.0)
            }
            Some(profile) => profile_factor(profile, at, normal, polygon),
        }
    }
}

/// Power of a face over π, W/π.
pub fn power_of(face: &EmitterFace) -> f32 {
    face.area * mean(face.exitance) as f32
}
