//! Sweeps until the light no longer changes.

use super::Solver;
use super::cut::{Closure, Cut, Kind};
use super::field::{Incoming, Outgoing, Rgb, add, gather};
use super::local::Local;
use super::options::Rows;
use crate::element::Shape;

/// A leaf without a way out that sees hardly anything along its links is not mended: nothing is known of it.
const NOTHING: f64 = 0.1;
/// Row sums of other leaves above this are wrong.
const TOO_MUCH: f64 = 1.25;
/// Most rounds of balancing, and the root mean square error of the row sums (by area) at which it ends.
const ROUNDS: usize = 20;
const BALANCED: f64 = 3e-5;
/// Least and largest factor of a leaf.
const LEAST: f32 = 1e-4;
const MOST: f32 = 4.0;
/// Least and largest factor by which the reflected light is scaled after a sweep.
const LEAST_SCALE: f64 = 0.2;
const MOST_SCALE: f64 = 50.0;

impl Solver<'_> {
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
    /// furniture does with the floor, dims the mean of the whole, but not what is seen of it.
    pub(super) fn split_all(&mut self, min_area: f64) {
        self.elements.min_area = min_area;
        let mut e = 0;
        while e < self.elements.len() {
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

    /// The sum of each surface element's form factors along its links, before it is multiplied by its own closure: the
    /// irradiance that radiosity 1 everywhere would cause.
    pub(super) fn row_sums(&self, cut: &Cut) -> Vec<f64> {
        let of = |&e: &u32| [f64::from(self.closure[e as usize].sends); 3];
        let surfaces: Vec<Rgb> = cut.elements[cut.clusters..].iter().map(of).collect();
        let ones = Outgoing::pull(&self.elements, cut, &surfaces, |_, r| cut.responses[r].ones);
        let Incoming { clusters, surfaces } = gather(&self.elements, cut, &ones);
        cut.expand(&self.elements, &clusters, &surfaces).into_iter().map(|e| e[0]).collect()
    }

    /// Makes the row sums of leaves that see no way out 1: rows of closed scenes sum up to 1 (method E.7), and what
    /// sampling errors add or take away would be multiplied by every bounce.
    ///
    /// Returns the row sums there were.
    pub(super) fn close(&mut self) -> Vec<f64> {
        self.closure.fill(Closure::NONE);
        let mut cut = self.cut();
        let sampled = self.row_sums(&cut);
        let mut sums = sampled.clone();
        for _ in 0..if self.rows == Rows::Balanced { ROUNDS } else { 1 } {
            let (mut off, mut all) = (0.0, 0.0);
            for (e, &sum) in sums.iter().enumerate() {
                let before = self.closure[e].gathers;
                let missing = self.missing(e, f64::from(before) * sum);
                self.closure[e] = match self.rows {
                    Rows::Sampled => Closure::NONE,
                    Rows::Closed => Closure { gathers: missing as f32, sends: 1.0 },
                    Rows::Balanced => {
                        let factor = (before * missing.sqrt() as f32).clamp(LEAST, MOST);
                        Closure { gathers: factor, sends: factor }
                    }
                };
                let element = &self.elements.elements[e];
                if element.is_leaf() && self.closure[e].gathers < MOST && missing != 1.0 {
                    off += element.area * (1.0 / missing - 1.0).powi(2);
                    all += element.area;
                }
            }
            if off <= BALANCED * BALANCED * all {
                break;
            }
            cut.reclose(&self.elements, &self.closure);
            sums = self.row_sums(&cut);
        }
        // What balancing has left is made up where it is gathered.
        for (e, &sum) in sums.iter().enumerate().filter(|_| self.rows == Rows::Balanced) {
            let row = f64::from(self.closure[e].gathers) * sum;
            if row > TOO_MUCH || (row > 1.0 / TOO_MUCH && self.missing(e, row) != 1.0) {
                self.closure[e].gathers /= row as f32;
            }
        }
        sampled
    }

    /// What a leaf must gather more, by its row sum.
    fn missing(&self, e: usize, sum: f64) -> f64 {
        let Shape::Surface { side, .. } = self.elements.elements[e].shape else { return 1.0 };
        let closed = self.probe.closed[side as usize] && sum > NOTHING;
        if closed || sum > TOO_MUCH { 1.0 / sum } else { 1.0 }
    }

    /// Sweeps until the radiosity changes by less than `tolerance` of itself (area-weighted mean), `most` times at most,
    /// then works out the light of all elements. Returns the last change.
    ///
    /// Every sweep gathers from the last one's radiosity (Jacobi), so that threads do not matter; relaxing one element at a
    /// time, in turn or by its residual (Southwell), takes more work and one thread (measured in the tests of `system`). After it all that was
    /// reflected is scaled, by channel, so that its sum is right: the slow even mode of bright scenes, from a coarse level
    /// of one unknown.
    pub(super) fn settle(&mut self, cut: &Cut, tolerance: f64, most: usize) -> f64 {
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
        let mut change = 0.0;
        for _ in 0..most {
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
            change = if total > 0.0 { moved / total } else { 0.0 };
            if change < tolerance {
                state = next;
                break;
            }
            let scale: Rgb = std::array::from_fn(|k| {
                let kept = before[k] - reflected[k];
                if kept > 0.0 { (emitted[k] / kept).clamp(LEAST_SCALE, MOST_SCALE) } else { 1.0 }
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
        change
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
