//! Optics of groups of instances, measured on the clusters of their meshes.
//!
//! A group represents each instance by a few boxes with extinction, a cut through the cluster tree of its mesh, and each
//! group inside it by its box with the extinction that was measured: measuring takes O(children), not O(instances). The
//! group is measured like a cluster of triangles (docs/method.md, Groups of instances), except that a pixel transmits
//! exp(-Σ κ l) over the boxes behind it instead of all or nothing. Blocker sizes are conservative: a pixel counts as
//! blocked if it loses more than `MIN_LOSS`, although the contents of a box may leave gaps.

use super::axes::{AXIS_COUNT, AxisMix, view};
use super::silhouette::Silhouette;
use super::{ClusterOptics, Extinction, Options, SOLID_DEPTH, Scratch};
use crate::clusters::{Hierarchy, Tree};
use crate::math::Aabb;
use glam::{Affine3A, Vec2, Vec3};

/// Largest number of boxes that represent an instance, per cluster tree of its mesh: one node of the hierarchy opened
/// completely ([`crate::clusters::FAN_OUT`]); limits the work of a projection.
const MAX_PARTS: usize = 16;
/// Pixels across the longer side of a group's projection: half of [`super::silhouette`]'s as for leaves, which hold as
/// few parts as an instance has boxes.
const GROUP_PIXELS: usize = 32;
/// Loss of transmittance above which a pixel counts as blocked. Equals the default tolerance of cluster optics.
const MIN_LOSS: f32 = 0.05;
/// Feature size of boxes that may not be averaged, scene units. Finite, because a weight of zero times infinity is no number.
const NEVER_AVERAGED: f32 = 1e30;
/// Largest loss of a pixel that boxes smaller than a pixel make: e^-7 passes, as through a solid surface.
const MAX_PIXEL_LOSS: f32 = 0.999;

/// A box with extinction, in the frame of its mesh.
///
/// Its extinction is uniform: the density slope that a cluster of triangles has is left out, because groups are opened long
/// before feature sizes resolve the inside of a mesh.
#[derive(Clone, Debug)]
pub struct Part {
    /// The box that path lengths are measured in.
    bounds: Aabb,
    /// Extinction along each axis, 1/length.
    extinction: [f32; AXIS_COUNT],
    /// Feature size along each axis, length: no group that holds the box has a smaller one.
    feature_size: [f32; AXIS_COUNT],
}

/// The boxes that represent an instance of a mesh in groups: the largest clusters are opened first.
pub fn parts(hierarchy: &Hierarchy, optics: &[ClusterOptics]) -> Vec<Part> {
    let cut = |tree: &Tree| -> Vec<usize> {
        let volume = |c: &usize| tree.clusters[*c].bounds.thickened().volume();
        let mut cut: Vec<usize> = if tree.clusters.is_empty() { Vec::new() } else { vec![0] };
        while let Some(largest) = (0..cut.len())
            .filter(|&i| {
                let cluster = &tree.clusters[cut[i]];
                !cluster.is_leaf() && cut.len() + cluster.children as usize <= MAX_PARTS + 1
            })
            .max_by(|&i, &j| volume(&cut[i]).total_cmp(&volume(&cut[j])).then(j.cmp(&i)))
        {
            let opened = cut.swap_remove(largest);
            cut.extend(tree.clusters[opened].child_range());
        }
        cut
    };
    let micro = cut(&hierarchy.micro).into_iter().map(|c| Part {
        bounds: hierarchy.micro.clusters[c].bounds.thickened(),
        extinction: optics[c].extinction,
        feature_size: std::array::from_fn(|axis| optics[c].feature_size(axis)),
    });
    // Large surfaces are tested exactly, never averaged: no emitter and no feature size is as large as this.
    let large = cut(&hierarchy.large).into_iter().map(|c| {
        let bounds = hierarchy.large.clusters[c].bounds.thickened();
        let extinction = [SOLID_DEPTH / bounds.extent().min_element(); AXIS_COUNT];
        Part { bounds, extinction, feature_size: [NEVER_AVERAGED; AXIS_COUNT] }
    });
    micro.chain(large).collect()
}

impl Part {
    /// A measured group as a part of a larger one.
    pub fn of_group(bounds: Aabb, optics: &ClusterOptics) -> Part {
        Part {
            bounds: bounds.thickened(),
            extinction: optics.extinction,
            feature_size: std::array::from_fn(|axis| optics.feature_size(axis)),
        }
    }
}

