//! Active nodes: the elements with links at or below them. Gather, push and pull visit only these.
//!
//! Below most clusters there are no links; such clusters are aggregated ([`ClusterReflection`]). A sweep then costs as much as
//! there are links, however many triangles the scene has. The light of all other elements follows from the active nodes
//! ([`ActiveNodes::expand`]).

use super::directional::{ClusterReflection, DirectionalIrradiance, NodeIrradiance};
use crate::math::parallel;
use crate::radiosity::elements::{Elements, Shape, facing};
use crate::radiosity::links::Link;
use crate::radiosity::rgb::Rgb;

/// Treatment of light at an active node.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum NodeKind {
    /// The node has active children, which receive its light.
    Open,
    /// A cluster without links below: index into [`ActiveNodes::reflections`].
    Aggregated(u32),
    /// A surface without links below.
    Surface,
}

/// The active nodes: parents before children, clusters before surfaces.
#[derive(Default)]
pub struct ActiveNodes {
    /// The element of each node.
    pub elements: Vec<u32>,
    /// The node of each element; [`ActiveNodes::NONE`] for elements below the active ones.
    pub nodes: Vec<u32>,
    /// The parent node of each node.
    pub parents: Vec<u32>,
    /// Treatment of light at each node.
    pub kinds: Vec<NodeKind>,
    /// Aggregated clusters.
    pub reflections: Vec<ClusterReflection>,
    /// Number of nodes that are clusters.
    pub clusters: usize,
    /// Links by node: first entry of each node, and (other node, exchange area).
    starts: Vec<u32>,
    others: Vec<(u32, f32)>,
    /// Irradiance from beyond the scene at each node, also along the links of its ancestors; `None` without such links.
    pub beyond: Option<NodeIrradiance>,
}

impl ActiveNodes {
    /// Index that means "no node".
    pub const NONE: u32 = u32::MAX;

    /// No light at any node.
    pub fn dark(&self) -> NodeIrradiance {
        NodeIrradiance {
            clusters: vec![DirectionalIrradiance::default(); self.clusters],
            surfaces: vec![[0.0; 3]; self.elements.len() - self.clusters],
        }
    }

    /// The active nodes for a set of links and the elements at which light from beyond the scene arrives, with the row factors of the
    /// elements.
    pub fn new(elements: &Elements, links: &[Link], lit: impl Iterator<Item = u32>) -> ActiveNodes {
        let n = elements.len();
        let mut below = vec![false; n];
        let mut linked = vec![false; n];
        for l in links {
            (linked[l.a as usize], linked[l.b as usize]) = (true, true);
        }
        lit.for_each(|e| linked[e as usize] = true);
        for e in (1..n).rev() {
            if linked[e] || below[e] {
                below[elements.elements[e].parent as usize] = true;
            }
        }
        let mut active = ActiveNodes { nodes: vec![Self::NONE; n], ..ActiveNodes::default() };
        let mut aggregated = 0;
        for (e, element) in elements.elements.iter().enumerate() {
            let parent = element.parent as usize;
            if e > 0 && (active.nodes[parent] == Self::NONE || !below[parent]) {
                continue;
            }
            active.nodes[e] = active.elements.len() as u32;
            active.elements.push(e as u32);
            active.parents.push(active.nodes[parent]);
            active.clusters += usize::from(element.is_cluster());
            active.kinds.push(match (below[e], &element.shape) {
                (true, _) => NodeKind::Open,
                (false, Shape::Surface { .. }) => NodeKind::Surface,
                (false, Shape::Cluster(_)) => {
                    aggregated += 1;
                    NodeKind::Aggregated(aggregated - 1)
                }
            });
        }
        active.update_factors(elements);
        active.connect(links);
        active
    }

    /// Applies the present row factors of the elements.
    pub fn update_factors(&mut self, elements: &Elements) {
        let clusters: Vec<u32> = self.aggregated().map(|node| self.elements[node]).collect();
        self.reflections = parallel::map(&clusters, |&c| ClusterReflection::new(elements, c));
    }

