//! Importance for points: the weight of an error of an element's light at the requested points.

use super::linked_scene::{LinkedScene, PointsView};
use crate::math::parallel;
use crate::math::sampling::{cosine_direction, mix, numbers};
use crate::radiosity::elements::{ChildrenOutlines, Elements, Lookup};
use crate::radiosity::surroundings::{ESCAPED, SideRays};
use crate::ray::EndRule;
use crate::scene::magnitude;
use crate::visibility::Exact;
use glam::Vec3;

/// Number of paths from all points together: where a thousandth of them ends, importance has an error of 1/√16 = 25 %.
const PATHS: usize = 1 << 14;
/// Rays of a path: the weight of later ones is (reflectance)³ at most.
const BOUNCES: usize = 3;
/// Smallest number of path ends from which the importance of a cluster or surface is known; others share the remaining importance of
/// their parent.
const MIN_ENDS: u32 = 16;
/// Fraction of importance that is the same everywhere: surfaces that points see get light from elsewhere, and the energy balance needs a
/// correct exchange in rooms that no point sees. The mean by area is at most 1, so that rays of such rooms are at most halved.
pub const UNIFORM_IMPORTANCE: f64 = 0.5;
/// Points of one parallel task: one packet.
const CHUNK: usize = 16;

/// The end of a path, and the fraction of the light sent from there that reaches the start of the path.
struct PathEnd {
    side: u32,
    at: Vec3,
    share: f64,
    /// Whether it is the first end of its path.
    first: bool,
}

impl LinkedScene {
    /// Sets importance from the surfaces that points (relative to the origin of the scene; position, unit normal) see directly and by
    /// reflection: light reaches a point along the same paths that start from it. Surfaces are split where many paths end, so that the
    /// importance of a hut's floor is not spread over the plain that it is a part of.
    pub fn look_from(&mut self, points: &[(Vec3, Vec3)], exact: &Exact) {
        let (paths, open, ends) = self.paths_from(points, exact);
        let leaves = self.split_at_ends(&ends);
        let elements = &self.elements.elements;
        let mut sums = vec![(0.0, 0u32); elements.len()];
        for (leaf, share, count) in leaves {
            sums[leaf as usize] = (share, count);
        }
        for e in (1..elements.len()).rev() {
            let (own, parent) = (sums[e], elements[e].parent as usize);
            sums[parent] = (sums[parent].0 + own.0, sums[parent].1 + own.1);
        }
        let mean = sums[0].0 / elements[0].area;
        if mean <= 0.0 {
            return;
        }
        let first: f64 = ends.iter().filter(|end| end.first).map(|end| end.share).sum();
        self.points_view = Some(PointsView { reflected: first / paths as f64, open });
        let parents: Vec<u32> = elements[..].iter().map(|element| element.parent).collect();
        let parts: Vec<(f64, f64, u32)> = sums
            .iter()
            .zip(&elements[..])
            .map(|(&(sum, count), element)| (sum / mean, element.area, count))
            .collect();
        for (state, importance) in self.elements.states.iter_mut().zip(densities(&parents, &parts)) {
            state.importance = (UNIFORM_IMPORTANCE + (1.0 - UNIFORM_IMPORTANCE) * importance) as f32;
        }
    }

    /// Splits leaves as long as the parts of a leaf may have [`MIN_ENDS`] ends each. Returns the leaves at which paths end, with the sum of
    /// their shares and their number.
    fn split_at_ends(&mut self, ends: &[PathEnd]) -> Vec<(u32, f64, u32)> {
        let lookup = Lookup::new(&self.elements);
        let mut at_leaf: Vec<(u32, u32)> =
            (0..).zip(ends).map(|(k, end)| (lookup.leaf(end.side, end.at), k)).collect();
        at_leaf.sort_unstable();
        let of_leaf = |group: &[(u32, u32)]| (group[0].0, group.iter().map(|of| of.1).collect());
        let mut left: Vec<(u32, Vec<u32>)> = at_leaf.chunk_by(|a, b| a.0 == b.0).map(of_leaf).collect();
        let mut found = Vec::new();
        while let Some((leaf, of_leaf)) = left.pop() {
            let first = self.elements.len() as u32;
            if of_leaf.len() as u32 >= 4 * MIN_ENDS {
                self.split(leaf);
            }
            if self.elements.len() as u32 == first {
                let share = of_leaf.iter().map(|&k| ends[k as usize].share).sum();
                found.push((leaf, share, of_leaf.len() as u32));
                continue;
            }
            let parts = ChildrenOutlines::of(&self.elements, leaf);
            let mut of_parts = vec![Vec::new(); self.elements.len() - first as usize];
            for k in of_leaf {
                of_parts[(parts.child_at(ends[k as usize].at) - first) as usize].push(k);
            }
            left.extend((first..).zip(of_parts));
        }
        found
    }

