//! Explanations on the page.

use maud::{Markup, html};

/// Introduction to the shadow images.
pub(super) fn shadow_images() -> Markup {
    html! {
        p {
            "Each image shows how much of the light can be seen from every place of a surface: white sees all of it, \
             black none. The bar at the lower left of the first image gives the scale. The difference is \
             multi-resolution minus reference: "
            span.red { "red" } " is too bright, " span.blue { "blue" } " too dark. The mask shows in orange what \
             belongs to a feature, a shadow or a patch of light, larger than s; there the image has to be right texel \
             by texel, elsewhere only on average."
        }
    }
}

/// Glossary.
pub(super) fn how_to_read() -> Markup {
    let entries = [
        (
            "Visibility",
            "The part of a light, between 0 and 1, that can be seen from a point: what has to be known \
            before any light can be computed. In scenes full of small things it takes most of the time.",
        ),
        (
            "Exact",
            "Rays from a point to places on the light, each blocked or not, answered by Embree. The answer for \
            a point is the part of its rays that arrive: with few rays it is noisy, and the noise falls only with the \
            square root of their number.",
        ),
        (
            "Multi-resolution (MR)",
            "Groups of small objects are measured beforehand: how much light goes through them, \
            and how large the largest thing in them is. Where nothing in a group can cast a shadow that matters, the \
            group is treated as a haze; otherwise it is opened and its parts are looked at, down to exact rays.",
        ),
        (
            "Feature size s",
            "The size on the receiving surface below which you do not care for the shape of a shadow, \
            only for its average darkness. A large s is faster, a small one more faithful.",
        ),
        (
            "Umbra",
            "The part of a shadow that sees nothing of the light; around it lies the penumbra, which sees a \
            part. A group is averaged when the umbra of its largest object would be smaller than s.",
        ),
        (
            "RMS error",
            "Root mean square of the difference to the reference. It cannot tell whether what is wrong is \
            large or small.",
        ),
        (
            "FBEM",
            "Feature-based error metric: an RMS error that compares point by point inside features larger than \
            s, and averages over squares of side s elsewhere. It is small when everything larger than s is right. At \
            s = 0 it is the RMS error.",
        ),
        (
            "Reference",
            "Exact visibility with very many rays. Its own noise is subtracted from the errors and stated \
            in the facts above.",
        ),
    ];
    html! {
        section {
            h2 { "How to read this" }
            dl.glossary { @for (word, meaning) in entries { dt { (word) } dd { (meaning) } } }
            p.note {
                "Multi-resolution visibility and the feature-based error are due to F. Sillion and G. Drettakis, "
                cite { "Feature-based control of visibility error: a multi-resolution clustering algorithm for global \
                    illumination" }
                ", SIGGRAPH 1995 (INRIA report RR-2503)."
            }
        }
    }
}
