//! Groups of placed items: a tree that depends on the items alone, not on the order in which they came and went.
//!
//! Items are sorted by the Morton code of the centre of their box, which cells anchored at the origin determine (Morton 1966), and
//! then by number. A group of at most [`FAN_OUT`] items holds them itself; a larger one is split by the first of sixteen-valued digits
//! at which their keys differ. Groups that an update leaves as they are are shared with the tree before it, so that an update
//! of k items makes the groups above them anew, O(k log n), and keeps the rest.

#[cfg(test)]
mod tests;

use super::FAN_OUT;
use crate::math::Aabb;
use crate::math::parallel;
use std::sync::Arc;

/// Place of an item in the order: Morton code of its cell, then its number. No two items share a key.
pub type Key = u128;

/// Bits of a cell's coordinate. With three coordinates and the bits of a number, 122 of the key's 128 bits are used.
const CELL_BITS: u32 = 30;
/// Bits of the key below the Morton code.
const LOW_BITS: u32 = Key::BITS - 3 * CELL_BITS;
/// Bits of a digit: a group has at most [`FAN_OUT`] children.
const DIGIT_BITS: u32 = FAN_OUT.ilog2();
/// Edge of a cell over the size of the smallest item: cells an eighth as large separate the centres of items that overlap.
const CELL_FRACTION: f64 = 0.125;

/// The cells that sort items.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cells {
    /// Edge of a cell, scene units: a power of two.
    edge: f64,
}

impl Cells {
    /// Cells for items of at least this size, scene units, positive. Smaller items, and items beyond 2^29 cells from the origin, are
    /// sorted less well.
    pub fn for_size(smallest: f32) -> Cells {
        Cells { edge: f64::from(smallest).log2().floor().exp2() * CELL_FRACTION }
    }

    /// The key of item `number` with this box.
    pub fn key(&self, bounds: Aabb, number: u32) -> Key {
        let centre = bounds.center().as_dvec3() / self.edge;
        let middle = f64::from(1u32 << (CELL_BITS - 1));
        // Conversion saturates below 0.
        let cell = centre.to_array().map(|c| ((c + middle) as u64).min((1 << CELL_BITS) - 1));
        let mut code = 0;
        for bit in (0..CELL_BITS).rev() {
            for c in cell {
                code = code << 1 | Key::from(c >> bit & 1);
            }
        }
        code << LOW_BITS | Key::from(number)
    }
}

/// A digit of a key, the first counting from the highest bits.
fn digit(key: Key, place: u32) -> u32 {
    (key >> (Key::BITS - DIGIT_BITS * (place + 1))) as u32 & (FAN_OUT as u32 - 1)
}

/// Place of the first digit at which two different keys differ.
fn first_difference(a: Key, b: Key) -> u32 {
    (a ^ b).leading_zeros() / DIGIT_BITS
}

/// A placed item.
#[derive(Debug)]
pub struct Item<I> {
    /// Its place in the order.
    pub key: Key,
    /// The placed content.
    pub content: I,
}

/// A group of at least two items.
#[derive(Debug)]
pub struct Group<I, G> {
    /// Key of its first item.
    key: Key,
    /// Place of the first digit that differs; meaningless in a group that holds its items itself.
    place: u32,
    items: usize,
    /// Its items, or its groups and single items, at most [`FAN_OUT`], in the order of their keys.
    pub children: Vec<Child<I, G>>,
    /// Data computed from its children.
    pub content: G,
}

/// A member of a group.
#[derive(Debug)]
pub enum Child<I, G> {
    /// A single item.
    Item(Arc<Item<I>>),
    /// A group of several.
    Group(Arc<Group<I, G>>),
}

impl<I, G> Clone for Child<I, G> {
    fn clone(&self) -> Self {
        match self {
            Child::Item(item) => Child::Item(item.clone()),
            Child::Group(group) => Child::Group(group.clone()),
        }
    }
}

impl<I, G> Child<I, G> {
    fn key(&self) -> Key {
        match self {
            Child::Item(item) => item.key,
            Child::Group(group) => group.key,
        }
    }

    fn items(&self) -> usize {
        match self {
            Child::Item(_) => 1,
            Child::Group(group) => group.items,
        }
    }

    /// Calls `each` with all items, in the order of their keys.
    pub fn for_each_item<'a>(&'a self, each: &mut impl FnMut(&'a Arc<Item<I>>)) {
        match self {
            Child::Item(item) => each(item),
            Child::Group(group) => group.children.iter().for_each(|child| child.for_each_item(each)),
        }
    }

