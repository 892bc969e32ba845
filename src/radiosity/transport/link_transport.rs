//! Transport along links.

use super::Field;
use super::active_nodes::{ActiveNodes, NodeKind};
use super::directional::{CLUSTER_UNKNOWNS, NodeIrradiance};
use super::gather_push_pull::{NodeRadiosity, gather};
use crate::radiosity::elements::{DIRECTIONS, Elements, RowFactors, Shape};
use crate::radiosity::rgb::Rgb;

/// Links as rows of the transport operator. Unknowns are the irradiances of the active nodes in the order of
/// [`NodeIrradiance::to_field`].
pub struct LinkTransport<'a> {
    elements: &'a Elements,
    nodes: &'a ActiveNodes,
    weights: Vec<f64>,
}

impl<'a> LinkTransport<'a> {
    /// For active nodes, with the row factors of the elements.
    pub fn new(elements: &'a Elements, nodes: &'a ActiveNodes) -> LinkTransport<'a> {
        let unknowns = CLUSTER_UNKNOWNS * nodes.clusters + nodes.elements.len() - nodes.clusters;
        let weights = (0..unknowns).map(|i| weight(elements, nodes, i)).collect();
        LinkTransport { elements, nodes, weights }
    }

    /// Irradiance that emitters and light from beyond the scene cause directly.
    pub fn direct(&self) -> Field {
        self.bounce(&vec![[0.0; 3]; self.weights.len()])
    }

    /// Irradiance after one more bounce: by the reflection of `irradiance`, by emitters, and from beyond the scene. Row factors correct the
    /// exchange between elements: the light of surfaces from beyond the scene does not change with them.
    pub fn bounce(&self, irradiance: &Field) -> Field {
        let nodes = self.nodes;
        let irradiance = NodeIrradiance::from_field(irradiance, nodes.clusters);
        let surfaces: Vec<Rgb> = (nodes.clusters..nodes.elements.len())
            .map(|p| {
                let e = nodes.elements[p] as usize;
                let Shape::Surface { side, .. } = self.elements.elements[e].shape else { return [0.0; 3] };
                let s = &self.elements.sides[side as usize];
                let RowFactors { gathers, sends } = self.elements.states[e].factors;
                let (gathers, sends) = (f64::from(gathers), f64::from(sends));
                let incident = irradiance.surfaces[p - nodes.clusters];
                let beyond = nodes.beyond_at(p - nodes.clusters);
                std::array::from_fn(|k| {
                    let incident = gathers * incident[k] + (1.0 - gathers) * beyond[k];
                    sends * (s.exitance[k] + f64::from(s.reflectance[k]) * incident)
                })
            })
            .collect();
        let outgoing = NodeRadiosity::pull(self.elements, nodes, &surfaces, |p, r| {
            nodes.reflections[r].sent(&irradiance.clusters[p], nodes.reflections[r].emit)
        });
        let mut arriving = gather(self.elements, nodes, &outgoing);
        if let Some(beyond) = &nodes.beyond {
            arriving.add(beyond);
        }
        arriving.to_field()
    }

    /// Weight of each unknown in sums over the scene.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }
}

/// Weight of an unknown: reflectance times the area (of clusters: the projected area) that it lights; 0 where the children of
/// the node have unknowns of their own.
fn weight(elements: &Elements, nodes: &ActiveNodes, unknown: usize) -> f64 {
    let (node, component) = if unknown < CLUSTER_UNKNOWNS * nodes.clusters {
        (unknown / CLUSTER_UNKNOWNS, unknown % CLUSTER_UNKNOWNS)
    } else {
        (unknown - DIRECTIONS * nodes.clusters, DIRECTIONS)
    };
    if nodes.kinds[node] == NodeKind::Open {
        return 0.0;
    }
    let element = &elements.elements[nodes.elements[node] as usize];
    match element.shape {
        Shape::Surface { side, .. } => {
            let r = elements.sides[side as usize].reflectance;
            element.area * f64::from(r[0] + r[1] + r[2]) / 3.0
        }
        Shape::Cluster(c) => {
            let cluster = &elements.clusters[c as usize];
            let area = if component < DIRECTIONS { cluster.projected[component] } else { element.area };
            area * f64::from(cluster.reflectance)
        }
    }
}
