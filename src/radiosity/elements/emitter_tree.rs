//! A tree over emitting faces, by which a receiver draws faces with probabilities close to the light that they send it.
//!
//! Each node bounds positions and normals of its faces, which gives an estimate of its irradiance at a receiver that is 0 only where
//! no face can light the receiver (Conty Estevez and Kulla 2018). A receiver divides the faces into a few nodes, a cut through the
//! tree; it draws a node by that estimate, then a face of the node by power.

use crate::math::Aabb;
use crate::math::parallel;
use crate::math::sampling::pick;
use glam::Vec3;

/// Nodes of a cut: as many as a packet has segments, so that each segment of a packet can have a node of its own.
const MAX_CUT: usize = 16;

/// Height above a plane, relative to the largest coordinates, up to which a surface counts as lying in it: 16 roundings of f32.
const COPLANAR: f32 = 16.0 * f32::EPSILON;

/// A receiver for which faces are drawn.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// Centre of the sphere that holds all its points.
    pub centre: Vec3,
    /// Radius of that sphere, scene units.
    pub radius: f32,
    /// Unit normal.
    pub normal: Vec3,
}

/// A group of faces.
#[derive(Clone)]
struct EmitterNode {
    /// Centre and radius of a sphere around the faces.
    centre: Vec3,
    radius: f32,
    /// Mean direction of the normals, a unit vector, and the cosine of the largest angle to it.
    axis: Vec3,
    spread: f32,
    /// Emitted power over π, W/π.
    power: f32,
    /// The range of its faces in the order of the tree.
    faces: [u32; 2],
    /// The second child; the first one follows its parent. 0 for single faces.
    second: u32,
}

/// Bounding tree over emitting faces.
pub struct EmitterTree {
    nodes: Vec<EmitterNode>,
}

/// The nodes from which a receiver draws faces.
#[derive(Clone, Debug, Default)]
pub struct EmitterCut {
    nodes: Vec<u32>,
    bounds: Vec<f32>,
    /// Running sums of the bounds, in the order of the faces.
    sums: Vec<f32>,
}

/// A face while the tree is built.
#[derive(Clone, Copy)]
struct Face {
    id: (u32, u32),
    bounds: Aabb,
    centre: Vec3,
    normal: Vec3,
    power: f32,
}

/// Faces of a subtree from which its halves are built on two threads: a task of about 0.1 ms.
const PARALLEL_FACES: usize = 1 << 10;

impl EmitterCut {
    /// Removes all nodes: no face is drawn, and the light of emitters that rays meet counts fully.
    pub fn clear(&mut self) {
        self.nodes.clear();
        self.bounds.clear();
        self.sums.clear();
    }
}

impl EmitterTree {
    /// Builds the tree and brings `faces` into its order.
    pub fn build(
        faces: &mut [(u32, u32)],
        of: &(impl Fn((u32, u32)) -> [Vec3; 4] + Sync),
        face: &(impl Fn((u32, u32)) -> (Vec3, f32) + Sync),
    ) -> EmitterTree {
        let known = |&id: &(u32, u32)| {
            let (corners, (normal, power)) = (of(id), face(id));
            Face { id, bounds: Aabb::of(corners), centre: corners.iter().sum::<Vec3>(), normal, power }
        };
        let mut known: Vec<Face> = parallel::map(parallel::at_least(PARALLEL_FACES, &*faces), known);
        let mut nodes = vec![EmitterNode::NONE; (2 * known.len()).saturating_sub(1)];
        if !known.is_empty() {
            add(&mut known, 0, &mut nodes, 0);
        }
        faces.iter_mut().zip(known).for_each(|(place, face)| *place = face.id);
        EmitterTree { nodes }
    }

