//! One sweep of light over a cut: gather along links, push down, pull up. Energy in f64.

use super::cut::{Cut, Kind};
use crate::radiosity::elements::{DIRECTIONS, Elements, Shape, facing};
use glam::Vec3;
use rayon::prelude::*;

/// One value a channel.
pub type Rgb = [f64; 3];

/// What arrives at a cluster: by direction, as irradiance of a surface that faces it, and evenly.
#[derive(Clone, Copy, Default)]
pub struct Arriving {
    pub beams: [Rgb; DIRECTIONS],
    pub even: Rgb,
}

impl Arriving {
    /// Irradiance of a surface that faces the six directions so far.
    #[inline]
    pub fn at(&self, faces: [f32; DIRECTIONS]) -> Rgb {
        let mut sum = self.even;
        for (face, beam) in faces.into_iter().zip(self.beams) {
            if face > 0.0 {
                add(&mut sum, f64::from(face), beam);
            }
        }
        sum
    }
}

/// What the places of a cut send out.
#[derive(Clone, Default)]
pub struct Outgoing {
    /// Radiosity by place, the mean by area for those with parts.
    pub radiosity: Vec<Rgb>,
    /// By cluster: radiosity times projected area along the six directions.
    beams: Vec<[Rgb; DIRECTIONS]>,
}

/// What arrives at the places of a cut, from all links at them and at what holds them.
#[derive(Default)]
pub struct Incoming {
    /// Clusters.
    pub clusters: Vec<Arriving>,
    /// Irradiance of surfaces, in the order of their places.
    pub surfaces: Vec<Rgb>,
}

impl Outgoing {
    /// From the radiosity of surfaces without links below (by place less the number of clusters) and what sealed clusters
    /// send out by direction and in all, by place and index of the response.
    pub fn pull(
        elements: &Elements,
        cut: &Cut,
        surfaces: &[Rgb],
        sealed: impl Fn(usize, usize) -> [Rgb; DIRECTIONS + 1],
    ) -> Outgoing {
        let n = cut.elements.len();
        let mut beams = vec![[[0.0; 3]; DIRECTIONS]; cut.clusters];
        // Power, until divided by the area at the end.
        let mut power = vec![[0.0; 3]; n];
        for p in (0..n).rev() {
            let element = &elements.elements[cut.elements[p] as usize];
            match cut.kinds[p] {
                Kind::Open => {}
                Kind::Sealed(r) => {
                    let answer = sealed(p, r as usize);
                    beams[p] = std::array::from_fn(|k| answer[k]);
                    power[p] = answer[DIRECTIONS];
                }
                Kind::Surface => power[p] = surfaces[p - cut.clusters].map(|b| b * element.area),
            }
            if p == 0 {
                break;
            }
            let parent = cut.parents[p] as usize;
            let sent = power[p];
            add(&mut power[parent], 1.0, sent);
            match element.shape {
                Shape::Cluster(_) => {
                    let inner = beams[p];
                    beams[parent].iter_mut().zip(inner).for_each(|(b, i)| add(b, 1.0, i));
                }
                Shape::Surface { side, .. } if parent < cut.clusters => {
                    let faces = facing(elements.sides[side as usize].normal);
                    beams[parent].iter_mut().zip(faces).for_each(|(b, f)| add(b, f64::from(f), sent));
                }
                Shape::Surface { .. } => {}
            }
        }
        for (power, &e) in power.iter_mut().zip(&cut.elements) {
            let area = elements.elements[e as usize].area.max(f64::MIN_POSITIVE);
            *power = power.map(|p| p / area);
        }
        Outgoing { radiosity: power, beams }
    }

    /// Mean radiosity that a cluster shows in a direction (a unit vector).
    #[inline]
    fn towards(&self, elements: &Elements, cut: &Cut, place: usize, direction: Vec3) -> Rgb {
        let e = cut.elements[place] as usize;
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        let cluster = &elements.clusters[e];
        for (k, share) in facing(direction).into_iter().enumerate() {
            if share > 0.0 {
                add(&mut sum, f64::from(share), self.beams[place][k]);
                total += f64::from(share) * cluster.projected[k];
            }
        }
        if total > 1e-9 * elements.elements[e].area { sum.map(|s| s / total) } else { self.radiosity[place] }
    }
}

/// One sweep. Bit-equal on any number of threads: each place sums up its own links in their order.
pub fn gather(elements: &Elements, cut: &Cut, outgoing: &Outgoing) -> Incoming {
    let mut clusters: Vec<Arriving> = (0..cut.clusters)
        .into_par_iter()
        .with_min_len(64)
        .map(|p| at_cluster(elements, cut, outgoing, p))
        .collect();
    let mut surfaces: Vec<Rgb> = (cut.clusters..cut.elements.len())
        .into_par_iter()
        .with_min_len(256)
        .map(|p| at_surface(elements, cut, outgoing, p))
        .collect();
    for p in 1..cut.elements.len() {
        let parent = cut.parents[p] as usize;
        match elements.elements[cut.elements[p] as usize].shape {
            Shape::Cluster(_) => {
                let above = clusters[parent];
                clusters[p].beams.iter_mut().zip(above.beams).for_each(|(b, a)| add(b, 1.0, a));
                add(&mut clusters[p].even, 1.0, above.even);
            }
            Shape::Surface { side, .. } if parent < cut.clusters => {
                let faces = facing(elements.sides[side as usize].normal);
                add(&mut surfaces[p - cut.clusters], 1.0, clusters[parent].at(faces));
            }
            Shape::Surface { .. } => {
                let above = surfaces[parent - cut.clusters];
                add(&mut surfaces[p - cut.clusters], 1.0, above);
            }
        }
    }
    Incoming { clusters, surfaces }
}

fn at_surface(elements: &Elements, cut: &Cut, outgoing: &Outgoing, place: usize) -> Rgb {
    let element = &elements.elements[cut.elements[place] as usize];
    let mut power = [0.0; 3];
    for &(other, coupling) in cut.links_of(place) {
        let other = other as usize;
        let shown = if other < cut.clusters {
            let source = &elements.elements[cut.elements[other] as usize];
            outgoing.towards(elements, cut, other, (element.centre - source.centre).normalize_or_zero())
        } else {
            outgoing.radiosity[other]
        };
        add(&mut power, f64::from(coupling), shown);
    }
    power.map(|p| p / element.area)
}

fn at_cluster(elements: &Elements, cut: &Cut, outgoing: &Outgoing, place: usize) -> Arriving {
    let e = cut.elements[place] as usize;
    let (element, cluster) = (&elements.elements[e], &elements.clusters[e]);
    let mut arriving = Arriving::default();
    for &(other, coupling) in cut.links_of(place) {
        let (other, coupling) = (other as usize, f64::from(coupling));
        if other == place {
            add(&mut arriving.even, coupling / element.area, outgoing.radiosity[place]);
            continue;
        }
        let source = &elements.elements[cut.elements[other] as usize];
        let from = (source.centre - element.centre).normalize_or_zero();
        let shown = if other < cut.clusters {
            outgoing.towards(elements, cut, other, -from)
        } else {
            outgoing.radiosity[other]
        };
        let shares = facing(from);
        let total: f64 = shares.iter().zip(cluster.projected).map(|(&s, p)| f64::from(s) * p).sum();
        if total > 1e-9 * element.area {
            for (beam, share) in arriving.beams.iter_mut().zip(shares).filter(|(_, share)| *share > 0.0) {
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