    fn connect(&mut self, links: &[Link]) {
        let nodes = &self.nodes;
        let mut starts = vec![0u32; self.elements.len() + 1];
        let each = |f: &mut dyn FnMut(u32, u32, f32)| {
            for l in links.iter().filter(|l| l.exchange_area > 0.0) {
                let (a, b) = (nodes[l.a as usize], nodes[l.b as usize]);
                f(a, b, l.exchange_area);
                if a != b {
                    f(b, a, l.exchange_area);
                }
            }
        };
        each(&mut |a, _, _| starts[a as usize + 1] += 1);
        for p in 1..starts.len() {
            starts[p] += starts[p - 1];
        }
        let mut next = starts.clone();
        let mut others = vec![(0, 0.0); starts.last().map_or(0, |&n| n as usize)];
        each(&mut |a, b, c| {
            others[next[a as usize] as usize] = (b, c);
            next[a as usize] += 1;
        });
        (self.starts, self.others) = (starts, others);
    }

    /// Nodes that a node is linked with, and the exchange areas (scene units squared).
    #[inline]
    pub fn links_of(&self, node: usize) -> &[(u32, f32)] {
        &self.others[self.starts[node] as usize..self.starts[node + 1] as usize]
    }

    /// Irradiance of a surface node by light from beyond the scene, W/m².
    pub fn beyond_at(&self, surface: usize) -> Rgb {
        self.beyond.as_ref().map_or([0.0; 3], |beyond| beyond.surfaces[surface])
    }

    /// Nodes of the aggregated clusters, in the order of their reflections.
    pub fn aggregated(&self) -> impl Iterator<Item = usize> {
        self.kinds
            .iter()
            .enumerate()
            .filter(|(_, kind)| matches!(kind, NodeKind::Aggregated(_)))
            .map(|(node, _)| node)
    }

    /// Size in memory, bytes.
    pub fn bytes(&self) -> usize {
        4 * (self.elements.capacity()
            + self.nodes.capacity()
            + self.parents.capacity()
            + self.starts.capacity())
            + 8 * (self.kinds.capacity() + self.others.capacity())
            + self.reflections.capacity() * size_of::<ClusterReflection>()
            + self.beyond.as_ref().map_or(0, NodeIrradiance::bytes)
    }

    /// Irradiance of all surface elements, W/m² (0 for clusters), from the irradiance at the nodes.
    pub fn expand(
        &self,
        elements: &Elements,
        clusters: &[DirectionalIrradiance],
        surfaces: &[Rgb],
    ) -> Vec<Rgb> {
        let mut arriving: Vec<DirectionalIrradiance> =
            vec![DirectionalIrradiance::default(); elements.clusters.len()];
        for (c, arriving_here) in clusters.iter().enumerate() {
            arriving[self.elements[c] as usize] = *arriving_here;
        }
        for c in 0..elements.clusters.len() {
            if self.nodes[c] == Self::NONE {
                arriving[c] = arriving[elements.elements[c].parent as usize];
            }
        }
        let mut incident: Vec<Rgb> = parallel::map(parallel::at_least(1024, 0..elements.len()), |e| {
            let element = &elements.elements[e];
            match (&element.shape, self.nodes[e]) {
                (Shape::Cluster(_), _) => [0.0; 3],
                (Shape::Surface { .. }, node) if node != Self::NONE => {
                    surfaces[node as usize - self.clusters]
                }
                (Shape::Surface { side, .. }, _) if (element.parent as usize) < arriving.len() => {
                    arriving[element.parent as usize].at(facing(elements.sides[*side as usize].normal))
                }
                // The loop below fills in parts of surfaces.
                _ => [0.0; 3],
            }
        });
        for (e, element) in elements.elements.iter().enumerate() {
            if self.nodes[e] == Self::NONE && element.level > 0 {
                incident[e] = incident[element.parent as usize];
            }
        }
        incident
    }
}
