//! Construction of the tree of the distance cut: surface area heuristic, sixteen children a node, full blocks.

use super::layout::{CutBlock, CutNode, Extinctions, LEAF};
use super::shells::Pieces;
use crate::math::Aabb;
use crate::math::parallel;
use crate::scene::Scene;
use crate::simd::LANES;
use glam::Vec3;
use rayon::prelude::*;

/// Number of bins along the longest side of a large range; selects between splits, whose costs are compared exactly in small ranges.
const BINS: usize = 16;
/// Ranges of at most this many triangles are sorted and split at multiples of sixteen, so that blocks are full.
const SORTED: usize = 1024;
/// Level of nodes from which on ranges are halved, and the largest first, so that no scene makes a tree deeper than
/// [`super::traverse::STACK`] has room for: each further level divides by sixteen, so that 2³² triangles take at most 28 levels.
const MAX_UNEVEN: usize = 20;
/// Ranges of more triangles are built in parallel: with fewer, starting a task takes a notable share of its time. Does not change
/// results.
const PARALLEL: usize = 1 << 14;

/// A triangle to be placed.
#[derive(Clone, Copy)]
struct Item {
    bounds: Aabb,
    centre: Vec3,
    triangle: u32,
}

/// A range of triangles that becomes a child.
struct Part<'a> {
    items: &'a mut [Item],
    bounds: Aabb,
    /// Whether the triangles are parts of large surfaces, which are never aggregated.
    surface: bool,
}

impl<'a> Part<'a> {
    fn of(items: &'a mut [Item], surface: bool) -> Part<'a> {
        let bounds = items.iter().fold(Aabb::EMPTY, |all, item| all.union(item.bounds));
        Part { items, bounds, surface }
    }

    fn is_leaf(&self) -> bool {
        self.items.len() <= LANES
    }

    /// Expected number of tests up to a constant factor: triangles times the probability that a ray meets the box.
    fn weight(&self) -> f32 {
        self.bounds.half_area() * self.items.len() as f32
    }
}

/// Properties of a child besides its place.
#[derive(Clone, Copy, Default)]
pub(super) struct ChildProperties {
    /// Largest size of the pieces; length.
    pub piece: f32,
    /// Diagonal of the box; length.
    pub diameter: f32,
    pub surface: bool,
    /// Levels of nodes below; 0 for a block.
    pub height: usize,
}

/// Properties of the children of a node.
pub(super) type NodeProperties = [ChildProperties; LANES];

/// A tree without extinctions, and the properties of children from which these are measured.
pub(super) struct Draft {
    pub nodes: Vec<CutNode>,
    pub extinctions: Vec<Extinctions>,
    pub blocks: Vec<CutBlock>,
    pub facts: Vec<NodeProperties>,
}

/// Builds the tree over all triangles of a scene; node 0 is the root. Its content does not depend on the number of threads.
/// The first children of the root are the shells, `shell_of` each triangle.
pub(super) fn build(scene: &Scene, pieces: &Pieces, shells: u32, shell_of: &[u32]) -> Draft {
    let item = |triangle: u32| {
        let bounds = Aabb::of(scene.corners(triangle));
        Item { bounds, centre: bounds.center(), triangle }
    };
    let mut items: Vec<Item> = parallel::map(0..scene.triangles.len() as u32, item);
    // Shells, then small pieces, then other large surfaces.
    let group = |item: &Item| match shell_of[item.triangle as usize] {
        u32::MAX => shells + u32::from(pieces.surface[item.triangle as usize]),
        shell => shell,
    };
    parallel::sort_by_key(&mut items, |item| (group(item).into(), item.triangle));
    let (mut kept, mut parts) = (Vec::new(), Vec::new());
    for items in items.chunk_by_mut(|a, b| group(a) == group(b)) {
        let group = group(&items[0]);
        let part = Part::of(items, group != shells);
        if group < shells { kept.push(part) } else { parts.push(part) }
    }
    let context = Context { scene, pieces };
    context.node(kept, parts, 0).0
}

struct Context<'a> {
    scene: &'a Scene,
    pieces: &'a Pieces,
}

