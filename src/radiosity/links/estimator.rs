//! Measures links: the unoccluded exchange first, then visibility for all pairs together.

use super::accuracy::{Accuracy, LinkDraft};
use super::cluster_pair::ClusterPair;
use super::surface_pair::SurfacePair;
use super::{BlockerCertificate, Link, Scratch, VisibilityEngine, VisibilityQuery};
use crate::math::sampling::mix;
use crate::radiosity::elements::{Element, Elements, Shape};
use crate::radiosity::options::Inside;
use crate::ray::{LANES, Packet};
use glam::Vec3;

/// Measures links.
#[derive(Clone, Copy)]
pub struct LinkEstimator<'a> {
    /// The elements.
    pub elements: &'a Elements,
    /// The visibility engine.
    pub engine: &'a VisibilityEngine,
    /// Seed of all samples.
    pub seed: u64,
    /// How light is treated inside clusters.
    pub inside: Inside,
}

impl LinkEstimator<'_> {
    /// The link between two elements of which neither contains the other; none if they do not face each other.
    #[cfg(test)]
    pub fn measure(&self, a: u32, b: u32, accuracy: Accuracy, scratch: &mut Scratch) -> Option<Link> {
        self.measure_all(&[([a, b], accuracy)], scratch).pop()
    }

    /// The links of pairs of elements of which neither contains the other, in the order of the pairs, without the pairs
    /// that do not face each other. All queries go to the visibility engine together.
    pub fn measure_all(&self, pairs: &[([u32; 2], Accuracy)], scratch: &mut Scratch) -> Vec<Link> {
        let mut links = Vec::with_capacity(pairs.len());
        let (mut drafts, mut queries) = (Vec::with_capacity(pairs.len()), Vec::with_capacity(pairs.len()));
        for &([a, b], accuracy) in pairs {
            let Some((draft, query)) = self.draft(a, b, accuracy) else { continue };
            links.push(draft.link(&Packet::EMPTY, &[0.0; LANES]));
            if !query.packet.is_empty() {
                drafts.push((links.len() - 1, draft));
                queries.push(query);
            } else if draft.certificate == BlockerCertificate::CLEAR {
                scratch.tally.clear += 1;
            }
        }
        self.engine.answer_all(&queries, scratch, |k, transmittances| {
            let (place, draft) = &drafts[k];
            links[*place] = draft.link(&queries[k].packet, transmittances);
        });
        links
    }

    /// The link of a pair without visibility, and the query for its visibility.
    pub fn draft(&self, a: u32, b: u32, accuracy: Accuracy) -> Option<(LinkDraft, VisibilityQuery)> {
        // Equal samples for both orders of the ends.
        if self.elements.elements[a as usize].ids > self.elements.elements[b as usize].ids {
            let accuracy = Accuracy { first_receives: !accuracy.first_receives, ..accuracy };
            let (draft, query) = self.draft(b, a, accuracy)?;
            return Some((LinkDraft { swapped: true, ..draft }, query));
        }
        let [ea, eb] = [a, b].map(|e| &self.elements.elements[e as usize]);
        if ea.area <= 0.0
            || eb.area <= 0.0
            || is_behind(self.elements, ea, eb)
            || is_behind(self.elements, eb, ea)
        {
            return None;
        }
        let seed =
            mix(self.seed ^ mix(ea.ids[0].min(eb.ids[0])) ^ mix(ea.ids[0].max(eb.ids[0])).rotate_left(17));
        match (&ea.shape, &eb.shape) {
            (Shape::Surface { side: sa, corners: ca }, Shape::Surface { side: sb, corners: cb }) => {
                let sides = [sa, sb].map(|&s| &self.elements.sides[s as usize]);
                let (normals, rules) = (sides.map(|s| s.normal), sides.map(|s| s.end));
                SurfacePair { ids: [a, b], ends: [ea, eb], corners: [ca, cb], normals, rules }.draft(
                    self.elements,
                    accuracy,
                    seed,
                )
            }
            _ => ClusterPair { ids: [a, b], ends: [ea, eb], inside: self.inside }.draft(
                self.elements,
                accuracy,
                seed,
            ),
        }
    }
}

/// Height above a plane, relative to the radii, up to which an element counts as behind it: 170 roundings of f32 (2⁻²⁴)
/// of coordinates that may be larger than the radii. 1e-6 or 1e-4 instead change irradiance by less than 0.001 %
/// (`constants.py solve`).
const COPLANAR: f32 = 1e-5;

/// Whether all of `other` lies behind a surface.
pub(super) fn is_behind(elements: &Elements, surface: &Element, other: &Element) -> bool {
    let Shape::Surface { side, corners } = &surface.shape else { return false };
    let normal = elements.sides[*side as usize].normal;
    let height = |p: Vec3| normal.dot(p - corners[0]);
    let highest = match &other.shape {
        Shape::Surface { corners, .. } => corners.iter().map(|&p| height(p)).fold(f32::MIN, f32::max),
        Shape::Cluster(c) => {
            let bounds = elements.clusters[*c as usize].bounds;
            height(Vec3::select(normal.cmpgt(Vec3::ZERO), bounds.max, bounds.min))
        }
    };
    highest <= COPLANAR * (surface.radius + other.radius)
}
