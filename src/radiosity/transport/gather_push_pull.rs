//! One sweep of light over the active nodes: gather along links, push down, pull up. All sums are in double precision.

use super::active_nodes::{ActiveNodes, NodeKind};
use super::directional::{BASIS, DirectionalIrradiance, NodeIrradiance};
use crate::math::parallel;
use crate::radiosity::elements::{DIRECTIONS, Elements, Shape, facing};
use crate::radiosity::rgb::{Rgb, add};
use glam::Vec3;

/// Smallest projected area of a cluster, as a fraction of its area, by which directional light is divided: smaller ones are rounding
/// errors.
pub const MIN_PROJECTED: f64 = 1e-9;

/// Radiosity of the active nodes.
#[derive(Clone, Default)]
pub struct NodeRadiosity {
    /// Radiosity by node, W/m²; the mean by area for nodes with children.
    pub radiosity: Vec<Rgb>,
    /// By cluster: radiosity times projected area along the six directions, W/m² times scene units squared.
    beams: Vec<[Rgb; DIRECTIONS]>,
}

impl NodeRadiosity {
    /// Pulls radiosity up the tree. `surfaces` are the radiosities of surface nodes without children, by node less the number of
    /// clusters; `aggregated` gives the power that an aggregated cluster sends by direction and in all, for its node and the index
    /// of its reflection.
    pub fn pull(
        elements: &Elements,
        nodes: &ActiveNodes,
        surfaces: &[Rgb],
        aggregated: impl Fn(usize, usize) -> [Rgb; BASIS],
    ) -> NodeRadiosity {
        let n = nodes.elements.len();
        let mut beams = vec![[[0.0; 3]; DIRECTIONS]; nodes.clusters];
        // Radiosity times area; divided by the area at the end.
        let mut power = vec![[0.0; 3]; n];
        for p in (0..n).rev() {
            let element = &elements.elements[nodes.elements[p] as usize];
            match nodes.kinds[p] {
                NodeKind::Open => {}
                NodeKind::Aggregated(r) => {
                    let sent_out = aggregated(p, r as usize);
                    beams[p] = std::array::from_fn(|k| sent_out[k]);
                    power[p] = sent_out[DIRECTIONS];
                }
                NodeKind::Surface => power[p] = surfaces[p - nodes.clusters].map(|b| b * element.area),
            }
            if p == 0 {
                break;
            }
            let parent = nodes.parents[p] as usize;
            let sent = power[p];
            add(&mut power[parent], 1.0, sent);
            match element.shape {
                Shape::Cluster(_) => {
                    let inner = beams[p];
                    beams[parent].iter_mut().zip(inner).for_each(|(b, i)| add(b, 1.0, i));
                }
                Shape::Surface { side, .. } if parent < nodes.clusters => {
                    let faces = facing(elements.sides[side as usize].normal);
                    beams[parent].iter_mut().zip(faces).for_each(|(b, f)| add(b, f64::from(f), sent));
                }
                Shape::Surface { .. } => {}
            }
        }
        for (power, &e) in power.iter_mut().zip(&nodes.elements) {
            let area = elements.elements[e as usize].area.max(f64::MIN_POSITIVE);
            *power = power.map(|p| p / area);
        }
        NodeRadiosity { radiosity: power, beams }
    }

    /// Mean radiosity of a cluster seen from a direction (a unit vector), W/m².
    #[inline]
    fn towards(&self, elements: &Elements, nodes: &ActiveNodes, node: usize, direction: Vec3) -> Rgb {
        let e = nodes.elements[node] as usize;
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        let cluster = &elements.clusters[e];
        for (k, share) in facing(direction).into_iter().enumerate() {
            if share > 0.0 {
                add(&mut sum, f64::from(share), self.beams[node][k]);
                total += f64::from(share) * cluster.projected[k];
            }
        }
        if total > MIN_PROJECTED * elements.elements[e].area {
            sum.map(|s| s / total)
        } else {
            self.radiosity[node]
        }
    }
}