/// A member of a group: an instance, or another group.
pub struct Member<'a> {
    /// The boxes that represent it: those of its mesh, or its own.
    pub parts: &'a [Part],
    /// From the frame of the boxes to that of the groups: rotation, reflection and uniform scale.
    pub to_world: Affine3A,
}

/// Measures a group of members; `bounds` is the box around them.
pub fn measure(bounds: Aabb, members: &[Member], options: &Options) -> ClusterOptics {
    let mut scratch = Scratch::default();
    for (k, silhouette) in scratch.silhouettes.iter_mut().enumerate() {
        silhouette.draw_members(members, bounds.thickened(), view(k));
    }
    // Extinction is fitted, never analytic: the areas of the members are known to their own boxes only.
    let options = Options { extinction: Extinction::Measured, ..*options };
    let mut optics = scratch.measure(0.0, Vec3::ZERO, &options);
    // Boxes smaller than a pixel may be missed by the raster.
    for member in members {
        let to_local = member.to_world.inverse();
        let scale = member.to_world.matrix3.determinant().abs().cbrt();
        for (k, size) in optics.blocker_size.iter_mut().enumerate() {
            let mix = AxisMix::around(to_local.transform_vector3(view(k)));
            for part in member.parts {
                let member_size = mix.mix(|axis| part.feature_size[axis]);
                *size = size.max((scale * member_size).min(NEVER_AVERAGED));
            }
        }
    }
    optics
}

impl Silhouette {
    /// Computes the transmittance of instances, pixel by pixel. `bounds` is the box of the group, `view` a unit vector.
    fn draw_members(&mut self, members: &[Member], bounds: Aabb, view: Vec3) {
        self.begin(bounds, view, GROUP_PIXELS);
        if self.frame.pixel <= 0.0 {
            return;
        }
        let size = self.frame.size.as_usizevec2();
        let mut depth = std::mem::take(&mut self.transmittance);
        depth.resize(size.x * size.y, 0.0);
        for member in members {
            let to_local = member.to_world.inverse();
            let along = to_local.transform_vector3(view);
            let mix = AxisMix::around(along);
            for part in member.parts {
                let kappa = mix.mix(|axis| part.extinction[axis]);
                self.add_box(&mut depth, part.bounds, kappa, &member.to_world, &to_local, along);
            }
        }
        for (i, value) in depth.iter_mut().enumerate() {
            *value = (-*value).exp();
            if *value < 1.0 - MIN_LOSS {
                self.contents.set(i % size.x, i / size.x, true);
            }
        }
        self.transmittance = depth;
    }

    /// Adds the optical depth of one box to the pixels that it covers. `along` is the view direction in the box's
    /// frame.
    fn add_box(
        &self,
        depth: &mut [f32],
        part: Aabb,
        kappa: f32,
        to_world: &Affine3A,
        to_local: &Affine3A,
        along: Vec3,
    ) {
        let size = self.frame.size;
        let corners = part.corners().map(|corner| self.frame.project(to_world.transform_point3(corner)));
        let (lo, hi) = corners
            .into_iter()
            .fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
        let length = along.length();
        let first = lo.floor().max(Vec2::ZERO).as_uvec2();
        let end = hi.ceil().max(Vec2::ZERO).as_uvec2().min(size);
        let inverse = Vec3::from(along.to_array().map(|d| if d == 0.0 { 1e30 } else { 1.0 / d }));
        if (hi - lo).min_element() < 1.0 {
            // Pixel centres would miss the box or take it for a whole pixel: its loss is spread over the pixels by area.
            let e = part.extent();
            let front = Vec3::new(e.y * e.z, e.z * e.x, e.x * e.y).dot(along.abs()) / length;
            let opacity = 1.0 - (-kappa * e.element_product() / front.max(f32::MIN_POSITIVE)).exp();
            let area = front / (length * self.frame.pixel).powi(2);
            let covered = ((end.x - first.x.min(end.x)) * (end.y - first.y.min(end.y))).max(1);
            let lost = (area * opacity / covered as f32).min(MAX_PIXEL_LOSS);
            for y in first.y..end.y {
                for x in first.x..end.x {
                    depth[(y * size.x + x) as usize] -= (1.0 - lost).ln();
                }
            }
            return;
        }
        for y in first.y..end.y {
            for x in first.x..end.x {
                let at = self.frame.position(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
                let from = to_local.transform_point3(at);
                let (a, b) = ((part.min - from) * inverse, (part.max - from) * inverse);
                let path = a.max(b).min_element() - a.min(b).max_element();
                if path > 0.0 {
                    depth[(y * size.x + x) as usize] += kappa * path * length;
                }
            }
        }
    }
}