    /// The cut for a receiver: the node with the largest bound is divided first.
    pub fn cut(&self, receiver: &Receiver, cut: &mut EmitterCut) {
        cut.clear();
        if self.nodes.is_empty() {
            return;
        }
        cut.nodes.push(0);
        cut.bounds.push(self.nodes[0].bound(receiver));
        while cut.nodes.len() < MAX_CUT {
            let divisible =
                |i: &usize| self.nodes[cut.nodes[*i] as usize].second != 0 && cut.bounds[*i] > 0.0;
            let largest = (0..cut.nodes.len())
                .filter(divisible)
                .max_by(|&i, &j| cut.bounds[i].total_cmp(&cut.bounds[j]));
            let Some(i) = largest else { break };
            let [first, second] = [cut.nodes[i] + 1, self.nodes[cut.nodes[i] as usize].second];
            let [a, b] = [first, second].map(|n| self.nodes[n as usize].bound(receiver));
            (cut.nodes[i], cut.bounds[i]) = (first, a);
            cut.nodes.insert(i + 1, second);
            cut.bounds.insert(i + 1, b);
        }
        let mut sum = 0.0;
        cut.sums.extend(cut.bounds.iter().map(|b| {
            sum += b;
            sum
        }));
    }

    /// The faces of a cut, as places in the tree's order, if each of its nodes that can light the receiver is a single face.
    pub fn faces<'c>(&'c self, cut: &'c EmitterCut) -> Option<impl Iterator<Item = u32> + 'c> {
        let lit = || cut.nodes.iter().zip(&cut.bounds).filter(|(_, bound)| **bound > 0.0);
        let node = |n: u32| &self.nodes[n as usize];
        lit().all(|(n, _)| node(*n).second == 0).then(|| lit().map(move |(n, _)| node(*n).faces[0]))
    }

    /// Estimated error if one value represents the direct light of a receiver of some area, as a fraction of the power of all faces:
    /// the fraction that may arrive there, times (radius / distance)² where the receiver is small against the distance. Groups of faces
    /// that contribute less than a tenth of `limit` are not opened.
    pub fn variation(&self, receiver: &Receiver, area: f32, limit: f32) -> f32 {
        let Some(root) = self.nodes.first() else { return 0.0 };
        let (all, mut sum) = (std::f32::consts::PI * root.power, 0.0);
        let (mut open, mut depth) = ([0u32; 64], usize::from(root.power > 0.0));
        while depth > 0 && sum <= limit {
            depth -= 1;
            let node = &self.nodes[open[depth] as usize];
            if node.second == 0 && !node.sees(receiver) {
                continue;
            }
            let arrives = (node.bound(receiver) * area).min(std::f32::consts::PI * node.power);
            let distance = (node.centre - receiver.centre).length();
            let nearest = if node.second == 0 { distance.max(node.radius) } else { distance - node.radius };
            let ratio = (receiver.radius / nearest.max(receiver.radius)).powi(2);
            let error = arrives / all * ratio;
            if node.second == 0 || error <= 0.1 * limit || depth + 2 > open.len() {
                sum += error;
            } else {
                (open[depth], open[depth + 1]) = (open[depth] + 1, node.second);
                depth += 2;
            }
        }
        sum
    }

    /// The range of faces that `u` in `[0, 1)` selects, the remainder of `u`, and the probability of the range over its power.
    /// None if no face can light the receiver.
    pub fn draw(&self, cut: &EmitterCut, u: f32) -> Option<([u32; 2], f32, f32)> {
        let total = *cut.sums.last().filter(|sum| **sum > 0.0)?;
        let (i, u, bound) = pick(&cut.sums, u);
        let node = &self.nodes[cut.nodes[i] as usize];
        Some((node.faces, u, bound / total / node.power))
    }

    /// The probability of the range that holds a face (its place in the tree's order) over the power of the range.
    pub fn probability(&self, cut: &EmitterCut, face: u32) -> f32 {
        let total = cut.sums.last().copied().unwrap_or(0.0);
        let i = cut.nodes.partition_point(|&n| self.nodes[n as usize].faces[1] <= face);
        match cut.nodes.get(i) {
            Some(&n) if total > 0.0 => cut.bounds[i] / total / self.nodes[n as usize].power,
            _ => 0.0,
        }
    }
}

