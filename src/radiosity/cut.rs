//! The part of the element tree that links end at: what sweeps run over.
//!
//! Below most clusters no link ends. What arrives there is shared out by orientation and nothing else, so what such a
//! sealed cluster sends back is linear in what arrives: a small symmetric matrix stands for all surfaces in it. Sweeps
//! then cost as much as there are links, however many triangles there are; the light of all elements is worked out from
//! the cut when it is asked for ([`Cut::expand`]).

use super::field::{Arriving, Rgb, add};
use crate::radiosity::elements::{DIRECTIONS, Elements, Shape, facing};
use crate::radiosity::links::Link;
use rayon::prelude::*;

/// What stands for a normal: how far it faces the six directions, and 1 for what arrives evenly.
const BASIS: usize = DIRECTIONS + 1;
/// Entries of a symmetric matrix over the basis.
const ENTRIES: usize = BASIS * (BASIS + 1) / 2;

/// What a leaf's light is multiplied with so that its row sums are right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closure {
    /// What arrives.
    pub gathers: f32,
    /// What is sent.
    pub sends: f32,
}

impl Closure {
    /// Nothing is changed.
    pub const NONE: Closure = Closure { gathers: 1.0, sends: 1.0 };
}

/// What a sealed cluster does to light.
pub struct Response {
    /// `Σ A ρ g_p g_q` by channel over its sides, row by row of the lower half.
    reflect: [[f32; ENTRIES]; 3],
    /// `Σ A M g_p` by channel.
    pub emit: [Rgb; BASIS],
    /// `Σ A g_p`: what radiosity 1 gives.
    pub ones: [Rgb; BASIS],
}

/// What becomes of light at a place of the cut.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// It goes on to its parts.
    Open,
    /// A cluster without links below: index into [`Cut::responses`].
    Sealed(u32),
    /// A surface without links below.
    Surface,
}

/// The cut: places are elements, parents before children, clusters before surfaces.
pub struct Cut {
    /// The element of each place.
    pub elements: Vec<u32>,
    /// The place of each element, [`Cut::NONE`] for those below.
    pub places: Vec<u32>,
    /// The place of the parent.
    pub parents: Vec<u32>,
    /// What becomes of light there.
    pub kinds: Vec<Kind>,
    /// Sealed clusters.
    pub responses: Vec<Response>,
    /// Number of places that are clusters.
    pub clusters: usize,
    /// Other ends and couplings of the links at each place.
    starts: Vec<u32>,
    others: Vec<(u32, f32)>,
}

impl Cut {
    /// Stands for no place.
    pub const NONE: u32 = u32::MAX;

    /// The cut for a set of links. `closure` by element multiplies what leaves gather and what they send.
    pub fn new(elements: &Elements, links: &[Link], closure: &[Closure]) -> Cut {
        let n = elements.len();
        let mut below = vec![false; n];
        let mut linked = vec![false; n];
        for l in links {
            (linked[l.a as usize], linked[l.b as usize]) = (true, true);
        }
        for e in (1..n).rev() {
            if linked[e] || below[e] {
                below[elements.elements[e].parent as usize] = true;
            }
        }
        let mut cut = Cut {
            elements: Vec::new(),
            places: vec![Self::NONE; n],
            parents: Vec::new(),
            kinds: Vec::new(),
            responses: Vec::new(),
            clusters: 0,
            starts: Vec::new(),
            others: Vec::new(),
        };
        let mut sealed = Vec::new();
        for (e, element) in elements.elements.iter().enumerate() {
            let parent = element.parent as usize;
            if e > 0 && (cut.places[parent] == Self::NONE || !below[parent]) {
                continue;
            }
            cut.places[e] = cut.elements.len() as u32;
            cut.elements.push(e as u32);
            cut.parents.push(cut.places[parent]);
            cut.clusters += usize::from(element.is_cluster());
            cut.kinds.push(match (below[e], &element.shape) {
                (true, _) => Kind::Open,
                (false, Shape::Surface { .. }) => Kind::Surface,
                (false, Shape::Cluster(c)) => {
                    sealed.push(*c);
                    Kind::Sealed(sealed.len() as u32 - 1)
                }
            });
        }
        cut.responses = sealed.par_iter().map(|&c| response(elements, c, closure)).collect();
        cut.connect(links);
        cut
    }

    /// Uses another closure.
    pub fn reclose(&mut self, elements: &Elements, closure: &[Closure]) {
        let sealed: Vec<u32> = self.sealed().map(|place| self.elements[place]).collect();
        self.responses = sealed.par_iter().map(|&c| response(elements, c, closure)).collect();
    }