    /// Calls `each` with all groups, parents first.
    pub fn for_each_group<'a>(&'a self, each: &mut impl FnMut(&'a Group<I, G>)) {
        if let Child::Group(group) = self {
            each(group);
            group.children.iter().for_each(|child| child.for_each_group(each));
        }
    }
}

/// A change at one key.
#[derive(Debug)]
pub struct Change<I> {
    pub key: Key,
    /// Whether the tree has an item of this key.
    pub is_there: bool,
    /// The item that it shall have.
    pub item: Option<Arc<Item<I>>>,
}

impl<I> Change<I> {
    /// The number of items of a tree of `items` items after these changes.
    fn items_after(items: usize, changes: &[Change<I>]) -> usize {
        let count = |of: fn(&Change<I>) -> bool| changes.iter().filter(|change| of(change)).count();
        items + count(|change| change.item.is_some()) - count(|change| change.is_there)
    }
}

/// Computes the content of a group from its children.
type Make<'a, I, G> = &'a (dyn Fn(&[Child<I, G>]) -> G + Sync);

/// The tree after some changes, in the order of their keys, one a key.
/// None if no item is left. Parallel; the result does not depend on the number of threads.
pub fn update<I: Send + Sync, G: Send + Sync>(
    old: Option<&Child<I, G>>,
    changes: &[Change<I>],
    make: Make<I, G>,
) -> Option<Child<I, G>> {
    if changes.is_empty() {
        return old.cloned();
    }
    let after = Change::items_after(old.map_or(0, Child::items), changes);
    match old {
        Some(Child::Group(group)) if group.items > FAN_OUT && after > FAN_OUT => {
            Some(update_large(group, changes, make))
        }
        _ => {
            let mut items = Vec::with_capacity(after);
            let mut next = changes.iter().peekable();
            let mut add_until = |key: Key, items: &mut Vec<_>| {
                while let Some(change) = next.next_if(|change| change.key < key) {
                    items.extend(change.item.clone());
                }
                next.next_if(|change| change.key == key)
                    .map(|change| items.extend(change.item.clone()))
                    .is_some()
            };
            if let Some(old) = old {
                old.for_each_item(&mut |item| {
                    if !add_until(item.key, &mut items) {
                        items.push(item.clone());
                    }
                });
            }
            add_until(Key::MAX, &mut items);
            build(&items, make)
        }
    }
}

/// Updates a group that is split by a digit, before and after.
fn update_large<I: Send + Sync, G: Send + Sync>(
    group: &Arc<Group<I, G>>,
    changes: &[Change<I>],
    make: Make<I, G>,
) -> Child<I, G> {
    let added = changes.iter().filter(|change| change.item.is_some());
    let place = added
        .map(
            |change| if change.key == group.key { u32::MAX } else { first_difference(change.key, group.key) },
        )
        .fold(group.place, u32::min);
    let whole;
    let before = match place == group.place {
        true => &group.children[..],
        // An item came that differs from all others in an earlier digit.
        false => {
            whole = [Child::Group(group.clone())];
            &whole
        }
    };
    let of = |d: u32| {
        let (start, end) = (
            changes.partition_point(|change| digit(change.key, place) < d),
            changes.partition_point(|change| digit(change.key, place) <= d),
        );
        (before.iter().find(|child| digit(child.key(), place) == d), &changes[start..end])
    };
    let parts: Vec<_> = (0..FAN_OUT as u32).map(of).collect();
    let children = parallel::flat_map(&parts, |&(old, changes)| update(old, changes, make));
    joined(place, children, make)
}

/// A tree over items in the order of their keys.
fn build<I: Send + Sync, G: Send + Sync>(items: &[Arc<Item<I>>], make: Make<I, G>) -> Option<Child<I, G>> {
    let [first, .., last] = items else {
        return items.first().map(|only| Child::Item(only.clone()));
    };
    let place = first_difference(first.key, last.key);
    let children: Vec<Child<I, G>> = if items.len() <= FAN_OUT {
        items.iter().map(|item| Child::Item(item.clone())).collect()
    } else {
        let parts: Vec<_> = items.chunk_by(|a, b| digit(a.key, place) == digit(b.key, place)).collect();
        parallel::flat_map(&parts, |part| build(part, make))
    };
    Some(joined(place, children, make))
}

/// The group of some children, or an only child itself.
fn joined<I, G>(place: u32, children: Vec<Child<I, G>>, make: Make<I, G>) -> Child<I, G> {
    match <[Child<I, G>; 1]>::try_from(children) {
        Ok([only]) => only,
        Err(children) => {
            let (key, items) = (children[0].key(), children.iter().map(Child::items).sum());
            let content = make(&children);
            Child::Group(Arc::new(Group { key, place, items, children, content }))
        }
    }
}
