//! The power that elements receive, which sharing light with neighbours must not change.

use super::element_samples::{ElementLight, KINDS};
use super::neighbours::Place;
use crate::radiosity::rgb::{Rgb, mean};
use bytemuck::{Pod, Zeroable};

/// Smallest number of elements of a side whose own power is restored: those of the largest window of neighbours. Elements of smaller
/// sides share light with other sides, and if the rays of an element agree by chance, their variance is no measure of the error.
const MIN_ELEMENTS: usize = 49;
/// Largest factor by which the light of a side is scaled to conserve its power, and the inverse of the smallest: a side that seems to
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

/// Power that the elements of a side receive of one kind of light, W/m² times scene units squared.
#[derive(Clone, Copy, Default)]
struct Received {
    /// Power by their own rays.
    own: f64,
    /// Power after sharing.
    shared: f64,
    /// Number of elements.
    count: usize,
}

/// Scales the light after sharing so that its power equals that of the elements' own rays: on each side, then on all sides together. A
/// plane fitted to light with a sharp peak, as of a lamp close to a wall, loses some of the light; and where few rays find light, as in a
/// house under a sky, windows in which rays agree by chance are darker than the mean.
pub(super) fn keep_power(
    kind: usize,
    places: &[Place],
    areas: &[f64],
    light: &[ElementLight],
    all: &mut [SharedKinds],
) {
    let sides = places.iter().map(|place| place.side as usize + 1).max().unwrap_or(0);
    let mut by_side = vec![Received::default(); sides];
    for (i, shared) in all.iter().enumerate() {
        let (area, own) = (areas[i], &light[i]);
        let side = &mut by_side[places[i].side as usize];
        side.count += 1;
        side.own += area * own.mean(kind);
        side.shared += area * mean(shared.irradiance[kind]);
    }
    let factor_of = |Received { own, shared, count }: Received| match shared > 0.0 && count >= MIN_ELEMENTS {
        true => (own / shared).clamp(1.0 / MAX_SIDE_FACTOR, MAX_SIDE_FACTOR),
        false => 1.0,
    };
    let factors: Vec<f64> = by_side.into_iter().map(factor_of).collect();
    let (mut own, mut sum) = (0.0, 0.0);
    for (i, shared) in all.iter_mut().enumerate() {
        let factor = factors[places[i].side as usize];
        shared.irradiance[kind].iter_mut().for_each(|e| *e *= factor);
        own += areas[i] * light[i].mean(kind);
        sum += areas[i] * mean(shared.irradiance[kind]);
    }
    let factor = if sum > 0.0 && own > 0.0 { own / sum } else { 1.0 };
    all.iter_mut().flat_map(|shared| &mut shared.irradiance[kind]).for_each(|e| *e *= factor);
}
