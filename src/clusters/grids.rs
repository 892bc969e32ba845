//! Hierarchy of uniform grids [SD95 sec 4.1]; method A.8.
//!
//! Items enter at the level whose voxels they fit, from the finest to the coarsest; at each level the items of a
//! voxel are grouped with little empty space, then straddling items are offered to the groups, and all that is
//! left moves up a level.
//!
//! Decisions of ours where the paper is silent: the grid's root is the bounding *cube*, because the 2^i-fold
//! division of a flat scene's box gives pancake voxels whose clusters are neither homogeneous nor isotropic;
//! items an eighth of the voxel or smaller belong to the voxel of their centre ("very small" items); more than
//! [`FAN_OUT`] items in a voxel are merged pairwise by least added empty volume, in a window along the Morton
//! curve: small leaves into full ones first, and when all are full, clusters into larger clusters.

use super::FAN_OUT;
use super::draft::{Draft, Item, Member, one_leaf};
use crate::math::Aabb;
use glam::{UVec3, Vec3};
use rayon::prelude::*;

/// Finest level: voxels of 2^-20 of the scene.
const FINEST: u32 = 20;
/// Groups may be this empty; the rest is left for the next level.
const EMPTY_LIMIT: f64 = 0.7;
/// Neighbours along the Morton curve that are considered.
const WINDOW: usize = 8;

/// The root cube and its integer coordinates.
struct Grid {
    base: Vec3,
    scale: f32,
    cube: f32,
}

impl Grid {
    fn around(items: &[Item]) -> Grid {
        let bounds = items.iter().fold(Aabb::EMPTY, |b, i| b.union(i.bounds));
        let cube = bounds.extent().max_element().max(f32::MIN_POSITIVE);
        Grid { base: bounds.min, scale: (1u32 << FINEST) as f32 / cube, cube }
    }

    /// Coordinates at the finest level, below 2^20.
    fn cell(&self, p: Vec3) -> UVec3 {
        ((p - self.base) * self.scale).as_uvec3().min(UVec3::splat((1 << FINEST) - 1))
    }

    /// The finest level whose voxels are at least as large as the item.
    fn level(&self, item: &Item) -> u32 {
        let ratio = self.cube / item.bounds.extent().max_element().max(self.cube * 1e-6);
        (ratio.log2().floor().max(0.0) as u32).min(FINEST)
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

    /// Whether the item counts as lying in one voxel of the level.
    fn belongs(&self, item: &Item, level: u32) -> bool {
        let shift = FINEST - level;
        let voxel = self.cube / (1u32 << level) as f32;
        let (lo, hi) = (self.cell(item.bounds.min), self.cell(item.bounds.max));
        lo >> shift == hi >> shift || item.bounds.extent().max_element() * 8.0 <= voxel
    }
}

/// Clusters `items` into one tree on top of the clusters that the draft holds already.
pub(super) fn cluster(mut draft: Draft, mut items: Vec<Item>) -> Draft {
    let grid = Grid::around(&items);
    for item in &mut items {
        if let Member::Face(_) = item.member {
            // Flat faces need some thickness for a measure of emptiness: a thousandth of their size.
            let e = item.bounds.extent();
            let thick = e.max(Vec3::splat(1e-3 * e.max_element())).as_dvec3();
            item.occupied = thick.x * thick.y * thick.z;
        }
    }
    let mut waiting: Vec<(u32, Item)> = items.into_iter().map(|i| (grid.level(&i), i)).collect();
    // Coarsest last, so that each level takes its items from the end.
    waiting.par_sort_by_key(|(level, item)| (*level, item.first_face));
    let mut moving: Vec<Item> = Vec::new();
    let mut level = FINEST;
    loop {
        let from = waiting.partition_point(|(l, _)| *l < level);
        moving.extend(waiting.drain(from..).map(|(_, item)| item));
        moving = treat_level(&mut draft, &grid, level, moving);
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
    draft
}

/// Groups of one voxel, in order; a group of one is the item itself.
type Groups = Vec<Vec<Item>>;

fn treat_level(draft: &mut Draft, grid: &Grid, level: u32, items: Vec<Item>) -> Vec<Item> {
    if items.len() < 2 {
        return items;
    }
    let mut keyed: Vec<(u64, Item)> = items.into_par_iter().map(|i| (grid.key(&i), i)).collect();
    keyed.par_sort_by_key(|(key, item)| (*key, item.first_face));
    let shift = 3 * (FINEST - level);
    let voxels: Vec<&[(u64, Item)]> = keyed.chunk_by(|a, b| a.0 >> shift == b.0 >> shift).collect();
    let groups: Vec<Groups> = voxels.into_par_iter().map(|voxel| treat_voxel(grid, level, voxel)).collect();
    emit(draft, groups)
}

/// Makes clusters of the groups; what stands alone passes through.
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
            .filter(|(fraction, _)| *fraction <= EMPTY_LIMIT)
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match home {
            Some((_, i)) => groups[i].push(item),
            None => groups.push(vec![item]),
        }
    }
    groups
}

/// Box and occupied volume of a group.
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

    /// Volume of the box with a minimum thickness, so that flat groups can be compared.
    fn volume(&self) -> f64 {
        let e = self.bounds.extent();
        let e = e.max(Vec3::splat(1e-3 * e.max_element())).as_dvec3();
        e.x * e.y * e.z
    }
}

/// Empty fraction and added empty volume of joining two groups.
fn emptiness(a: &Bag, b: &Bag) -> (f64, f64) {
    let joined = a.join(*b);
    let volume = joined.volume();
    (1.0 - joined.occupied / volume, volume - a.volume() - b.volume())
}

/// Greedy grouping in Morton order: each item joins the recent group that it leaves least empty, if any is
/// within [`EMPTY_LIMIT`].
fn pack(items: Vec<Item>) -> Groups {
    let mut groups: Vec<(Bag, Vec<Item>)> = Vec::new();
    for item in items {
        let bag = Bag::single(&item);
        let start = groups.len().saturating_sub(WINDOW);
        let home = groups[start..]
            .iter()
            .enumerate()
            .filter(|(_, (g, _))| g.members < FAN_OUT)
            .map(|(i, (g, _))| (emptiness(g, &bag).0, start + i))
            .filter(|(fraction, _)| *fraction <= EMPTY_LIMIT)
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

/// Makes fewer items of a crowd: small leaves are filled up; if there are none left, clusters are grouped.
fn thin_out(items: Vec<Item>) -> Groups {
    let before = items.len();
    let leaves = reduce(items, |joined| joined.faces.is_some());
    if leaves.len() < before {
        return leaves;
    }
    reduce(leaves.into_iter().flatten().collect(), |joined| joined.members <= FAN_OUT)
}

/// Merges neighbours along the Morton curve, least added empty volume first, until [`FAN_OUT`] groups or an
/// eighth are left, or no further merge is allowed.
fn reduce(items: Vec<Item>, allowed: impl Fn(&Bag) -> bool) -> Groups {
    let target = FAN_OUT.max(items.len().div_ceil(FAN_OUT / 2));
    let mut groups: Vec<(Bag, Vec<Item>)> = items.into_iter().map(|i| (Bag::single(&i), vec![i])).collect();
    while groups.len() > target {
        let n = groups.len();
        let partner: Vec<usize> = (0..n)
            .map(|i| {
                let near = (i.saturating_sub(WINDOW)..n.min(i + WINDOW + 1)).filter(|&j| j != i);
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
