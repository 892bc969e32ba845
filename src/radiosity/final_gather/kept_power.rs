//! The power that elements receive, which sharing light with neighbours must not change.

use super::element_samples::{ElementLight, KINDS};
use super::neighbours::{Place, axis};
use crate::radiosity::rgb::{Rgb, mean};
use bytemuck::{Pod, Zeroable};

/// Smallest number of elements of a group of sides whose own power is restored: those of the largest window of neighbours. Elements of
/// smaller groups share most of their light with others.
const MIN_ELEMENTS: usize = 49;
/// Largest factor by which the light of a group, and that of all groups, is scaled to conserve its power, and the inverse of the smallest:
/// a group that seems to lose more than half of its light by sharing most likely has too few rays to know.
const MAX_FACTOR: f64 = 2.0;

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

/// Scales the light after sharing, by [`MAX_FACTOR`] at most, so that its power equals that of the elements' own rays: in each group of
/// sides ([`groups`]) with enough elements, then of all together. A plane fitted to light with a sharp peak, as of a lamp close to a wall,
/// loses some of the light; and where few rays find light, as in a house under a sky, windows in which rays agree by chance are darker than
/// the mean.
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
        true => (own / shared).clamp(1.0 / MAX_FACTOR, MAX_FACTOR),
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
    let factor = if own > 0.0 && sum > 0.0 { (own / sum).clamp(1.0 / MAX_FACTOR, MAX_FACTOR) } else { 1.0 };
    all.iter_mut().flat_map(|shared| &mut shared.irradiance[kind]).for_each(|e| *e *= factor);
}

/// The group of each side: sides of at least [`MIN_ELEMENTS`] elements by themselves, smaller ones with the next small ones that face the
/// same way, up to that number; the two sides of a partition may have different light. Sides are numbered by clusters, so that most sides
/// of one group lie close to each other.
fn groups(places: &[Place]) -> Vec<usize> {
    // By side, the number of its elements and the axis that it faces along.
    let mut sides = vec![(0, 0); places.iter().map(|place| place.side as usize + 1).max().unwrap_or(0)];
    places.iter().for_each(|place| {
        let (count, facing) = &mut sides[place.side as usize];
        (*count, *facing) = (*count + 1, axis(place.normal));
    });
    let mut next = 0;
    // By axis, the group that is not complete, and the number of its elements.
    let mut open = [None; 6];
    let group = |(count, facing): (usize, usize)| {
        let open = &mut open[facing];
        let is_small = count < MIN_ELEMENTS;
        let (own, so_far) = open.filter(|_| is_small).unwrap_or((next, 0));
        next = next.max(own + 1);
        if is_small {
            *open = Some((own, so_far + count)).filter(|(_, count)| *count < MIN_ELEMENTS);
        }
        own
    };
    sides.into_iter().map(group).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn places(counts: &[usize], normal: impl Fn(u32) -> Vec3) -> Vec<Place> {
        let place = |side| Place { centre: Vec3::ZERO, normal: normal(side), radius: 1.0, side, free: 1.0 };
        (0..).zip(counts).flat_map(|(side, n)| (0..*n).map(move |_| side)).map(place).collect()
    }

    #[test]
    fn small_sides_that_face_the_same_way_are_grouped() {
        let counts = [10, 60, 20, 25, 5, 49];
        assert_eq!(groups(&places(&counts, |_| Vec3::Z)), [0, 1, 0, 0, 2, 3]);
        // The fourth is the back of the third.
        let normal = |side| if side == 3 { Vec3::NEG_Z } else { Vec3::Z };
        assert_eq!(groups(&places(&counts, normal)), [0, 1, 0, 2, 0, 3]);
    }

    /// Fronts of small partitions in a bright room and their backs in a dim one keep their power, however the areas differ.
    #[test]
    fn groups_of_small_sides_keep_their_power() {
        let facing = |side: u32| if side.is_multiple_of(2) { Vec3::Z } else { Vec3::NEG_Z };
        let places = places(&[1; 98], facing);
        let areas: Vec<f64> = (0..98).map(|i| 1.0 + f64::from(i % 7)).collect();
        let light = |i| ElementLight {
            rays: 4,
            halves: [[Vec3::splat(if i % 2 == 0 { 10.0 } else { 1.0 }); 2]; KINDS],
            ..ElementLight::default()
        };
        let light: Vec<ElementLight> = (0..98).map(light).collect();
        let shared =
            |i| SharedKinds { irradiance: [[if i % 2 == 0 { 9.0 } else { 1.5 }; 3]; KINDS], error: 0.0 };
        let mut all: Vec<SharedKinds> = (0..98).map(shared).collect();
        keep_power(0, &places, &areas, &light, &mut all);
        for (i, shared) in all.iter().enumerate() {
            let own = light[i].mean(0);
            assert!(
                (mean(shared.irradiance[0]) / own - 1.0).abs() < 1e-9,
                "{i}: {shared:?} instead of {own}"
            );
        }
    }
}
