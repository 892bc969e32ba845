//! Sweeps until the light no longer changes.

use super::Solver;
use super::cut::{Cut, Kind};
use super::field::{Incoming, Outgoing, Rgb, add, gather};
use crate::element::Shape;

/// A leaf without a way out that sees hardly anything along its links is not mended: nothing is known of it.
const NOTHING: f64 = 0.01;
/// Row sums of other leaves above this are wrong.
const TOO_MUCH: f64 = 1.25;
/// Rounds of balancing.
const BALANCING: usize = 12;
/// Largest factor of a leaf, and one over the smallest.
const MOST: f64 = 30.0;
/// Largest and least share of the last step that is taken back or on.
const STEPS: [f64; 2] = [-50.0, 0.9];

impl Solver<'_> {
    /// What is emitted, without any link.
    pub(super) fn start(&mut self) {
        self.incident = vec![[0.0; 3]; self.elements.len()];
        self.closure = vec![1.0; self.elements.len()];
        self.shine();
        self.look();
    }

    /// The cut for the present links.
    pub(super) fn cut(&self) -> Cut {
        Cut::new(&self.elements, &self.links, &self.closure)
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
        let of = |&e: &u32| [f64::from(self.closure[e as usize]); 3];
        let surfaces: Vec<Rgb> = cut.elements[cut.clusters..].iter().map(of).collect();
        let ones = Outgoing::pull(&self.elements, cut, &surfaces, |_, r| cut.responses[r].ones);
        let Incoming { clusters, surfaces } = gather(&self.elements, cut, &ones);
        cut.expand(&self.elements, &clusters, &surfaces).into_iter().map(|e| e[0]).collect()
    }

    /// Makes the row sums of leaves that see no way out 1: rows of closed scenes sum up to 1 (method E.7), and what
    /// sampling errors add or take away would be multiplied by every bounce.
    ///
    /// Every leaf gets a factor for what it gathers and for what it sends alike (the symmetric balancing of Sinkhorn and
    /// Knopp 1967), so that factors stay reciprocal and no energy is made. Returns the row sums there were.
    pub(super) fn close(&mut self) -> Vec<f64> {
        self.closure.fill(1.0);
        let sampled = self.row_sums(&self.cut());
        let mut sums = sampled.clone();
        for round in 0..BALANCING {
            if round > 0 {
                sums = self.row_sums(&self.cut());
            }
            for e in 0..self.closure.len() {
                let closure = f64::from(self.closure[e]);
                let missing = self.missing(e, closure * sums[e]);
                self.closure[e] = (closure * missing.sqrt()).clamp(1.0 / MOST, MOST) as f32;
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
    /// Every sweep gathers from the last one's radiosity (Jacobi), so that threads do not matter; the two last residuals
    /// are combined to make the next start better (Anderson 1965, depth 1, by channel), which takes out the slow even
    /// mode of bright scenes.
    pub(super) fn settle(&mut self, cut: &Cut, tolerance: f64, most: usize) -> f64 {
        // The unknowns: what arrives at the ends of the cut.
        let mut state = self.arriving(cut);
        let mut last: Option<(Vec<Rgb>, Vec<Rgb>)> = None;
        let mut change = 0.0;
        for _ in 0..most {
            let outgoing = self.outgoing(cut, &state);
            let next = gather(&self.elements, cut, &outgoing);
            let made = flat(&next);
            let then = flat(&state);
            let (mut moved, mut total) = (0.0, 0.0);
            let mut products = [[0.0; 2]; 3];
            for i in 0..made.len() {
                let weight = self.weight(cut, i);
                for k in 0..3 {
                    let residual = made[i][k] - then[i][k];
                    moved += weight * residual.abs();
                    total += weight * made[i][k];
                    if let Some((before, result)) = &last {
                        let difference = residual - (result[i][k] - before[i][k]);
                        products[k][0] += weight * residual * difference;
                        products[k][1] += weight * difference * difference;
                    }
                }
            }
            change = if total > 0.0 { moved / total } else { 0.0 };
            state = next;
            if change < tolerance {
                break;
            }
            if let Some((_, result)) = &last {
                let share =
                    products.map(|[a, b]| if b > 0.0 { (a / b).clamp(STEPS[0], STEPS[1]) } else { 0.0 });
                let mixed = |i: usize| {
                    std::array::from_fn(|k| (made[i][k] - share[k] * (made[i][k] - result[i][k])).max(0.0))
                };
                state = shaped(cut, (0..made.len()).map(mixed));
            }
            last = Some((then, made));
        }
        let incident = cut.expand(&self.elements, &state.clusters, &state.surfaces);
        self.incident = incident
            .into_iter()
            .zip(&self.closure)
            .map(|(e, &closure)| e.map(|v| v * f64::from(closure)))
            .collect();
        self.shine();
        self.state = Some((cut.elements.len(), state));
        change
    }

    /// What arrives, from the last solution if the cut has not changed; nothing otherwise.
    fn arriving(&mut self, cut: &Cut) -> Incoming {
        match self.state.take() {
            Some((places, state)) if places == cut.elements.len() => state,
            _ => Incoming {
                clusters: vec![Default::default(); cut.clusters],
                surfaces: vec![[0.0; 3]; cut.elements.len() - cut.clusters],
            },
        }
    }

    fn outgoing(&self, cut: &Cut, state: &Incoming) -> Outgoing {
        let surfaces: Vec<Rgb> = (cut.clusters..cut.elements.len())
            .map(|p| {
                let e = cut.elements[p] as usize;
                let Shape::Surface { side, .. } = self.elements.elements[e].shape else { return [0.0; 3] };
                let s = &self.elements.sides[side as usize];
                let closure = f64::from(self.closure[e]);
                let incident = state.surfaces[p - cut.clusters];
                std::array::from_fn(|k| s.exitance[k] + f64::from(s.reflectance[k]) * closure * incident[k])
            })
            .collect();
        Outgoing::pull(&self.elements, cut, &surfaces, |p, r| cut.responses[r].answer(&state.clusters[p]))
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
