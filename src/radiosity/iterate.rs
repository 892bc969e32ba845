//! Sweeps until the light no longer changes.

use super::clock::Clock;
use super::cut::{Closure, Cut, Kind};
use super::field::{Incoming, Outgoing, Rgb, add, gather};
use super::local::Local;
use super::{Settled, Solver};
use crate::radiosity::elements::Shape;

/// Least and largest factor by which the reflected light is scaled after a sweep.
const LEAST_SCALE: f64 = 0.2;
const MOST_SCALE: f64 = 50.0;
/// Change at which sweeps end when it is late, and their number then at most: light goes on a few times, and what is left to
/// come is scaled to the right sum.
const LATE_CHANGE: f64 = 1e-3;
const LATE_SWEEPS: usize = 16;

impl Solver {
    /// What is emitted, without any link.
    pub(super) fn start(&mut self) {
        self.incident = vec![[0.0; 3]; self.elements.len()];
        self.closure = vec![Closure::NONE; self.elements.len()];
        self.shine();
        self.look();
    }

    /// The cut for the present links.
    pub(super) fn cut(&self) -> Cut {
        Cut::new(&self.elements, &self.links, &self.closure)
    }

    /// Splits all surfaces down to an area (one that there are ids for): for the local pass. What hides a part of a surface from all others, as
    /// furniture does with the floor, dims the mean of the whole, but not what is seen of it. It ends when interrupted.
    pub(super) fn split_all(&mut self, min_area: f64, clock: &Clock) {
        self.elements.min_area = min_area;
        let mut e = 0;
        while e < self.elements.len() && !clock.interrupted() {
            if self.elements.elements[e].is_leaf() && self.elements.can_open(e as u32) {
                self.open(e as u32);
            }
            e += 1;
        }
        self.state = None;
    }

    /// Takes over what the local pass found.
    pub(super) fn adopt(&mut self, local: Local) {
        self.incident.clone_from(&local.incident);
        self.tally.add(local.tally);
        self.local = Some(local);
        self.shine();
        self.look();
    }

    /// Radiosity of all elements from their irradiance: the mean by area for those with parts.
    fn shine(&mut self) {
        let elements = &self.elements.elements;
        let mut radiosity = vec![[0.0; 3]; elements.len()];
        for (e, element) in elements.iter().enumerate().rev() {
            if let (Shape::Surface { side, .. }, true) = (&element.shape, element.is_leaf()) {
                let s = &self.elements.sides[*side as usize];
                radiosity[e] = std::array::from_fn(|k| {
                    s.exitance[k] + f64::from(s.reflectance[k]) * self.incident[e][k]
                });
            }
            let mut sum = [0.0; 3];
            let mut irradiance = [0.0; 3];
            for c in element.child_range() {
                let share = elements[c].area / element.area.max(f64::MIN_POSITIVE);
                add(&mut sum, share, radiosity[c]);
                add(&mut irradiance, share, self.incident[c]);
            }
            if !element.is_leaf() {
                radiosity[e] = sum;
                if !element.is_cluster() {
                    self.incident[e] = irradiance;
                }
            }
        }
        self.radiosity = radiosity;
    }