/// Builds the subtree of some faces, of which the first has the place `first`, in `nodes`, of which the first has the index `at`.
fn add(faces: &mut [Face], first: u32, nodes: &mut [EmitterNode], at: u32) {
    let sum: Vec3 = faces.iter().map(|f| f.normal * f.power).sum();
    let axis = sum.try_normalize().unwrap_or(Vec3::Z);
    let (mut bounds, mut centres) = (Aabb::EMPTY, Aabb::EMPTY);
    for face in faces.iter() {
        bounds = bounds.union(face.bounds);
        centres = centres.union(Aabb::of([face.centre]));
    }
    let count = faces.len();
    nodes[0] = EmitterNode {
        centre: 0.5 * (bounds.min + bounds.max),
        radius: 0.5 * bounds.diagonal(),
        axis,
        spread: faces.iter().map(|f| axis.dot(f.normal)).fold(1.0, f32::min),
        power: faces.iter().map(|f| f.power).sum(),
        faces: [first, first + count as u32],
        second: 0,
    };
    if count < 2 {
        return;
    }
    let longest = centres.extent().max_position();
    let middle = count / 2;
    let order = |f: &Face| (f.centre[longest], f.id);
    faces.select_nth_unstable_by(middle, |a, b| {
        let ((p, i), (q, k)) = (order(a), order(b));
        p.total_cmp(&q).then(i.cmp(&k))
    });
    let (left, right) = faces.split_at_mut(middle);
    // A subtree of n faces has 2 n - 1 nodes.
    let (near, far) = nodes[1..].split_at_mut(2 * middle - 1);
    let second = at + 2 * middle as u32;
    let mut near = || add(left, first, near, at + 1);
    let mut far = || add(right, first + middle as u32, far, second);
    if count > PARALLEL_FACES {
        parallel::join(near, far);
    } else {
        near();
        far();
    }
    nodes[0].second = second;
}

impl EmitterNode {
    const NONE: EmitterNode = EmitterNode {
        centre: Vec3::ZERO,
        radius: 0.0,
        axis: Vec3::Z,
        spread: 1.0,
        power: 0.0,
        faces: [0, 0],
        second: 0,
    };

    /// Whether parts of a single face and of the receiver lie above each other's planes by more than rounding. This excludes a receiver
    /// that is part of the face itself.
    fn sees(&self, receiver: &Receiver) -> bool {
        let to = self.centre - receiver.centre;
        let sine = self.axis.cross(receiver.normal).length();
        let places = self.centre.abs().max(receiver.centre.abs());
        let least = COPLANAR * (places.max_element() + self.radius + receiver.radius);
        receiver.normal.dot(to) + sine * self.radius > least
            && -self.axis.dot(to) + sine * receiver.radius > least
    }

    /// Irradiance of the receiver, with the largest cosines at both ends and the distance between the centres; 0 only if none of the
    /// faces can light any point of the receiver.
    fn bound(&self, receiver: &Receiver) -> f32 {
        let to = self.centre - receiver.centre;
        let (d2, reach) = (to.length_squared(), self.radius + receiver.radius);
        let near = (reach * reach).max(f32::MIN_POSITIVE);
        if d2 <= near {
            return self.power / near;
        }
        let d = d2.sqrt();
        // Angle under which both spheres together appear.
        let apart = Angle::of_sine(reach / d);
        let arrives = Angle::of_cosine(receiver.normal.dot(to) / d).less(apart);
        let leaves = Angle::of_cosine(-self.axis.dot(to) / d).less(Angle::of_cosine(self.spread)).less(apart);
        self.power * arrives.cosine.max(0.0) * leaves.cosine.max(0.0) / d2
    }
}

/// An angle in `[0, π]`.
#[derive(Clone, Copy)]
struct Angle {
    cosine: f32,
    sine: f32,
}

impl Angle {
    fn of_cosine(cosine: f32) -> Angle {
        let cosine = cosine.clamp(-1.0, 1.0);
        Angle { cosine, sine: (1.0 - cosine * cosine).sqrt() }
    }

    /// At most a right angle.
    fn of_sine(sine: f32) -> Angle {
        Angle { cosine: (1.0 - sine * sine).max(0.0).sqrt(), sine }
    }

