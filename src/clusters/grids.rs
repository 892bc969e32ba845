//! Hierarchy of uniform grids [SD95 sec 4.1]; docs/method.md, Clusters.
//!
//! Items enter at the level whose voxels they fit, from the finest to the coarsest. At each level the items of a voxel
//! are grouped with little empty space, straddling items are offered to the groups, and all results move up a level.
//!
//! Choices of ours where the paper gives no details:
//! * The root of the grids is the bounding *cube*: a 2^i-fold division of a flat scene's box gives flat voxels whose
//!   clusters are neither homogeneous nor isotropic.
//! * Items of at most an eighth of the voxel belong to the voxel of their centre (the paper's "very small" items).
//! * More than [`FAN_OUT`] items in a voxel are merged pairwise by least added empty volume, in a window along the
//!   Morton curve: small leaves first, and when no leaves fit together, clusters into larger clusters.

use super::FAN_OUT;
use super::draft::{Draft, Item, Member, one_leaf};
use crate::math::Aabb;
use crate::math::parallel;
use glam::{UVec3, Vec3};

/// Finest level: voxels of 2^-20 of the scene's extent. Three coordinates of 20 bits fit in a 64-bit Morton key (21
/// would be the largest number), and f32 coordinates have 24 bits.
const FINEST_LEVEL: u32 = 20;
/// Largest empty fraction of a group, dimensionless; other items wait for the next level. In a forest 0.5, 0.7 and 0.9
/// leave errors of 0.041, 0.039 and 0.047 at a feature size of 1 m, and 0.026, 0.026 and 0.025 at 0.25 m (`constants.py
/// bench`).
const MAX_EMPTY_FRACTION: f64 = 0.7;
/// Number of neighbours along the Morton curve that are considered for merging. Limits the time to 8 boxes per item. In
/// a forest 4, 8 and 16 leave errors of 0.042, 0.039 and 0.040 at a feature size of 1 m, and 0.026, 0.026 and 0.027 at
/// 0.25 m (`constants.py bench`).
const MORTON_WINDOW: usize = 8;

/// The root cube, with the mapping to integer coordinates of the finest level.
struct Grid {
    base: Vec3,
    scale: f32,
    cube: f32,
}

impl Grid {
    fn around(items: &[Item]) -> Grid {
        let bounds = items.iter().fold(Aabb::EMPTY, |b, i| b.union(i.bounds));
        let cube = bounds.extent().max_element().max(f32::MIN_POSITIVE);
        Grid { base: bounds.min, scale: (1u32 << FINEST_LEVEL) as f32 / cube, cube }
    }

    /// Integer coordinates at the finest level, each below 2^20.
    fn cell(&self, p: Vec3) -> UVec3 {
        ((p - self.base) * self.scale).as_uvec3().min(UVec3::splat((1 << FINEST_LEVEL) - 1))
    }

    /// The finest level whose voxels are at least as large as the item.
    fn level(&self, item: &Item) -> u32 {
        let ratio = self.cube / item.bounds.extent().max_element().max(self.cube * 1e-6);
        (ratio.log2().floor().max(0.0) as u32).min(FINEST_LEVEL)
    }

    /// Position along the Morton curve of the finest level; its high bits are those of every coarser level.
    fn key(&self, item: &Item) -> u64 {
        let spread = |v: u32| {
            let mut v = u64::from(v);
            v = (v | v << 32) & 0x001f_0000_0000_ffff;
            v = (v | v << 16) & 0x001f_0000_ff00_00ff;
            v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
            v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
            (v | v << 2) & 0x1249_2492_4924_9249
        };
        let c = self.cell(item.bounds.center());
        spread(c.x) | spread(c.y) << 1 | spread(c.z) << 2
    }

    /// Whether the item belongs to one voxel of the level: entirely contained, or very small.
    fn belongs(&self, item: &Item, level: u32) -> bool {
        let shift = FINEST_LEVEL - level;
        let voxel = self.cube / (1u32 << level) as f32;
        let (lo, hi) = (self.cell(item.bounds.min), self.cell(item.bounds.max));
        lo >> shift == hi >> shift || item.bounds.extent().max_element() * 8.0 <= voxel
    }
}

