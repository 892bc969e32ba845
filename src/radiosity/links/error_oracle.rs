//! The error oracle: estimates the error of the light that a link causes at its ends, and selects the end to split.

use super::Link;
use super::cluster_pair::CLUSTER_DEVIATION;
use crate::radiosity::elements::Elements;

/// Which end of a link is to be split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// The end `a`.
    A,
    /// The end `b`.
    B,
    /// Neither end can be split.
    Neither,
}

/// The error of a link and the end to split. The error is a radiosity: the square root of the squared error's integral over the
/// receiver, divided by the square root of the scene's area. Errors of receivers of all sizes then count by their visible
/// effect, and refining the largest errors reduces the total.
///
/// At the receiver a, the irradiance from b varies by `variation_a B_b / A_a`. Where the radiosity of b varies, the light from
/// its parts differs by as much of that deviation as the exchange varies over b. Visibility is part of both variations.
/// The end with the greater contribution is split.
pub fn link_error(elements: &Elements, link: &Link) -> (f32, Split) {
    let ends =
        [link.a, link.b].map(|e| (&elements.elements[e as usize], elements.states[e as usize].statistics));
    if link.a == link.b {
        let (e, l) = ends[0];
        let error = link.variation[0] * (l.deviation + CLUSTER_DEVIATION * l.mean) / e.area as f32;
        return (weigh(error, l.weight, e.area, elements.area), Split::A);
    }
    let mut worst = 0.0f32;
    // The error that splitting each end could remove.
    let mut gain = [0.0f32; 2];
    for (receiver, source) in [(0, 1), (1, 0)] {
        let (e, l) = ends[receiver];
        let from = ends[source].1;
        let of_receiver = link.variation[receiver] * from.mean;
        let of_source =
            link.variation[source].min(link.exchange_area + link.variation[receiver]) * from.deviation;
        let scale = weigh(1.0, l.weight, e.area, elements.area) / e.area as f32;
        gain[receiver] = gain[receiver].max(of_receiver * scale);
        gain[source] = gain[source].max(of_source * scale);
        worst = worst.max(of_receiver.hypot(of_source) * scale);
    }
    let open = [link.a, link.b].map(|e| elements.can_open(e));
    // The larger end is split first unless the gain of the other one clearly dominates: kernels need ends of similar size, and
    // the error of the same exchange area is inversely proportional to the radius of the receiver.
    let (ra, rb) = (ends[0].0.radius, ends[1].0.radius);
    let prefer_a = gain[0] * ra * ra >= gain[1] * rb * rb;
    let split = match open {
        [true, true] if prefer_a => Split::A,
        [true, true] => Split::B,
        [true, false] => Split::A,
        [false, true] => Split::B,
        [false, false] => Split::Neither,
    };
    (worst, split)
}

/// The weight of an irradiance error on an element of this area, for a scene of area `whole`.
pub(super) fn weigh(error: f32, weight: f32, area: f64, whole: f64) -> f32 {
    error * weight * (area / whole).sqrt() as f32
}