impl Context<'_> {
    /// The tree below a node with these parts and the others, divided into as many as fit; and the largest size of their pieces.
    fn node<'p>(&self, mut parts: Vec<Part<'p>>, others: Vec<Part<'p>>, depth: usize) -> (Draft, f32) {
        let room = LANES - parts.len();
        parts.extend(divide(others, room, depth >= MAX_UNEVEN));
        let around = parts.iter().fold(Aabb::EMPTY, |all, part| all.union(part.bounds));
        let mut node = CutNode::within(around);
        let mut facts = [ChildProperties::default(); LANES];
        let places: Vec<(Aabb, bool)> = parts.iter().map(|part| (part.bounds, part.surface)).collect();
        let count: usize = parts.iter().map(|part| part.items.len()).sum();
        let below: Vec<(Draft, f32)> = match count > PARALLEL {
            true => parts.into_par_iter().map(|part| self.child(part, depth + 1)).collect(),
            false => parts.into_iter().map(|part| self.child(part, depth + 1)).collect(),
        };
        let mut draft = Draft { nodes: vec![], extinctions: vec![], blocks: vec![], facts: vec![] };
        draft.nodes.push(node.clone());
        draft.extinctions.push(Extinctions::NONE);
        draft.facts.push(facts);
        let mut largest: f32 = 0.0;
        for (lane, ((child, piece), (bounds, surface))) in below.into_iter().zip(places).enumerate() {
            let (first_node, first_block) = (draft.nodes.len() as u32, draft.blocks.len() as u32);
            let address = if child.nodes.is_empty() { first_block | LEAF } else { first_node };
            node.place(lane, address, bounds);
            facts[lane] = ChildProperties {
                piece,
                diameter: bounds.diagonal(),
                surface,
                height: child
                    .facts
                    .first()
                    .map_or(0, |below| 1 + below.iter().map(|child| child.height).max().unwrap_or(0)),
            };
            largest = largest.max(piece);
            draft.append(child, first_node, first_block);
        }
        (draft.nodes[0], draft.facts[0]) = (node, facts);
        (draft, largest)
    }

    fn child(&self, part: Part, depth: usize) -> (Draft, f32) {
        if !part.is_leaf() {
            return self.node(vec![], vec![part], depth);
        }
        let triangles = part.items.iter().map(|item| self.scene.corners(item.triangle));
        let largest =
            part.items.iter().map(|item| self.pieces.size[item.triangle as usize]).fold(0.0, f32::max);
        let blocks = vec![CutBlock::of(triangles)];
        (Draft { nodes: vec![], extinctions: vec![], blocks, facts: vec![] }, largest)
    }
}

impl Draft {
    /// Adds a subtree whose addresses count from zero.
    fn append(&mut self, other: Draft, first_node: u32, first_block: u32) {
        self.blocks.extend(other.blocks);
        self.extinctions.extend(other.extinctions);
        self.nodes.extend(other.nodes.into_iter().map(|mut node| {
            for child in &mut node.child {
                *child += if *child & LEAF == 0 { first_node } else { first_block };
            }
            node
        }));
        self.facts.extend(other.facts);
    }
}

/// Splits the heaviest part until there are `room` parts or none can be split; into equal numbers of triangles if `halve` is set.
fn divide(mut parts: Vec<Part>, room: usize, halve: bool) -> Vec<Part> {
    while parts.len() < room {
        let weight = |part: &Part| if halve { part.items.len() as f32 } else { part.weight() };
        let heaviest = (0..parts.len())
            .filter(|&k| !parts[k].is_leaf())
            .max_by(|&a, &b| weight(&parts[a]).total_cmp(&weight(&parts[b])).then(b.cmp(&a)));
        let Some(k) = heaviest else { break };
        let Part { items, bounds: _, surface } = parts.swap_remove(k);
        let middle = if halve { halved(items) } else { split(items) };
        let (left, right) = items.split_at_mut(middle);
        parts.push(Part::of(left, surface));
        parts.push(Part::of(right, surface));
    }
    parts
}

