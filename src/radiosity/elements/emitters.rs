//! Emitting faces: closed forms use all faces of an emitter, single rays use one face drawn at random.

use super::emitter_tree::{Cut, EmitterTree, Receiver, power_of};
use super::profiles::profile_factor;
use super::{Elements, Shape};
use crate::form_factors::analytic::point_to_polygon;
use crate::math::sampling::point_on;
use crate::radiosity::rgb::{Rgb, mean};
use crate::scene::{Profile, Scene};
use glam::{DVec3, Vec3};
use std::{collections::HashMap, sync::Arc};

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
    /// Exitance, W/m².
    pub exitance: Rgb,
    /// Area, scene units squared.
    pub area: f32,
    /// Directions in which the face emits; none for diffuse emission.
    pub profile: Option<Arc<Profile>>,
}

impl EmitterFace {
    /// Form factor from a point (position, unit normal) to the face: of a diffuse face in closed form, of one with a profile
    /// with its radiance relative to a diffuse face as weight.
    pub fn factor(&self, at: DVec3, normal: DVec3) -> f64 {
        match &self.profile {
            None => point_to_polygon(at, normal, &self.polygon[..self.count]).max(0.0),
            Some(profile) => profile_factor(profile, (at, normal), &self.polygon[..self.count]),
        }
    }
}

/// One emitter of the scene.
pub struct Emitter {
    /// Its lit faces.
    pub faces: Vec<EmitterFace>,
    /// Its smallest width, scene units.
    pub width: f32,
}

/// All emitters of a scene.
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
    /// By side, the place of its face in that order; [`Elements::NONE`] for sides that do not emit.
    place_of_side: Vec<u32>,
}

impl Emitters {
    /// The emitters of a scene, with the lit sides of their faces.
    pub fn new(scene: &Scene, elements: &Elements) -> Emitters {
        let mut emitters: Vec<Emitter> =
            scene.emitters.iter().map(|e| Emitter { faces: Vec::new(), width: e.min_width }).collect();
        let mut lit: Vec<(u32, u32)> = Vec::new();
        let mut side_of = HashMap::new();
        for (s, side) in (0u32..).zip(&elements.sides).filter(|(_, s)| s.exitance.iter().any(|&m| m > 0.0)) {
            let element = &elements.elements[side.element as usize];
            let Shape::Surface { corners, .. } = element.shape else { continue };
            let emitter = scene.triangle_emitter[side.triangles[0] as usize];
            let faces = &mut emitters[emitter as usize].faces;
            lit.push((emitter, faces.len() as u32));
            side_of.insert((emitter, faces.len() as u32), s);
            faces.push(EmitterFace {
                corners,
                polygon: corners.map(|p| p.as_dvec3()),
                count: if corners[2] == corners[3] { 3 } else { 4 },
                normal: side.normal,
                exitance: side.exitance,
                area: element.area as f32,
                profile: side.profile.clone(),
            });
        }
        let face = |(e, k): (u32, u32)| &emitters[e as usize].faces[k as usize];
        let tree =
            EmitterTree::build(&mut lit, &|f| face(f).corners, &|f| (face(f).normal, power_of(face(f))));
        let mut power = 0.0;
        let powers = lit.iter().map(|&f| {
            power += power_of(face(f));
            power
        });
        let powers = powers.collect();
        let mut place_of_side = vec![Elements::NONE; elements.sides.len()];
        for (place, f) in (0u32..).zip(&lit) {
            place_of_side[side_of[f] as usize] = place;
        }
        let width = emitters.iter().map(|e| e.width).fold(f32::MAX, f32::min);
        Emitters { width, tree, lit, powers, place_of_side, emitters }
    }

    /// Finds the groups of faces that a receiver draws from.
    pub fn cut(&self, receiver: &Receiver, cut: &mut Cut) {
        self.tree.cut(receiver, cut);
    }

    /// The faces that light the receiver of a cut, if they are so few that the cut has a node for each.
    pub fn faces<'c>(&'c self, cut: &'c Cut) -> Option<impl Iterator<Item = &'c EmitterFace> + 'c> {
        let face = |place: u32| {
            let (e, k) = self.lit[place as usize];
            &self.emitters[e as usize].faces[k as usize]
        };
        self.tree.faces(cut).map(|places| places.map(face))
    }

    /// The cut for receivers that are not known: faces are drawn by power.
    pub fn any_receiver(&self) -> Cut {
        self.tree.whole()
    }

    /// A point on an emitter for two numbers in `[0, 1)`, its face, and the density of the point on the face over the face's
    /// exitance (mean over the channels). None if no emitter can light the receiver.
    pub fn sample(&self, cut: &Cut, u: f32, v: f32) -> Option<(Vec3, &EmitterFace, f32)> {
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
        let face = &self.emitters[e as usize].faces[k as usize];
        Some((point_on(&face.corners, u, v), face, density))
    }

    /// The density of [`Emitters::sample`] at a point of a side over the side's exitance.
    pub fn density(&self, cut: &Cut, side: u32) -> f32 {
        match self.place_of_side[side as usize] {
            Elements::NONE => 0.0,
            place => self.tree.probability(cut, place),
        }
    }
}

/// The density with which a cosine-weighted ray from `from` finds the point `to` of an emitter, divided by the density of
/// [`Emitters::sample`]; both are (position, unit normal). Both strategies find the point. Weighted by their densities
/// (balance heuristic, Veach and Guibas 1995) each contributes less than the emitter's exitance at any distance.
pub fn density_ratio(from: (Vec3, Vec3), to: (Vec3, Vec3), exitance: Rgb, density: f32) -> f32 {
    let d = to.0 - from.0;
    let r2 = d.length_squared().max(f32::MIN_POSITIVE);
    // Two divisions by r²: r⁴ overflows 32 bits for most lengths.
    let kernel = (from.1.dot(d).max(0.0) / r2) * ((-to.1.dot(d)).max(0.0) / r2) / std::f32::consts::PI;
    kernel / (density * mean(exitance) as f32)
}