    fn connect(&mut self, links: &[Link]) {
        let places = &self.places;
        let mut starts = vec![0u32; self.elements.len() + 1];
        let each = |f: &mut dyn FnMut(u32, u32, f32)| {
            for l in links.iter().filter(|l| l.coupling > 0.0) {
                let (a, b) = (places[l.a as usize], places[l.b as usize]);
                f(a, b, l.coupling);
                if a != b {
                    f(b, a, l.coupling);
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

    /// Places that a place is linked with, and the couplings.
    #[inline]
    pub fn links_of(&self, place: usize) -> &[(u32, f32)] {
        &self.others[self.starts[place] as usize..self.starts[place + 1] as usize]
    }

    /// Places of the sealed clusters, in the order of their responses.
    pub fn sealed(&self) -> impl Iterator<Item = usize> {
        self.kinds
            .iter()
            .enumerate()
            .filter(|(_, kind)| matches!(kind, Kind::Sealed(_)))
            .map(|(place, _)| place)
    }

    /// Bytes.
    pub fn bytes(&self) -> usize {
        4 * (self.elements.capacity()
            + self.places.capacity()
            + self.parents.capacity()
            + self.starts.capacity())
            + 8 * (self.kinds.capacity() + self.others.capacity())
            + self.responses.capacity() * size_of::<Response>()
    }

    /// Irradiance of all surface elements (not of clusters, where it stays 0) from what arrives at the places.
    pub fn expand(&self, elements: &Elements, clusters: &[Arriving], surfaces: &[Rgb]) -> Vec<Rgb> {
        let mut arriving: Vec<Arriving> = vec![Arriving::default(); elements.clusters.len()];
        for (c, arriving_here) in clusters.iter().enumerate() {
            arriving[self.elements[c] as usize] = *arriving_here;
        }
        for c in 0..elements.clusters.len() {
            if self.places[c] == Self::NONE {
                arriving[c] = arriving[elements.elements[c].parent as usize];
            }
        }
        let mut incident: Vec<Rgb> = elements
            .elements
            .par_iter()
            .enumerate()
            .with_min_len(1024)
            .map(|(e, element)| match (&element.shape, self.places[e]) {
                (Shape::Cluster(_), _) => [0.0; 3],
                (Shape::Surface { .. }, place) if place != Self::NONE => {
                    surfaces[place as usize - self.clusters]
                }
                (Shape::Surface { side, .. }, _) if (element.parent as usize) < arriving.len() => {
                    arriving[element.parent as usize].at(facing(elements.sides[*side as usize].normal))
                }
                // Filled in below: its parent is a surface.
                _ => [0.0; 3],
            })
            .collect();
        for (e, element) in elements.elements.iter().enumerate() {
            if self.places[e] == Self::NONE && element.level > 0 {
                incident[e] = incident[element.parent as usize];
            }
        }
        incident
    }
}

impl Response {
    /// What a cluster sends out for what arrives, and by itself (`emit`): by direction and, last, in all; radiosity times
    /// area.
    #[inline]
    pub fn answer(&self, arriving: &Arriving, emit: [Rgb; BASIS]) -> [Rgb; BASIS] {
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

/// `Σ A v g_p` over the sides of a cluster, for a value of each side.
pub fn sent(elements: &Elements, cluster: u32, of: impl Fn(u32) -> Rgb) -> [Rgb; BASIS] {
    let [from, to] = elements.clusters[cluster as usize].sides;
    let mut sum = [[0.0; 3]; BASIS];
    for s in from..to {
        let side = &elements.sides[s as usize];
        let area = elements.elements[side.element as usize].area;
        let faces = facing(side.normal).into_iter().chain([1.0]);
        sum.iter_mut().zip(faces).for_each(|(sum, face)| add(sum, area * f64::from(face), of(s)));
    }
    sum
}

fn response(elements: &Elements, cluster: u32, closure: &[Closure]) -> Response {
    let [from, to] = elements.clusters[cluster as usize].sides;
    let mut reflect = [[0.0f64; ENTRIES]; 3];
    let mut emit = [[0.0; 3]; BASIS];
    let mut ones = [[0.0; 3]; BASIS];
    for side in &elements.sides[from as usize..to as usize] {
        let faces = facing(side.normal);
        let basis: [f64; BASIS] =
            std::array::from_fn(|p| if p < DIRECTIONS { f64::from(faces[p]) } else { 1.0 });
        let area = elements.elements[side.element as usize].area;
        let Closure { gathers, sends } = closure[side.element as usize];
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
    Response { reflect: reflect.map(|r| r.map(|v| v as f32)), emit, ones }
}