/// Clusters `items` into one tree. The draft already holds the clusters that items refer to. None soon after `stopped` returns true.
pub(super) fn cluster(
    mut draft: Draft,
    mut items: Vec<Item>,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Option<Draft> {
    let grid = Grid::around(&items);
    for item in &mut items {
        if let Member::Face(_) = item.member {
            // Flat boxes are thickened to 1e-3 of their longest extent, so that they have a volume.
            let e = item.bounds.extent();
            let thick = e.max(Vec3::splat(1e-3 * e.max_element())).as_dvec3();
            item.occupied = thick.x * thick.y * thick.z;
        }
    }
    let mut waiting: Vec<(u32, Item)> = items.into_iter().map(|i| (grid.level(&i), i)).collect();
    // Finest last: each level takes its items from the end.
    parallel::sort_by_key(&mut waiting, |(level, item)| (u64::from(*level), item.first_face));
    let mut moving: Vec<Item> = Vec::new();
    let mut level = FINEST_LEVEL;
    loop {
        let from = waiting.partition_point(|(l, _)| *l < level);
        moving.extend(waiting.drain(from..).map(|(_, item)| item));
        moving = treat_level(&mut draft, &grid, level, moving, stopped)?;
        if level == 0 {
            break;
        }
        level -= 1;
    }
    while moving.len() > FAN_OUT {
        moving = emit(&mut draft, vec![thin_out(moving)]);
    }
    match moving.as_slice() {
        [only] if matches!(only.member, Member::Cluster(c) if c as usize + 1 == draft.clusters.len()) => {}
        [] => {}
        several => {
            draft.group(several);
        }
    }
    Some(draft)
}

/// Groups of one voxel, in order. A group of one is the item itself.
type Groups = Vec<Vec<Item>>;

fn treat_level(
    draft: &mut Draft,
    grid: &Grid,
    level: u32,
    items: Vec<Item>,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<Item>> {
    if items.len() < 2 {
        return Some(items);
    }
    let keys = parallel::map(&items, |item| grid.key(item));
    let mut keyed: Vec<(u64, Item)> = keys.into_iter().zip(items).collect();
    parallel::sort_by_key(&mut keyed, |(key, item)| (*key, item.first_face));
    let shift = 3 * (FINEST_LEVEL - level);
    let voxels: Vec<&[(u64, Item)]> = keyed.chunk_by(|a, b| a.0 >> shift == b.0 >> shift).collect();
    let of_voxel = |voxel: &&[(u64, Item)]| (!stopped()).then(|| treat_voxel(grid, level, voxel));
    let groups: Vec<Groups> = parallel::some_map(&voxels, of_voxel)?;
    Some(emit(draft, groups))
}

/// Makes clusters of the groups; single items pass through.
fn emit(draft: &mut Draft, voxels: Vec<Groups>) -> Vec<Item> {
    let mut passed = Vec::new();
    for group in voxels.into_iter().flatten() {
        match <[Item; 1]>::try_from(group) {
            Ok([alone]) => passed.push(alone),
            Err(group) => passed.push(draft.group(&group)),
        }
    }
    passed
}

fn treat_voxel(grid: &Grid, level: u32, voxel: &[(u64, Item)]) -> Groups {
    if let [(_, alone)] = voxel {
        return vec![vec![alone.clone()]];
    }
    let (inside, straddling): (Vec<_>, Vec<_>) =
        voxel.iter().map(|(_, item)| item.clone()).partition(|item| grid.belongs(item, level));
    let mut groups = pack(inside);
    if groups.len() > FAN_OUT && groups.iter().all(|g| g.len() == 1) {
        groups = thin_out(groups.into_iter().flatten().collect());
    }
    for item in straddling {
        let home = groups
            .iter()
            .enumerate()
            .filter(|(_, g)| g.len() > 1 && g.len() < FAN_OUT)
            .map(|(i, g)| (emptiness(&Bag::of(g), &Bag::single(&item)).0, i))
            .filter(|(fraction, _)| *fraction <= MAX_EMPTY_FRACTION)
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match home {
            Some((_, i)) => groups[i].push(item),
            None => groups.push(vec![item]),
        }
    }
    groups
}

/// Box, occupied volume and counts of a group.
#[derive(Clone, Copy)]
struct Bag {
    bounds: Aabb,
    occupied: f64,
    members: usize,
    faces: Option<usize>,
}

impl Bag {
    fn single(item: &Item) -> Bag {
        Bag { bounds: item.bounds, occupied: item.occupied, members: 1, faces: item.faces }
    }

    fn of(group: &[Item]) -> Bag {
        group.iter().map(Bag::single).reduce(Bag::join).expect("groups are not empty")
    }

    fn join(self, other: Bag) -> Bag {
        Bag {
            bounds: self.bounds.union(other.bounds),
            occupied: self.occupied + other.occupied,
            members: self.members + other.members,
            faces: one_leaf(self.faces, other.faces),
        }
    }

    /// Volume of the box with every extent at least 1e-3 of the longest, so that flat groups can be compared; length³.
    fn volume(&self) -> f64 {
        let e = self.bounds.extent();
        let e = e.max(Vec3::splat(1e-3 * e.max_element())).as_dvec3();
        e.x * e.y * e.z
    }
}

/// Empty fraction, and added empty volume (length³), of the union of two groups.
fn emptiness(a: &Bag, b: &Bag) -> (f64, f64) {
    let joined = a.join(*b);
    let volume = joined.volume();
    (1.0 - joined.occupied / volume, volume - a.volume() - b.volume())
}

/// Greedy grouping in Morton order: each item joins the one of the last [`MORTON_WINDOW`] groups whose empty fraction
/// becomes smallest, if that is at most [`MAX_EMPTY_FRACTION`].
fn pack(items: Vec<Item>) -> Groups {
    let mut groups: Vec<(Bag, Vec<Item>)> = Vec::new();
    for item in items {
        let bag = Bag::single(&item);
        let start = groups.len().saturating_sub(MORTON_WINDOW);
        let home = groups[start..]
            .iter()
            .enumerate()
            .filter(|(_, (g, _))| g.members < FAN_OUT)
            .map(|(i, (g, _))| (emptiness(g, &bag).0, start + i))
            .filter(|(fraction, _)| *fraction <= MAX_EMPTY_FRACTION)
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match home {
            Some((_, i)) => {
                groups[i].0 = groups[i].0.join(bag);
                groups[i].1.push(item);
            }
            None => groups.push((bag, vec![item])),
        }
    }
    groups.into_iter().map(|(_, items)| items).collect()
}

/// Reduces the number of items: fills up small leaves; if no leaves fit together, groups clusters.
fn thin_out(items: Vec<Item>) -> Groups {
    let before = items.len();
    let leaves = reduce(items, |joined| joined.faces.is_some());
    if leaves.len() < before {
        return leaves;
    }
    reduce(leaves.into_iter().flatten().collect(), |joined| joined.members <= FAN_OUT)
}

/// Merges neighbours along the Morton curve, least added empty volume first, until [`FAN_OUT`] groups or an eighth of
/// the items are left, or no further merge is allowed.
fn reduce(items: Vec<Item>, allowed: impl Fn(&Bag) -> bool) -> Groups {
    let target = FAN_OUT.max(items.len().div_ceil(FAN_OUT / 2));
    let mut groups: Vec<(Bag, Vec<Item>)> = items.into_iter().map(|i| (Bag::single(&i), vec![i])).collect();
    while groups.len() > target {
        let n = groups.len();
        let partner: Vec<usize> = (0..n)
            .map(|i| {
                let near =
                    (i.saturating_sub(MORTON_WINDOW)..n.min(i + MORTON_WINDOW + 1)).filter(|&j| j != i);
                near.filter(|&j| allowed(&groups[i].0.join(groups[j].0)))
                    .map(|j| (emptiness(&groups[i].0, &groups[j].0).1, j))
                    .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
                    .map_or(i, |(_, j)| j)
            })
            .collect();
        let mut left = n;
        for i in 0..n {
            let j = partner[i];
            if i < j && partner[j] == i && left > target {
                let (bag, taken) = (groups[j].0, std::mem::take(&mut groups[j].1));
                groups[i].0 = groups[i].0.join(bag);
                groups[i].1.extend(taken);
                left -= 1;
            }
        }
        if left == n {
            break;
        }
        groups.retain(|(_, items)| !items.is_empty());
    }
    groups.into_iter().map(|(_, items)| items).collect()
}
