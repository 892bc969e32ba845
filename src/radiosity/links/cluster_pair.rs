//! The unoccluded exchange of two elements of which at least one is a cluster: the mean over sixteen points of each end, drawn with a
//! preference for sides that face the other end, and no more than the smaller area allows.

use super::accuracy::{Accuracy, FEW_SEGMENTS_ERROR, LinkDraft};
use super::end_samples::{EndSamples, kernel};
use super::surface_pair::LAMBERT_DISTANCE;
use super::{BlockerCertificate, VisibilityQuery};
use crate::form_factors::analytic::point_to_polygon;
use crate::math::Aabb;
use crate::math::sampling::mix;
use crate::radiosity::elements::{Element, Elements, Shape, facing};
use crate::radiosity::options::Inside;
use crate::ray::{LANES, Packet};
use glam::Vec3;

/// Relative deviation of the exchange over a cluster whose sides face a direction only on average. Half or twice as
/// much change irradiance without a local pass by less than 0.07 % (`constants.py solve`).
pub(super) const CLUSTER_DEVIATION: f32 = 0.3;
/// Smallest distance between points in units of the sum of the radii; shorter ones are clamped: clusters overlap, and
/// the kernel of two points of theirs is unbounded. Half or twice as much change irradiance without a local pass by
/// less than 0.1 % (`constants.py solve`).
const MIN_DISTANCE: f32 = 0.2;
/// Largest unoccluded exchange as a fraction of the smaller area; a form factor is at most 1. 0.8 or 1 instead change
/// irradiance by less than 0.001 % (`constants.py solve`).
const MAX_FORM_FACTOR: f32 = 0.9;
/// Largest ratio of diameter to distance in the deviation, which keeps the error of overlapping clusters finite. 2 or 8
/// instead change irradiance without a local pass by less than 0.08 % (`constants.py solve`).
const MAX_NEARNESS: f32 = 4.0;
/// [`FEW_SEGMENTS_ERROR`] for clusters, halved: their samples vary for other reasons than visibility.
const FEW_SEGMENTS_CLUSTER_ERROR: f32 = 0.5 * FEW_SEGMENTS_ERROR;
/// Smallest projected area of a surface as a fraction of its area in the model that the error oracle reads. 0.1 or 0.4
/// instead change irradiance without a local pass by less than 0.04 % (`constants.py solve`).
const MIN_PROJECTED_SURFACE: f32 = 0.2;
/// The same for clusters: flat clusters seen edge-on, as a wall with a door is from the next room, exchange some light.
/// 0.05 or 0.2 instead change irradiance without a local pass by 0.01 % or 0.15 % (`constants.py solve`).
const MIN_PROJECTED_CLUSTER: f32 = 0.1;

/// Two elements of which at least one is a cluster.
pub(super) struct ClusterPair<'a> {
    pub ids: [u32; 2],
    pub ends: [&'a Element; 2],
    pub inside: Inside,
}

