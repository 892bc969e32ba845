//! Explanations on the page.

use maud::{Markup, html};

/// Introduction to the shadow images.
pub(super) fn shadow_images() -> Markup {
    html! {
        p {
            "Each image shows the visible fraction of the emitters at every place of a surface: white sees all of \
             them, black none. The bar at the lower left of the first image is the scale. The difference is \
             multi-resolution minus reference: "
            span.red { "red" } " is too bright, " span.blue { "blue" } " too dark; a " span.mark { "circle" }
            " marks the largest, and the plot below is a cross-section through it. The mask shows in orange all \
             features (shadows and lit regions) larger than s; there the image is compared texel by texel, elsewhere \
             on average. A feature size whose image looks like one that is shown already is only named."
        }
    }
}

/// Glossary.
pub(super) fn how_to_read() -> Markup {
    let entries = [
        (
            "Visible fraction",
            "The fraction of an emitter's area, between 0 and 1, that a point sees. In scenes with much small detail \
            its computation takes most of the time.",
        ),
        (
            "Exact",
            "Rays from a point to random places on the emitter, tested by Embree. The visible fraction is the fraction \
            of rays that arrive; the noise of n rays falls as 1/√n.",
        ),
        (
            "Multi-resolution (MR)",
            "Clusters of objects are measured beforehand: their average extinction, and the size of their largest \
            blocker or gap. A cluster whose largest umbra would be smaller than s is averaged; otherwise it is opened, \
            down to its triangles.",
        ),
        (
            "Feature size s",
            "The size on the receiving surface below which the shape of shadows does not matter, only their average. \
            MR is faster with a large s and more faithful with a small one.",
        ),
        (
            "Umbra",
            "The part of a shadow that sees nothing of the emitter. The penumbra around it sees a part.",
        ),
        (
            "RMS error",
            "Root mean square of the differences to the reference. It does not distinguish small from large features.",
        ),
        (
            "FBEM",
            "Feature-based error metric: RMS error that compares texel by texel inside features larger than s, and \
            averages over squares of side s elsewhere. At s = 0 it is the RMS error.",
        ),
        (
            "Reference",
            "Exact visibility with many independent rays. Its noise is subtracted from the errors and stated above.",
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