    /// The difference, at least 0.
    fn less(self, other: Angle) -> Angle {
        if self.cosine >= other.cosine {
            return Angle { cosine: 1.0, sine: 0.0 };
        }
        Angle {
            cosine: self.cosine * other.cosine + self.sine * other.sine,
            sine: self.sine * other.cosine - self.cosine * other.sine,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sampling::numbers;

    /// Corners, and normals with powers.
    type TestFaces = (Vec<[Vec3; 4]>, Vec<(Vec3, f32)>);

    /// Small squares at random places, turned at random.
    fn tree(count: u64) -> (EmitterTree, Vec<(u32, u32)>, TestFaces) {
        let (mut corners, mut faces) = (Vec::new(), Vec::new());
        for k in 0..count {
            let [x, y, z, w] = numbers(1, k);
            let [a, b, c, _] = numbers(2, k);
            let normal = (Vec3::new(a, b, c) - 0.5).normalize();
            let (u, v) = normal.any_orthonormal_pair();
            let at = 4.0 * Vec3::new(x, y, z);
            corners.push([at, at + 0.1 * u, at + 0.1 * (u + v), at + 0.1 * v]);
            faces.push((normal, 0.1 + w));
        }
        let mut order: Vec<(u32, u32)> = (0..count as u32).map(|k| (0, k)).collect();
        let tree = EmitterTree::build(&mut order, &|f| corners[f.1 as usize], &|f| faces[f.1 as usize]);
        (tree, order, (corners, faces))
    }

    /// Every face that can light some point of the receiver can be drawn, and probabilities sum to one.
    #[test]
    fn no_light_is_lost_and_probabilities_sum_to_one() {
        let (tree, order, (corners, faces)) = tree(100);
        let mut cut = EmitterCut::default();
        for k in 0..200 {
            let [x, y, z, w] = numbers(5, k);
            let normal =
                (Vec3::from(numbers(6, k).first_chunk::<3>().copied().unwrap_or_default()) - 0.5).normalize();
            let receiver = Receiver { centre: 4.0 * Vec3::new(x, y, z), radius: 0.2 * w, normal };
            tree.cut(&receiver, &mut cut);
            let mut sum = 0.0;
            for (place, &f) in (0u32..).zip(&order) {
                let (corners, (facing, power)) = (&corners[f.1 as usize], faces[f.1 as usize]);
                let probability = tree.probability(&cut, place) * power;
                sum += probability;
                let to = corners[0] - receiver.centre;
                // Cosines above some roundings.
                let least = 1e-3 * to.length();
                if normal.dot(to) > least && facing.dot(-to) > least {
                    assert!(probability > 0.0, "receiver {k}, face {f:?}");
                }
            }
            // A receiver that turns away from all faces draws none.
            assert!((sum - 1.0).abs() < 1e-3 || tree.draw(&cut, 0.5).is_none(), "receiver {k}: {sum}");
        }
    }

    /// Draws have the probabilities that are stated.
    #[test]
    fn draws_have_their_probabilities() {
        let (tree, order, (_, faces)) = tree(40);
        let mut cut = EmitterCut::default();
        tree.cut(&Receiver { centre: Vec3::splat(2.0), radius: 0.1, normal: Vec3::Z }, &mut cut);
        let draws = 100_000;
        let mut found = vec![0u32; cut.nodes.len()];
        for k in 0..draws {
            let (range, rest, density) = tree.draw(&cut, (k as f32 + 0.5) / draws as f32).expect("lit");
            assert!((0.0..=1.0).contains(&rest));
            let i = cut.nodes.iter().position(|&n| tree.nodes[n as usize].faces == range).expect("a node");
            found[i] += 1;
            let stated = tree.probability(&cut, range[0]);
            assert!((density - stated).abs() <= 1e-5 * stated, "{density} {stated}");
        }
        for (i, &n) in cut.nodes.iter().enumerate() {
            let node = &tree.nodes[n as usize];
            let power: f32 =
                (node.faces[0]..node.faces[1]).map(|p| faces[order[p as usize].1 as usize].1).sum();
            let want = power * tree.probability(&cut, node.faces[0]);
            let part = found[i] as f32 / draws as f32;
            assert!((part - want).abs() < 1e-3, "{part} {want}");
        }
    }
}