    /// The number of paths from points, [`PointsView::open`], and their ends.
    fn paths_from(&self, points: &[(Vec3, Vec3)], exact: &Exact) -> (usize, f64, Vec<PathEnd>) {
        let Elements { sides, .. } = &self.elements;
        let tracer = SideRays { elements: &self.elements, exact, length: self.surroundings.length };
        let each = PATHS.div_ceil(points.len().max(1));
        // If there are many points, a random subset is used: every n-th point may lie in one column of a grid.
        let drawn = |i: usize| mix(!self.settings.seed ^ i as u64) % (points.len() as u64) < PATHS as u64;
        let chosen: Vec<(usize, &(Vec3, Vec3))> =
            points.iter().enumerate().filter(|of| drawn(of.0)).collect();
        let of_chunk = |chunk: &[(usize, &(Vec3, Vec3))]| {
            let (mut packets, mut ends, mut sent, mut gone) = (Vec::new(), Vec::new(), 0.0, 0.0);
            let start = |&(i, &(at, normal)): &(usize, &(Vec3, Vec3))| {
                let end = EndRule::new(magnitude([at]));
                (0..each)
                    .map(move |k| ((at, normal, end), 1.0, mix(self.settings.seed ^ i as u64) ^ k as u64))
            };
            let mut paths: Vec<_> = chunk.iter().flat_map(start).collect();
            for bounce in 0..BOUNCES {
                let rays = paths.iter().map(|&(from, _, seed)| {
                    let [p, q, ..] = numbers(mix(seed), bounce as u64);
                    (from, cosine_direction(from.1, p, q))
                });
                let (mut next, mut k) = (Vec::new(), 0);
                sent += if bounce > 0 { paths.iter().map(|(_, share, _)| share).sum() } else { 0.0 };
                tracer.trace(rays, &mut packets, |met| {
                    let (_, share, seed) = paths[k];
                    k += 1;
                    gone += if bounce > 0 && met.side == ESCAPED { share } else { 0.0 };
                    let Some(side) = sides.get(met.side as usize) else { return };
                    let share = share * f64::from(side.reflectance.iter().sum::<f32>()) / 3.0;
                    ends.push(PathEnd { side: met.side, at: met.at, share, first: bounce == 0 });
                    next.push(((met.at, side.normal, side.end), share, seed));
                });
                paths = next;
            }
            (sent, gone, ends)
        };
        let made: Vec<(f64, f64, Vec<PathEnd>)> = parallel::map(parallel::chunks(&chosen, CHUNK), of_chunk);
        let [sent, gone] = [made.iter().map(|of| of.0).sum(), made.iter().map(|of| of.1).sum::<f64>()];
        let open = if sent > 0.0 { gone / sent } else { 0.0 };
        (each * chosen.len(), open, made.into_iter().flat_map(|of| of.2).collect())
    }
}

/// Density of a quantity in each element: its amount over its area if it has [`MIN_ENDS`] ends, otherwise the density of what remains of
/// its parent after the siblings with enough ends. `parents` come before their children and the first is its own; `parts` have the
/// quantity, the area and the number of ends. No quantity is counted twice: the sum over the leaves of density times area is at most that
/// of the root.
fn densities(parents: &[u32], parts: &[(f64, f64, u32)]) -> Vec<f64> {
    let is_known = |e: usize| e == 0 || (parts[e].2 >= MIN_ENDS && parts[e].1 > 0.0);
    let mut rest: Vec<(f64, f64)> = parts.iter().map(|&(part, area, _)| (part, area)).collect();
    for e in (1..parts.len()).filter(|&e| is_known(e)) {
        let rest = &mut rest[parents[e] as usize];
        *rest = (rest.0 - parts[e].0, rest.1 - parts[e].1);
    }
    let mut densities = vec![0.0; parts.len()];
    for e in 0..parts.len() {
        let parent = parents[e] as usize;
        densities[e] = match (is_known(e), is_known(parent)) {
            (true, _) => parts[e].0 / parts[e].1,
            (false, true) if rest[parent].1 > 0.0 => rest[parent].0.max(0.0) / rest[parent].1,
            _ => densities[parent],
        };
    }
    densities
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn importance_of_parts_adds_up_to_that_of_the_whole() {
        // A root with three parts, of which two are known; the third and its halves have what is left. One known part has few ends in its
        // own halves.
        let parents = [0, 0, 0, 0, 1, 1, 3, 3];
        let part = |part: f64, area: f64, count: u32| (part, area, count);
        let parts = [
            part(10.0, 10.0, 100),
            part(6.0, 2.0, 60),
            part(3.0, 3.0, 30),
            part(1.0, 5.0, 10),
            part(5.0, 1.0, 50),
            part(1.0, 1.0, 10),
            part(1.0, 2.0, 10),
            part(0.0, 3.0, 0),
        ];
        let found = densities(&parents, &parts);
        assert_eq!(found, [1.0, 3.0, 1.0, 0.2, 5.0, 1.0, 0.2, 0.2]);
        let leaves = [2, 4, 5, 6, 7];
        let sum: f64 = leaves.iter().map(|&e| found[e] * parts[e].1).sum();
        assert!((sum - 10.0).abs() < 1e-12, "{sum}");
    }
}
