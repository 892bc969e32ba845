//! The power that elements receive, which sharing light with neighbours must not change.

use super::element_samples::{ElementLight, KINDS};
use super::neighbours::Place;
use crate::radiosity::rgb::{Rgb, mean};
use bytemuck::{Pod, Zeroable};

/// Smallest number of elements of a group of sides whose own power is restored: those of the largest window of neighbours. Elements of
/// smaller groups share most of their light with others.
const MIN_ELEMENTS: usize = 49;
/// Largest factor by which the light of a group is scaled to conserve its power, and the inverse of the smallest: one that seems to
/// lose more than half of its light by sharing most likely has too few rays to know.
const MAX_SIDE_FACTOR: f64 = 2.0;

/// Light of an element after sharing, by kind.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct SharedKinds {
    /// W/m².
    pub irradiance: [Rgb; KINDS],
    /// Expected square of the error of the mean over the channels, (W/m²)².
    pub error: f64,
}

/// Power that the elements of a group of sides receive of one kind of light, W/m² times scene units squared.
#[derive(Clone, Copy, Default)]
struct Received {
    /// Power by their own rays.
    own: f64,
    /// Power after sharing.
    shared: f64,
    /// Number of elements.
    count: usize,
}

/// Scales the light after sharing so that its power equals that of the elements' own rays: in each group of sides ([`groups`]), then of all
/// together. A plane fitted to light with a sharp peak, as of a lamp close to a wall, loses some of the light; and where few rays find
/// light, as in a house under a sky, windows in which rays agree by chance are darker than the mean.
pub(super) fn keep_power(
    kind: usize,
    places: &[Place],
    areas: &[f64],
    light: &[ElementLight],
    all: &mut [SharedKinds],
) {
    let group_of_side = groups(places);
    let mut by_group = vec![Received::default(); group_of_side.iter().max().map_or(0, |last| last + 1)];
    for (i, shared) in all.iter().enumerate() {
        let (area, own) = (areas[i], &light[i]);
        let group = &mut by_group[group_of_side[places[i].side as usize]];
        group.count += 1;
        group.own += area * own.mean(kind);
        group.shared += area * mean(shared.irradiance[kind]);
    }
    let factor_of = |Received { own, shared, count }: Received| match shared > 0.0 && count >= MIN_ELEMENTS {
        true => (own / shared).clamp(1.0 / MAX_SIDE_FACTOR, MAX_SIDE_FACTOR),
        false => 1.0,
    };
    let factors: Vec<f64> = by_group.into_iter().map(factor_of).collect();
    let (mut own, mut sum) = (0.0, 0.0);
    for (i, shared) in all.iter_mut().enumerate() {
        let factor = factors[group_of_side[places[i].side as usize]];
        shared.irradiance[kind].iter_mut().for_each(|e| *e *= factor);
        own += areas[i] * light[i].mean(kind);
        sum += areas[i] * mean(shared.irradiance[kind]);
    }
    let factor = if sum > 0.0 { (own / sum).clamp(1.0 / MAX_SIDE_FACTOR, MAX_SIDE_FACTOR) } else { 1.0 };
    all.iter_mut().flat_map(|shared| &mut shared.irradiance[kind]).for_each(|e| *e *= factor);
}

/// The group of each side: sides of at least [`MIN_ELEMENTS`] elements by themselves, smaller ones with the next small ones up to that
/// number. Sides are numbered by clusters: those of one group lie together.
fn groups(places: &[Place]) -> Vec<usize> {
    let mut counts = vec![0; places.iter().map(|place| place.side as usize + 1).max().unwrap_or(0)];
    places.iter().for_each(|place| counts[place.side as usize] += 1);
    let (mut next, mut small, mut in_small) = (0, None, 0);
    let group = |count: usize| {
        let is_small = count < MIN_ELEMENTS;
        let own = small.filter(|_| is_small).unwrap_or(next);
        next = next.max(own + 1);
        if is_small {
            in_small += count;
            small = Some(own).filter(|_| in_small < MIN_ELEMENTS);
            in_small *= usize::from(small.is_some());
        }
        own
    };
    counts.into_iter().map(group).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn small_sides_are_grouped() {
        let place = |side| Place { centre: Vec3::ZERO, normal: Vec3::Z, radius: 1.0, side, free: 1.0 };
        let counts = [10, 60, 20, 25, 5, 49];
        let places: Vec<Place> =
            (0..).zip(counts).flat_map(|(side, n)| (0..n).map(move |_| place(side))).collect();
        assert_eq!(groups(&places), [0, 1, 0, 0, 2, 3]);
    }
}
