//! Trees over items that come and go.

use super::*;
use glam::Vec3;
use proptest::prelude::*;
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::scene::testing::unit;

type Branch = Child<u32, u64>;

/// Boxes of items by their number.
type Boxes = BTreeMap<u32, Aabb>;

/// A tree with its items, and the number of groups that were made.
struct Grown {
    cells: Cells,
    boxes: Boxes,
    root: Option<Branch>,
    made: AtomicUsize,
}

impl Grown {
    fn new() -> Grown {
        let cells = Cells::for_size(1.0);
        Grown { cells, boxes: Boxes::new(), root: None, made: AtomicUsize::new(0) }
    }

    /// Places items, or removes those without a box.
    fn change(&mut self, items: &[(u32, Option<Aabb>)]) {
        let mut changes = BTreeMap::new();
        for &(number, bounds) in items {
            let before = match bounds {
                Some(bounds) => self.boxes.insert(number, bounds),
                None => self.boxes.remove(&number),
            };
            if let Some(key) = before.map(|bounds| self.cells.key(bounds, number)) {
                changes.insert(key, Change { key, is_there: true, item: None });
            }
            if let Some(key) = bounds.map(|bounds| self.cells.key(bounds, number)) {
                let item = Some(Arc::new(Item { key, content: number }));
                let is_there = changes.contains_key(&key);
                changes.insert(key, Change { key, is_there, item });
            }
        }
        let changes: Vec<Change<u32>> = changes.into_values().collect();
        let root = update(self.root.as_ref(), &changes, &|children: &[Branch]| {
            self.made.fetch_add(1, Ordering::Relaxed);
            children.iter().fold(7, |hash: u64, child| {
                let of = match child {
                    Child::Item(item) => u64::from(item.content),
                    Child::Group(group) => group.content,
                };
                (hash ^ of).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(17)
            })
        });
        self.root = root;
    }

    fn fresh(&self) -> Grown {
        let mut fresh = Grown::new();
        fresh.change(&self.boxes.iter().map(|(&number, &bounds)| (number, Some(bounds))).collect::<Vec<_>>());
        fresh
    }
}

/// Number of groups above each other.
fn levels(branch: &Branch) -> usize {
    match branch {
        Child::Item(_) => 0,
        Child::Group(group) => 1 + group.children.iter().map(levels).max().unwrap_or(0),
    }
}

/// Shape and contents.
fn describe(branch: &Branch) -> String {
    match branch {
        Child::Item(item) => format!("{}", item.content),
        Child::Group(group) => {
            let children: Vec<String> = group.children.iter().map(describe).collect();
            let place = if group.items > FAN_OUT { group.place } else { 0 };
            format!("{place}:{}:{}:{:x}({})", group.key, group.items, group.content, children.join(" "))
        }
    }
}

fn cube(at: Vec3, size: f32) -> Aabb {
    Aabb { min: at - Vec3::splat(0.5 * size), max: at + Vec3::splat(0.5 * size) }
}

/// An item somewhere: spread, on a plane, or all in one place.
fn somewhere(random: &mut Pcg64Mcg, spread: f32) -> Aabb {
    let mut next = || unit(random) as f32;
    let at = match (4.0 * next()) as u32 {
        0 => Vec3::new(3.0, -5.0, 0.25),
        1 => spread * (Vec3::new(next(), next(), 0.5) - 0.5),
        _ => spread * (Vec3::new(next(), next(), next()) - 0.5),
    };
    cube(at, 1.0 + 4.0 * next())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Whatever came and went before, the tree is that of its items, and every group is small and complete.
    #[test]
    fn trees_do_not_depend_on_their_history(seed in 0u64..1 << 40, spread in 0.0f32..3000.0, most in 1u32..400) {
        let mut random = Pcg64Mcg::new(u128::from(seed));
        let mut grown = Grown::new();
        for _ in 0..12 {
            let count = (unit(&mut random) * 60.0) as usize;
            let items: Vec<(u32, Option<Aabb>)> = (0..count)
                .map(|_| {
                    let number = (unit(&mut random) * f64::from(most)) as u32;
                    (number, (unit(&mut random) < 0.6).then(|| somewhere(&mut random, spread)))
                })
                .collect::<BTreeMap<_, _>>()
                .into_iter()
                .collect();
            grown.change(&items);
            let fresh = grown.fresh();
            prop_assert_eq!(grown.root.as_ref().map(describe), fresh.root.as_ref().map(describe));
            let mut numbers = Vec::new();
            if let Some(root) = &grown.root {
                root.for_each_item(&mut |item| numbers.push(item.content));
                root.for_each_group(&mut |group| assert!((2..=FAN_OUT).contains(&group.children.len())));
            }
            numbers.sort_unstable();
            prop_assert_eq!(numbers, grown.boxes.keys().copied().collect::<Vec<_>>());
        }
    }
}

/// An update of k items makes the groups above their old and new places anew, and those into which a full group is split.
#[test]
fn updates_touch_the_groups_above_changed_items_alone() {
    for n in [1_000u32, 10_000] {
        let mut random = Pcg64Mcg::new(7);
        let spread = 4.0 * f64::from(n).cbrt() as f32;
        let mut grown = Grown::new();
        let all: Vec<_> = (0..n).map(|i| (i, Some(somewhere(&mut random, spread)))).collect();
        grown.change(&all);
        let groups = grown.made.load(Ordering::Relaxed);
        for k in [1usize, 10, 100] {
            let items: BTreeMap<u32, _> = (0..k)
                .map(|_| {
                    let number = (unit(&mut random) * f64::from(n)) as u32;
                    (number, (unit(&mut random) < 0.8).then(|| somewhere(&mut random, spread)))
                })
                .collect();
            let depth = levels(grown.root.as_ref().expect("a tree"));
            grown.made = AtomicUsize::new(0);
            grown.change(&items.into_iter().collect::<Vec<_>>());
            let depth = depth.max(levels(grown.root.as_ref().expect("a tree")));
            let made = grown.made.load(Ordering::Relaxed);
            assert!(made <= 2 * k * (depth + 1), "{made} groups for {k} of {n} items in {depth} levels");
            assert!(k > 1 || made < groups / 10, "{made} of {groups} groups for one item of {n}");
        }
    }
}