    /// Sweeps until the radiosity changes by less than `tolerance` of itself (area-weighted mean), `most` times at most and a
    /// few times when it is late, then works out the light of all elements.
    ///
    /// Every sweep gathers from the last one's radiosity (Jacobi), so that threads do not matter; relaxing one element at a
    /// time, in turn or by its residual (Southwell), takes more work and one thread (measured in the tests of `system`). After it all that was
    /// reflected is scaled, by channel, so that its sum is right: the slow even mode of bright scenes, from a coarse level
    /// of one unknown. Links that give back more than they get cannot make light grow without end.
    pub(super) fn settle(&mut self, cut: &Cut, tolerance: f64, most: usize, clock: &Clock) -> Settled {
        let nothing = Incoming {
            clusters: vec![Default::default(); cut.clusters],
            surfaces: vec![[0.0; 3]; cut.elements.len() - cut.clusters],
        };
        let direct = gather(&self.elements, cut, &self.outgoing(cut, &nothing));
        let fixed = flat(&direct);
        // What arrives, from the last solution if the cut has not changed.
        let mut state = match self.state.take() {
            Some((places, state)) if places == cut.elements.len() => state,
            _ => direct,
        };
        let mut settled = Settled::default();
        let enough = |s: &Settled| s.sweeps >= LATE_SWEEPS || (s.sweeps > 0 && s.residual < LATE_CHANGE);
        while settled.sweeps < most && !(enough(&settled) && clock.late()) {
            settled.sweeps += 1;
            let outgoing = self.outgoing(cut, &state);
            let next = gather(&self.elements, cut, &outgoing);
            let (made, then) = (flat(&next), flat(&state));
            let (mut moved, mut total) = (0.0, 0.0);
            let (mut emitted, mut reflected, mut before) = ([0.0; 3], [0.0; 3], [0.0; 3]);
            for i in 0..made.len() {
                let weight = self.weight(cut, i);
                for k in 0..3 {
                    moved += weight * (made[i][k] - then[i][k]).abs();
                    total += weight * made[i][k];
                    emitted[k] += weight * fixed[i][k];
                    reflected[k] += weight * (made[i][k] - fixed[i][k]);
                    before[k] += weight * then[i][k];
                }
            }
            settled.residual = if total > 0.0 { moved / total } else { 0.0 };
            settled.converged = settled.residual < tolerance;
            if settled.converged {
                state = next;
                break;
            }
            let scale: Rgb = std::array::from_fn(|k| {
                let kept = before[k] - reflected[k];
                if kept > 0.0 {
                    (emitted[k] / kept).clamp(LEAST_SCALE, MOST_SCALE)
                } else if reflected[k] > 0.0 {
                    before[k] / reflected[k]
                } else {
                    1.0
                }
            });
            let scaled =
                |i: usize| std::array::from_fn(|k| fixed[i][k] + scale[k] * (made[i][k] - fixed[i][k]));
            state = shaped(cut, (0..made.len()).map(scaled));
        }
        let incident = cut.expand(&self.elements, &state.clusters, &state.surfaces);
        self.incident = incident
            .into_iter()
            .zip(&self.closure)
            .map(|(e, &closure)| e.map(|v| v * f64::from(closure.gathers)))
            .collect();
        self.shine();
        self.state = Some((cut.elements.len(), state));
        settled
    }

    fn outgoing(&self, cut: &Cut, state: &Incoming) -> Outgoing {
        let surfaces: Vec<Rgb> = (cut.clusters..cut.elements.len())
            .map(|p| {
                let e = cut.elements[p] as usize;
                let Shape::Surface { side, .. } = self.elements.elements[e].shape else { return [0.0; 3] };
                let s = &self.elements.sides[side as usize];
                let Closure { gathers, sends } = self.closure[e];
                let (gathers, sends) = (f64::from(gathers), f64::from(sends));
                let incident = state.surfaces[p - cut.clusters];
                std::array::from_fn(|k| {
                    sends * (s.exitance[k] + f64::from(s.reflectance[k]) * gathers * incident[k])
                })
            })
            .collect();
        Outgoing::pull(&self.elements, cut, &surfaces, |p, r| {
            cut.responses[r].answer(&state.clusters[p], cut.responses[r].emit)
        })
    }

    /// What the change of an unknown counts: area times reflectance of what it lights.
    fn weight(&self, cut: &Cut, i: usize) -> f64 {
        let (place, of) = if i < 7 * cut.clusters { (i / 7, i % 7) } else { (i - 6 * cut.clusters, 6) };
        if cut.kinds[place] == Kind::Open {
            return 0.0;
        }
        let element = &self.elements.elements[cut.elements[place] as usize];
        match element.shape {
            Shape::Surface { side, .. } => {
                let r = self.elements.sides[side as usize].reflectance;
                element.area * f64::from(r[0] + r[1] + r[2]) / 3.0
            }
            Shape::Cluster(c) => {
                let cluster = &self.elements.clusters[c as usize];
                let area = if of < 6 { cluster.projected[of] } else { element.area };
                area * f64::from(cluster.reflectance)
            }
        }
    }
}

/// All unknowns of a state in a row: seven a cluster, one a surface.
fn flat(state: &Incoming) -> Vec<Rgb> {
    let clusters = state.clusters.iter().flat_map(|a| a.beams.into_iter().chain([a.even]));
    clusters.chain(state.surfaces.iter().copied()).collect()
}

fn shaped(cut: &Cut, mut values: impl Iterator<Item = Rgb>) -> Incoming {
    let mut next = || values.next().unwrap_or_default();
    let clusters = (0..cut.clusters)
        .map(|_| {
            let beams = std::array::from_fn(|_| next());
            super::field::Arriving { beams, even: next() }
        })
        .collect();
    let surfaces = (cut.clusters..cut.elements.len()).map(|_| next()).collect();
    Incoming { clusters, surfaces }
}
