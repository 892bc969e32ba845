//! Directional light at clusters: irradiance that arrives at the nodes of the element tree, and reflection of aggregated clusters.

use crate::radiosity::elements::{DIRECTIONS, Elements, RowFactors, facing};
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

// Reflection and emission of a cluster without links below it, as one small matrix for all its surfaces.
//
// Light that arrives at such an aggregated cluster is distributed only by orientation. The light that the cluster sends back is
// therefore linear in it: a symmetric matrix over seven basis functions, the cosines with six directions and the constant 1.

/// Basis functions of a normal: its cosines with the six directions, and 1 for even light.
pub const BASIS: usize = DIRECTIONS + 1;
/// Entries of the lower half of a symmetric matrix over the basis.
const ENTRIES: usize = BASIS * (BASIS + 1) / 2;

/// Reflection and emission of an aggregated cluster.
pub struct ClusterReflection {
    /// `Σ A ρ g_p g_q` by channel over the cluster's sides, rows of the lower half; scene units squared.
    reflect: [[f32; ENTRIES]; 3],
    /// `Σ A M g_p` by channel: exitance times area.
    pub emit: [Rgb; BASIS],
    /// `Σ A g_p` by channel: the same at radiosity 1.
    pub ones: [Rgb; BASIS],
}

impl ClusterReflection {
    /// Of a cluster, with the row factors of its sides.
    pub fn new(elements: &Elements, cluster: u32) -> ClusterReflection {
        let [from, to] = elements.clusters[cluster as usize].sides;
        let mut reflect = [[0.0f64; ENTRIES]; 3];
        let mut emit = [[0.0; 3]; BASIS];
        let mut ones = [[0.0; 3]; BASIS];
        for side in &elements.sides[from as usize..to as usize] {
            let faces = facing(side.normal);
            let basis: [f64; BASIS] =
                std::array::from_fn(|p| if p < DIRECTIONS { f64::from(faces[p]) } else { 1.0 });
            let area = elements.elements[side.element as usize].area;
            let RowFactors { gathers, sends } = elements.states[side.element as usize].factors;
            let (gain, sends) = (area * f64::from(gathers * sends), f64::from(sends));
            let mut entry = 0;
            for p in 0..BASIS {
                add(&mut emit[p], sends * area * basis[p], side.exitance);
                add(&mut ones[p], sends * area * basis[p], [1.0; 3]);
                for q in 0..=p {
                    let product = gain * basis[p] * basis[q];
                    for (reflect, reflectance) in reflect.iter_mut().zip(side.reflectance) {
                        reflect[entry] += f64::from(reflectance) * product;
                    }
                    entry += 1;
                }
            }
        }
        ClusterReflection { reflect: reflect.map(|r| r.map(|v| v as f32)), emit, ones }
    }

    /// Radiosity times area that the cluster sends for the irradiance that arrives, in addition to `emit`: by direction, and last the
    /// total.
    #[inline]
    pub fn sent(&self, arriving: &DirectionalIrradiance, emit: [Rgb; BASIS]) -> [Rgb; BASIS] {
        let mut out = emit;
        let arriving: [Rgb; BASIS] =
            std::array::from_fn(|q| if q < DIRECTIONS { arriving.beams[q] } else { arriving.even });
        for (k, reflect) in self.reflect.iter().enumerate() {
            let mut entry = 0;
            for p in 0..BASIS {
                for q in 0..=p {
                    let r = f64::from(reflect[entry]);
                    entry += 1;
                    out[p][k] += r * arriving[q][k];
                    if p != q {
                        out[q][k] += r * arriving[p][k];
                    }
                }
            }
        }
        out
    }
}

/// `Σ A v g_p` over the sides of a cluster, for an exitance `v` of each side.
pub fn emission_moments(elements: &Elements, cluster: u32, exitance: impl Fn(u32) -> Rgb) -> [Rgb; BASIS] {
    let [from, to] = elements.clusters[cluster as usize].sides;
    let mut sum = [[0.0; 3]; BASIS];
    for s in from..to {
        let side = &elements.sides[s as usize];
        let area = elements.elements[side.element as usize].area;
        let basis = facing(side.normal).into_iter().chain([1.0]);
        sum.iter_mut().zip(basis).for_each(|(sum, g)| add(sum, area * f64::from(g), exitance(s)));
    }
    sum
}
