//! Irradiance that arrives at the nodes of the element tree.

use crate::radiosity::elements::DIRECTIONS;
use crate::radiosity::rgb::{Rgb, add};

/// Irradiance at a cluster: from six directions and from all around.
#[derive(Clone, Copy, Default)]
pub struct DirectionalIrradiance {
    /// By direction, the irradiance of a surface that faces it, W/m².
    pub beams: [Rgb; DIRECTIONS],
    /// Irradiance of every surface, whatever its orientation, W/m².
    pub even: Rgb,
}

impl DirectionalIrradiance {
    /// Irradiance of a surface whose cosines with the six directions are given.
    #[inline]
    pub fn at(&self, cosines: [f32; DIRECTIONS]) -> Rgb {
        let mut sum = self.even;
        for (cosine, beam) in cosines.into_iter().zip(self.beams) {
            if cosine > 0.0 {
                add(&mut sum, f64::from(cosine), beam);
            }
        }
        sum
    }
}

/// Irradiance at all active nodes, from the links of each node and of the nodes above it.
#[derive(Default)]
pub struct NodeIrradiance {
    /// By cluster node.
    pub clusters: Vec<DirectionalIrradiance>,
    /// By surface node, in their order.
    pub surfaces: Vec<Rgb>,
}

/// Unknowns of a cluster: six directions and the even part.
pub const CLUSTER_UNKNOWNS: usize = DIRECTIONS + 1;

impl NodeIrradiance {
    /// All unknowns in one list: seven per cluster, then one per surface.
    pub fn to_field(&self) -> Vec<Rgb> {
        let clusters = self.clusters.iter().flat_map(|a| a.beams.into_iter().chain([a.even]));
        clusters.chain(self.surfaces.iter().copied()).collect()
    }

    /// Adds other irradiance at the same nodes.
    pub fn add(&mut self, other: &NodeIrradiance) {
        for (own, other) in self.clusters.iter_mut().zip(&other.clusters) {
            own.beams.iter_mut().zip(other.beams).for_each(|(own, other)| add(own, 1.0, other));
            add(&mut own.even, 1.0, other.even);
        }
        self.surfaces.iter_mut().zip(&other.surfaces).for_each(|(own, other)| add(own, 1.0, *other));
    }

    /// Size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.clusters.as_slice()) + size_of_val(self.surfaces.as_slice())
    }

    /// The inverse of [`NodeIrradiance::to_field`] for a number of clusters.
    pub fn from_field(field: &[Rgb], clusters: usize) -> NodeIrradiance {
        let (of_clusters, surfaces) = field.split_at(CLUSTER_UNKNOWNS * clusters);
        let (rows, _) = of_clusters.as_chunks::<CLUSTER_UNKNOWNS>();
        let cluster = |row: &[Rgb; CLUSTER_UNKNOWNS]| DirectionalIrradiance {
            beams: std::array::from_fn(|k| row[k]),
            even: row[DIRECTIONS],
        };
        NodeIrradiance { clusters: rows.iter().map(cluster).collect(), surfaces: surfaces.to_vec() }
    }
}
