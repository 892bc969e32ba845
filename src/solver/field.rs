//! One sweep of light: gather along links, push to the leaves, pull to the root. Energy in f64.

use crate::element::{DIRECTIONS, Elements, Shape, facing};
use crate::link::Link;
use glam::Vec3;
use rayon::prelude::*;

/// One value a channel.
pub type Rgb = [f64; 3];

/// Who is linked with whom: for each element the other ends and couplings, in the order of the links.
pub struct Neighbours {
    starts: Vec<u32>,
    others: Vec<(u32, f32)>,
}

impl Neighbours {
    /// Sorts links by their ends.
    pub fn new(elements: &Elements, links: &[Link]) -> Neighbours {
        let mut starts = vec![0u32; elements.len() + 1];
        let each = |f: &mut dyn FnMut(u32, u32, f32)| {
            for l in links.iter().filter(|l| l.coupling > 0.0) {
                f(l.a, l.b, l.coupling);
                if l.a != l.b {
                    f(l.b, l.a, l.coupling);
                }
            }
        };
        each(&mut |a, _, _| starts[a as usize + 1] += 1);
        for e in 0..elements.len() {
            starts[e + 1] += starts[e];
        }
        let mut next = starts.clone();
        let mut others = vec![(0, 0.0); starts[elements.len()] as usize];
        each(&mut |a, b, c| {
            others[next[a as usize] as usize] = (b, c);
            next[a as usize] += 1;
        });
        Neighbours { starts, others }
    }

    /// The other ends of an element's links with the couplings.
    pub fn of(&self, element: usize) -> &[(u32, f32)] {
        &self.others[self.starts[element] as usize..self.starts[element + 1] as usize]
    }

    /// Bytes.
    pub fn bytes(&self) -> usize {
        self.starts.capacity() * 4 + self.others.capacity() * 8
    }
}

/// What elements send out.
#[derive(Clone, Default)]
pub struct Outgoing {
    /// Radiosity by element, the mean by area for those with parts.
    pub radiosity: Vec<Rgb>,
    /// By cluster: radiosity times projected area along the six directions.
    beams: Vec<[Rgb; DIRECTIONS]>,
}

impl Outgoing {
    /// From the radiosity of the leaves; entries of other elements are overwritten.
    pub fn pull(elements: &Elements, mut radiosity: Vec<Rgb>) -> Outgoing {
        let mut beams = vec![[[0.0; 3]; DIRECTIONS]; elements.clusters.len()];
        for e in (0..elements.len()).rev() {
            let element = &elements.elements[e];
            if element.is_leaf() {
                continue;
            }
            let mut power = [0.0; 3];
            for child in element.child_range() {
                let part = &elements.elements[child];
                add(&mut power, part.area, radiosity[child]);
                let Shape::Cluster(c) = element.shape else { continue };
                match part.shape {
                    Shape::Cluster(inner) => {
                        let inner = beams[inner as usize];
                        beams[c as usize].iter_mut().zip(inner).for_each(|(b, i)| add(b, 1.0, i));
                    }
                    Shape::Surface { side, .. } => {
                        let faces = facing(elements.sides[side as usize].normal);
                        for (beam, face) in beams[c as usize].iter_mut().zip(faces) {
                            add(beam, part.area * f64::from(face), radiosity[child]);
                        }
                    }
                }
            }
            let area = element.area.max(f64::MIN_POSITIVE);
            radiosity[e] = power.map(|p| p / area);
        }
        Outgoing { radiosity, beams }
    }

    /// Mean radiosity that an element shows in a direction (a unit vector).
    #[inline]
    fn towards(&self, elements: &Elements, element: u32, direction: Vec3) -> Rgb {
        let Shape::Cluster(c) = elements.elements[element as usize].shape else {
            return self.radiosity[element as usize];
        };
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        let cluster = &elements.clusters[c as usize];
        for (k, share) in facing(direction).into_iter().enumerate() {
            add(&mut sum, f64::from(share), self.beams[c as usize][k]);
            total += f64::from(share) * cluster.projected[k];
        }
        if total > 1e-9 * elements.elements[element as usize].area {
            sum.map(|s| s / total)
        } else {
            self.radiosity[element as usize]
        }
    }
}