/// Divides a range into equal numbers along its longest side.
fn halved(items: &mut [Item]) -> usize {
    let axis = Aabb::of(items.iter().map(|item| item.centre)).extent().max_position();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| {
        a.centre[axis].total_cmp(&b.centre[axis]).then(a.triangle.cmp(&b.triangle))
    });
    middle
}

/// Orders a range so that both sides of the returned place are compact.
fn split(items: &mut [Item]) -> usize {
    let found = if items.len() <= SORTED { sorted(items) } else { binned(items) };
    found.clamp(1, items.len() - 1)
}

/// The best split of a small range at a multiple of sixteen, of 64 if it has more than 256 triangles, along any axis.
fn sorted(items: &mut [Item]) -> usize {
    let unit = if items.len() > LANES * LANES { 4 * LANES } else { LANES };
    let mut best = (f32::INFINITY, 0, unit);
    let order = |items: &mut [Item], axis: usize| {
        items.sort_unstable_by(|a, b| {
            a.centre[axis].total_cmp(&b.centre[axis]).then(a.triangle.cmp(&b.triangle))
        });
    };
    for axis in 0..3 {
        order(items, axis);
        let mut cost = vec![0.0; items.len().div_ceil(unit)];
        let mut all = Aabb::EMPTY;
        for (k, item) in items.iter().enumerate() {
            if k % unit == 0 && k > 0 {
                cost[k / unit] += all.half_area() * k as f32;
            }
            all = all.union(item.bounds);
        }
        let mut all = Aabb::EMPTY;
        for (k, item) in items.iter().enumerate().rev() {
            all = all.union(item.bounds);
            if k % unit == 0 && k > 0 {
                cost[k / unit] += all.half_area() * (items.len() - k) as f32;
            }
        }
        for (k, &cost) in cost.iter().enumerate().skip(1) {
            if cost < best.0 {
                best = (cost, axis, k * unit);
            }
        }
    }
    order(items, best.1);
    best.2
}

/// The best split of a large range between bins of its longest side.
fn binned(items: &mut [Item]) -> usize {
    let centres = Aabb::of(items.iter().map(|item| item.centre));
    let axis = centres.extent().max_position();
    let (low, extent) = (centres.min[axis], centres.extent()[axis]);
    if extent <= 0.0 {
        return items.len() / 2;
    }
    let bin = |item: &Item| (((item.centre[axis] - low) / extent * BINS as f32) as usize).min(BINS - 1);
    let mut bins = [(Aabb::EMPTY, 0usize); BINS];
    for item in items.iter() {
        let (all, count) = &mut bins[bin(item)];
        (*all, *count) = (all.union(item.bounds), *count + 1);
    }
    let mut left = [0.0f32; BINS];
    let (mut all, mut count) = (Aabb::EMPTY, 0);
    for k in 0..BINS - 1 {
        (all, count) = (all.union(bins[k].0), count + bins[k].1);
        left[k + 1] = all.half_area() * count as f32;
    }
    let (mut all, mut count, mut best) = (Aabb::EMPTY, 0, (f32::INFINITY, 1));
    for k in (1..BINS).rev() {
        (all, count) = (all.union(bins[k].0), count + bins[k].1);
        let cost = left[k] + all.half_area() * count as f32;
        if count > 0 && count < items.len() && cost < best.0 {
            best = (cost, k);
        }
    }
    // Triangles on the same side keep their order, so that the result is the same on any number of threads.
    items.sort_by_key(|item| bin(item) >= best.1);
    items.partition_point(|item| bin(item) < best.1)
}
