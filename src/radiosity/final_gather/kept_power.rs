//! The power that elements receive, which sharing light with neighbours must not change.

use super::element_samples::{ElementLight, KINDS};
use super::neighbours::{Place, axis};
use crate::radiosity::rgb::{Rgb, mean};
use bytemuck::{Pod, Zeroable};

/// Smallest number of elements of a group of sides: those of the largest window of neighbours. Elements of smaller groups share most of
/// their light with others.
const MIN_ELEMENTS: usize = 49;
/// Largest factor by which the light of a group is scaled to conserve its power, and the inverse of the smallest: a group that seems to
/// lose more than half of its light by sharing most likely has too few rays to know.
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
}

/// Scales the light of each group of sides ([`groups`]) after sharing, by [`MAX_FACTOR`] at most, so that its power equals that of the
/// elements' own rays. A plane fitted to light with a sharp peak, as of a lamp close to a wall, loses some of the light; and where few rays
/// find light, as in a house under a sky, windows in which rays agree by chance are darker than the mean.
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
        let group = &mut by_group[group_of_side[places[i].side as usize]];
        group.own += areas[i] * light[i].mean(kind);
        group.shared += areas[i] * mean(shared.irradiance[kind]);
    }
    let factor_of = |Received { own, shared }: Received| match shared > 0.0 {
        true => (own / shared).clamp(1.0 / MAX_FACTOR, MAX_FACTOR),
        false => 1.0,
    };
    let factors: Vec<f64> = by_group.into_iter().map(factor_of).collect();
    for (i, shared) in all.iter_mut().enumerate() {
        let factor = factors[group_of_side[places[i].side as usize]];
        shared.irradiance[kind].iter_mut().for_each(|e| *e *= factor);
    }
}

/// The group of each side: sides of at least [`MIN_ELEMENTS`] elements by themselves, smaller ones with the next small ones that face the
/// same way, up to that number; the two sides of a partition may have different light. What is left belongs to the last group that faces
/// the same way, or where there is none to a group of all that is left, or to the last of all groups. Sides are numbered by clusters, so
/// that most sides of one group lie close to each other.
fn groups(places: &[Place]) -> Vec<usize> {
    #[derive(Clone, Copy, Default)]
    struct Group {
        /// Number of elements.
        count: usize,
        /// The axis that they face along.
        facing: usize,
    }
    let mut sides = vec![Group::default(); places.iter().map(|of| of.side as usize + 1).max().unwrap_or(0)];
    for place in places {
        let side = &mut sides[place.side as usize];
        *side = Group { count: side.count + 1, facing: axis(place.normal) };
    }
    let mut groups: Vec<Group> = Vec::new();
    // By axis, the group that is not complete.
    let mut open = [None; 6];
    let group_of = |side: &Group| {
        let is_small = side.count < MIN_ELEMENTS;
        let group = open[side.facing].filter(|_| is_small).unwrap_or(groups.len());
        groups.resize(groups.len().max(group + 1), Group { count: 0, ..*side });
        groups[group].count += side.count;
        if is_small {
            open[side.facing] = Some(group).filter(|_| groups[group].count < MIN_ELEMENTS);
        }
        group
    };
    let of_sides: Vec<usize> = sides.iter().map(group_of).collect();
    let last = |faces: &dyn Fn(&Group) -> bool| {
        groups.iter().rposition(|group| group.count >= MIN_ELEMENTS && faces(group))
    };
    let left: Vec<usize> = open.into_iter().flatten().collect();
    let facing = |group: usize| last(&|of| of.facing == groups[group].facing);
    let alone = || left.iter().copied().filter(|&group| facing(group).is_none());
    let count: usize = alone().map(|group| groups[group].count).sum();
    let of_rest = if count < MIN_ELEMENTS { last(&|_| true) } else { None }.or(alone().next());
    let joined = |group: usize| match left.contains(&group) {
        true => facing(group).or(of_rest).unwrap_or(group),
        false => group,
    };
    of_sides.into_iter().map(joined).collect()
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
        assert_eq!(groups(&places(&counts, |_| Vec3::Z)), [0, 1, 0, 0, 3, 3]);
        // The fourth is the back of the third; what is left joins the last group.
        let normal = |side| if side == 3 { Vec3::NEG_Z } else { Vec3::Z };
        assert_eq!(groups(&places(&counts, normal)), [3, 1, 3, 3, 3, 3]);
        assert_eq!(groups(&places(&[48, 25, 1, 49], |side| normal(side + 2))), [0, 2, 0, 2]);
        // Small scenes have one group.
        assert_eq!(groups(&places(&[3, 4, 5], normal)), [0, 0, 0]);
        // Sides of a box make a group together.
        let normal = |side| [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z][side as usize];
        assert_eq!(groups(&places(&[40; 6], normal)), [0; 6]);
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
