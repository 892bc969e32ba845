//! How wrong a link may make the light at its ends, and which end to split.

use super::Link;
use crate::radiosity::elements::Elements;

/// What an element sends out, as the oracle needs it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Light {
    /// Mean radiosity, W/m², mean over the channels.
    pub mean: f32,
    /// Standard deviation of the radiosity inside the element, W/m².
    pub deviation: f32,
    /// What an error of its irradiance counts: reflectance and importance.
    pub weight: f32,
}

/// Which end of a link is to be opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// The end `a`.
    A,
    /// The end `b`.
    B,
    /// Neither can be.
    Neither,
}

/// What a link is refined for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Oracle {
    /// The error of what it carries: how much form factor, visibility and radiosity vary over its ends.
    #[default]
    Error,
    /// What it carries, whether that varies or not: the classic criterion [Hanrahan, Salzman and Aupperle 1991, BF].
    Bf,
}

/// The error of a link: in units of radiosity, as the root of its square's integral over the receiver, relative to the
/// root of the scene's area. Errors of receivers of all sizes then count as much as they show, and refinement that makes
/// the greatest of them small makes their sum small. The end to split is the one whose variation is behind it.
///
/// At the receiver a the irradiance that b sends varies by `variation_a B_b / A_a`; where b's radiosity varies, what
/// arrives from its parts differs by as much of it as the coupling varies over b (method D.17, A.9: visibility is part of
/// both variations). With [`Oracle::Bf`] all that arrives counts as error.
pub fn judge(elements: &Elements, link: &Link, light: &[Light], oracle: Oracle) -> (f32, Split) {
    let ends = [link.a, link.b].map(|e| (&elements.elements[e as usize], light[e as usize]));
    if link.a == link.b {
        let (e, l) = ends[0];
        let error = link.coupling * (l.deviation + 0.3 * l.mean) / e.area as f32;
        return (weigh(error, l.weight, e.area, elements.area), Split::A);
    }
    let mut worst = (0.0, Split::Neither);
    // What splitting each end could take away.
    let mut gain = [0.0f32; 2];
    for (receiver, source) in [(0, 1), (1, 0)] {
        let (e, l) = ends[receiver];
        let from = ends[source].1;
        let of_receiver = link.variation[receiver] * from.mean;
        let of_source = link.variation[source].min(link.coupling + link.variation[receiver]) * from.deviation;
        let scale = weigh(1.0, l.weight, e.area, elements.area) / e.area as f32;
        gain[receiver] = gain[receiver].max(of_receiver * scale);
        gain[source] = gain[source].max(of_source * scale);
        let error = match oracle {
            Oracle::Error => of_receiver.hypot(of_source) * scale,
            Oracle::Bf => link.coupling * from.mean * scale,
        };
        if error > worst.0 {
            worst.0 = error;
        }
    }
    let open = [link.a, link.b].map(|e| elements.can_open(e));
    // A larger end is split first unless the other's variation clearly dominates: kernels need ends of like size, and
    // errors of the same coupling count the more the smaller the receiver (as one over its radius).
    let (ra, rb) = (ends[0].0.radius, ends[1].0.radius);
    let prefer_a = gain[0] * ra * ra >= gain[1] * rb * rb;
    worst.1 = match open {
        [true, true] => {
            if prefer_a {
                Split::A
            } else {
                Split::B
            }
        }
        [true, false] => Split::A,
        [false, true] => Split::B,
        [false, false] => Split::Neither,
    };
    worst
}

/// An error of irradiance over an element of this area, as the oracle counts it.
fn weigh(error: f32, weight: f32, area: f64, whole: f64) -> f32 {
    error * weight * (area / whole).sqrt() as f32
}