/// What arrives at a cluster: by direction on a surface that faces it, and evenly.
#[derive(Clone, Copy, Default)]
struct Arriving {
    beams: [Rgb; DIRECTIONS],
    even: Rgb,
}

/// Irradiance of every surface element from all links at it and at what holds it; zero for clusters. Bit-equal on any
/// number of threads: each element sums up its own links in their order.
pub fn irradiance(elements: &Elements, neighbours: &Neighbours, outgoing: &Outgoing) -> Vec<Rgb> {
    let clusters = elements.clusters.len();
    let mut arriving: Vec<Arriving> =
        (0..clusters).into_par_iter().map(|e| at_cluster(elements, neighbours, outgoing, e)).collect();
    let mut own: Vec<Rgb> = (0..elements.len())
        .into_par_iter()
        .with_min_len(1024)
        .map(|e| if e < clusters { [0.0; 3] } else { at_surface(elements, neighbours, outgoing, e) })
        .collect();
    for e in 1..elements.len() {
        let element = &elements.elements[e];
        let parent = element.parent as usize;
        match element.shape {
            Shape::Cluster(_) => {
                let above = arriving[parent];
                arriving[e].beams.iter_mut().zip(above.beams).for_each(|(b, a)| add(b, 1.0, a));
                add(&mut arriving[e].even, 1.0, above.even);
            }
            Shape::Surface { side, .. } if parent < clusters => {
                let above = &arriving[parent];
                add(&mut own[e], 1.0, above.even);
                for (face, beam) in facing(elements.sides[side as usize].normal).into_iter().zip(above.beams)
                {
                    if face > 0.0 {
                        add(&mut own[e], f64::from(face), beam);
                    }
                }
            }
            Shape::Surface { .. } => {
                let above = own[parent];
                add(&mut own[e], 1.0, above);
            }
        }
    }
    own
}

fn at_surface(elements: &Elements, neighbours: &Neighbours, outgoing: &Outgoing, e: usize) -> Rgb {
    let element = &elements.elements[e];
    let mut power = [0.0; 3];
    for &(other, coupling) in neighbours.of(e) {
        let source = &elements.elements[other as usize];
        let shown = if source.is_cluster() {
            let direction = (element.centre - source.centre).normalize_or_zero();
            outgoing.towards(elements, other, direction)
        } else {
            outgoing.radiosity[other as usize]
        };
        add(&mut power, f64::from(coupling), shown);
    }
    power.map(|p| p / element.area)
}

fn at_cluster(elements: &Elements, neighbours: &Neighbours, outgoing: &Outgoing, e: usize) -> Arriving {
    let element = &elements.elements[e];
    let cluster = &elements.clusters[e];
    let mut arriving = Arriving::default();
    for &(other, coupling) in neighbours.of(e) {
        let coupling = f64::from(coupling);
        if other as usize == e {
            add(&mut arriving.even, coupling / element.area, outgoing.radiosity[e]);
            continue;
        }
        let from = (elements.elements[other as usize].centre - element.centre).normalize_or_zero();
        let shown = outgoing.towards(elements, other, -from);
        let shares = facing(from);
        let total: f64 = shares.iter().zip(cluster.projected).map(|(&s, p)| f64::from(s) * p).sum();
        if total > 1e-9 * element.area {
            for (beam, share) in arriving.beams.iter_mut().zip(shares) {
                add(beam, coupling * f64::from(share) / total, shown);
            }
        } else {
            add(&mut arriving.even, coupling / element.area, shown);
        }
    }
    arriving
}

#[inline]
pub(super) fn add(to: &mut Rgb, factor: f64, of: Rgb) {
    for (t, o) in to.iter_mut().zip(of) {
        *t += factor * o;
    }
}