/// Gathers along all links and pushes the irradiance down. Each node adds up its own links in their order, so that the result
/// does not depend on the number of threads.
pub fn gather(elements: &Elements, nodes: &ActiveNodes, outgoing: &NodeRadiosity) -> NodeIrradiance {
    let clusters: Vec<DirectionalIrradiance> =
        parallel::map(parallel::at_least(64, 0..nodes.clusters), |p| {
            at_cluster(elements, nodes, outgoing, p)
        });
    let surfaces: Vec<Rgb> =
        parallel::map(parallel::at_least(256, nodes.clusters..nodes.elements.len()), |p| {
            at_surface(elements, nodes, outgoing, p)
        });
    let mut arriving = NodeIrradiance { clusters, surfaces };
    push(elements, nodes, &mut arriving);
    arriving
}

/// Pushes the irradiance that arrives at each node down to the nodes below it.
fn push(elements: &Elements, nodes: &ActiveNodes, arriving: &mut NodeIrradiance) {
    let NodeIrradiance { clusters, surfaces } = arriving;
    for p in 1..nodes.elements.len() {
        let parent = nodes.parents[p] as usize;
        match elements.elements[nodes.elements[p] as usize].shape {
            Shape::Cluster(_) => {
                let above = clusters[parent];
                clusters[p].beams.iter_mut().zip(above.beams).for_each(|(b, a)| add(b, 1.0, a));
                add(&mut clusters[p].even, 1.0, above.even);
            }
            Shape::Surface { side, .. } if parent < nodes.clusters => {
                let faces = facing(elements.sides[side as usize].normal);
                add(&mut surfaces[p - nodes.clusters], 1.0, clusters[parent].at(faces));
            }
            Shape::Surface { .. } => {
                let above = surfaces[parent - nodes.clusters];
                add(&mut surfaces[p - nodes.clusters], 1.0, above);
            }
        }
    }
}

/// Irradiance of the nodes by the light that arrives at elements; `None` if `arriving` is empty.
pub fn pushed(
    elements: &Elements,
    nodes: &ActiveNodes,
    arriving: &[(u32, DirectionalIrradiance)],
) -> Option<NodeIrradiance> {
    let mut pushed = nodes.dark();
    for (e, arriving) in arriving {
        let node = nodes.nodes[*e as usize] as usize;
        match node.checked_sub(nodes.clusters) {
            None => pushed.clusters[node] = *arriving,
            Some(surface) => pushed.surfaces[surface] = arriving.even,
        }
    }
    push(elements, nodes, &mut pushed);
    (!arriving.is_empty()).then_some(pushed)
}

fn at_surface(elements: &Elements, nodes: &ActiveNodes, outgoing: &NodeRadiosity, node: usize) -> Rgb {
    let element = &elements.elements[nodes.elements[node] as usize];
    let mut power = [0.0; 3];
    for &(other, exchange_area) in nodes.links_of(node) {
        let other = other as usize;
        let shown = if other < nodes.clusters {
            let source = &elements.elements[nodes.elements[other] as usize];
            outgoing.towards(elements, nodes, other, (element.centre - source.centre).normalize_or_zero())
        } else {
            outgoing.radiosity[other]
        };
        add(&mut power, f64::from(exchange_area), shown);
    }
    power.map(|p| p / element.area)
}

fn at_cluster(
    elements: &Elements,
    nodes: &ActiveNodes,
    outgoing: &NodeRadiosity,
    node: usize,
) -> DirectionalIrradiance {
    let e = nodes.elements[node] as usize;
    let (element, cluster) = (&elements.elements[e], &elements.clusters[e]);
    let mut arriving = DirectionalIrradiance::default();
    for &(other, exchange_area) in nodes.links_of(node) {
        let (other, exchange_area) = (other as usize, f64::from(exchange_area));
        if other == node {
            add(&mut arriving.even, exchange_area / element.area, outgoing.radiosity[node]);
            continue;
        }
        let source = &elements.elements[nodes.elements[other] as usize];
        let from = (source.centre - element.centre).normalize_or_zero();
        let shown = if other < nodes.clusters {
            outgoing.towards(elements, nodes, other, -from)
        } else {
            outgoing.radiosity[other]
        };
        let shares = facing(from);
        let total: f64 = shares.iter().zip(cluster.projected).map(|(&s, p)| f64::from(s) * p).sum();
        if total > MIN_PROJECTED * element.area {
            for (beam, share) in arriving.beams.iter_mut().zip(shares).filter(|(_, share)| *share > 0.0) {
                add(beam, exchange_area * f64::from(share) / total, shown);
            }
        } else {
            add(&mut arriving.even, exchange_area / element.area, shown);
        }
    }
    arriving
}