impl ClusterPair<'_> {
    /// The link without visibility, and the query for sixteen or four segments.
    pub fn draft(
        &self,
        elements: &Elements,
        accuracy: Accuracy,
        seed: u64,
    ) -> Option<(LinkDraft, VisibilityQuery)> {
        let [ea, eb] = self.ends;
        let towards = (eb.centre - ea.centre).normalize_or(Vec3::X);
        let from = EndSamples::draw(elements, self.ids[0], towards, 0, seed);
        let to = EndSamples::draw(elements, self.ids[1], -towards, 1, mix(seed));
        let weights = self.kernels(&from, &to);
        let distance = (eb.centre - ea.centre).length();
        let max = MAX_FORM_FACTOR * ea.area.min(eb.area) as f32;
        let exchanges = self.exchanges(elements, &from, &to, &weights);
        let free = (exchanges.iter().sum::<f32>() / LANES as f32).min(max);
        // The error oracle reads a model of the exchange without noise: otherwise overestimates would be refined and
        // underestimates kept.
        let model = (projected_area(elements, ea, towards) * projected_area(elements, eb, -towards)
            / (std::f32::consts::PI * distance.max(0.5 * (ea.radius + eb.radius)).powi(2)))
        .min(max);
        let deviation = [ea, eb].map(|e| {
            let near = (2.0 * e.radius / distance.max(1e-6 * e.radius)).min(MAX_NEARNESS);
            let rough = if e.is_cluster() { CLUSTER_DEVIATION } else { 0.0 };
            model * near.hypot(rough)
        });
        let few = accuracy.worth * model * accuracy.deviation < FEW_SEGMENTS_CLUSTER_ERROR;
        let mut packet = accuracy.segments(few, &weights, seed, |l| {
            let of = |end: &EndSamples| (end.points[l], end.normals[l], end.rules[l]);
            [of(&from), of(&to)]
        });
        // Without a sample the exchange is probably 0; where an error would matter, the link is kept so that its parts can be measured.
        if packet.is_empty() && free <= 0.0 && accuracy.worth * deviation[0].max(deviation[1]) <= 1.0 {
            return None;
        }
        if self.inside != Inside::Visible {
            let ends = if accuracy.first_receives { [ea, eb] } else { [eb, ea] };
            for (k, end) in ends.into_iter().enumerate() {
                let Shape::Cluster(c) = end.shape else { continue };
                shorten_to_box(&elements.clusters[c as usize].bounds, &mut packet, k);
            }
        }
        let draft = LinkDraft {
            ids: self.ids,
            swapped: false,
            free,
            scale: model,
            deviation,
            weights,
            certificate: BlockerCertificate::UNKNOWN,
        };
        Some((draft, accuracy.query(packet, [ea.radius, eb.radius])))
    }

    /// Unoccluded exchange area by each pair of points: by its kernel in `weights`, or by Lambert's formula from one point to all of the
    /// surface on which the other lies, if that surface is large compared with the distance. Few points of a floor would miss the place
    /// below a small lamp.
    fn exchanges(
        &self,
        elements: &Elements,
        from: &EndSamples,
        to: &EndSamples,
        weights: &[f32; LANES],
    ) -> [f32; LANES] {
        if self.inside == Inside::Isotropic {
            return *weights;
        }
        let surface = |k: usize, side: u32| match self.ends[k].shape {
            Shape::Surface { .. } => self.ends[k],
            Shape::Cluster(_) => &elements.elements[elements.sides[side as usize].element as usize],
        };
        std::array::from_fn(|l| {
            let [of_a, of_b] = [surface(0, from.sides[l]), surface(1, to.sides[l])];
            let (start, large) = if of_a.area < of_b.area { (from, of_b) } else { (to, of_a) };
            let (at, normal) = (start.points[l], start.normals[l]);
            let Shape::Surface { corners, .. } = large.shape else { return weights[l] };
            if (at - large.centre).length() >= LAMBERT_DISTANCE * large.radius {
                return weights[l];
            }
            let polygon = corners.map(|p| p.as_dvec3());
            let polygon = if corners[2] == corners[3] { &polygon[..3] } else { &polygon[..] };
            let factor = point_to_polygon(at.as_dvec3(), normal.as_dvec3(), polygon).max(0.0);
            (factor / large.area) as f32 / from.density[l] / to.density[l]
        })
    }

    /// Kernel of each pair of points over the densities of the points.
    fn kernels(&self, from: &EndSamples, to: &EndSamples) -> [f32; LANES] {
        let [ea, eb] = self.ends;
        let nearest = MIN_DISTANCE * (ea.radius + eb.radius);
        let isotropic = [ea, eb].map(|e| self.inside == Inside::Isotropic && e.is_cluster());
        std::array::from_fn(|l| {
            let facing = [
                if isotropic[0] { None } else { Some(from.normals[l]) },
                if isotropic[1] { None } else { Some(to.normals[l]) },
            ];
            kernel(from.points[l], facing[0], to.points[l], facing[1], nearest)
                / from.density[l]
                / to.density[l]
        })
    }
}

/// Shortens segments to the parts outside the box of a cluster in which they start (`end` 0) or end (1).
pub(super) fn shorten_to_box(bounds: &Aabb, packet: &mut Packet, end: usize) {
    for lane in packet.lanes() {
        let (o, d) = (packet.point(lane, 0.0), packet.point(lane, 1.0) - packet.point(lane, 0.0));
        // Parameters at which the line enters and leaves the box. Axes that the line is perpendicular to are omitted:
        // on a face of the box their quotient would be 0/0.
        let (mut enters, mut leaves) = (f32::MIN, f32::MAX);
        for axis in (0..3).filter(|&axis| d[axis] != 0.0) {
            let first = (bounds.min[axis] - o[axis]) / d[axis];
            let last = (bounds.max[axis] - o[axis]) / d[axis];
            enters = enters.max(first.min(last));
            leaves = leaves.min(first.max(last));
        }
        let (near, far) = (packet.near[lane], packet.far[lane]);
        if end == 0 {
            packet.near[lane] = leaves.max(near).min(far);
        } else {
            packet.far[lane] = enters.max(near).min(far);
        }
    }
}

/// Projected area of an element towards a direction, scene units squared.
fn projected_area(elements: &Elements, e: &Element, towards: Vec3) -> f32 {
    match &e.shape {
        Shape::Surface { side, .. } => {
            e.area as f32 * elements.sides[*side as usize].normal.dot(towards).max(MIN_PROJECTED_SURFACE)
        }
        Shape::Cluster(c) => {
            let projected = elements.clusters[*c as usize].projected;
            let seen: f32 = facing(towards).into_iter().zip(projected).map(|(f, p)| f * p as f32).sum();
            seen.max(MIN_PROJECTED_CLUSTER * e.area as f32)
        }
    }
}
