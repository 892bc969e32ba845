//! Shadow images of one receiver.

use maud::{Markup, html};

use super::{MrImage, ReceiverImages, cross_section, spectrum};
use crate::Result;
use crate::bench::record::Record;
use crate::image_io::{Picture, difference, grey, mask_overlay};
use crate::metrics::{
    FbemOptions, FeatureOptions, FeatureSet, Image, difference as differences,
    fbem::{fbem, fbem_at},
    norms, spectrum_sizes,
};
use crate::page::{data_url, length, signed};
use crate::plot::number;

/// Images with fewer columns are shown with sharp texels, others scaled smoothly: a column of three is as wide.
const MIN_SMOOTHED_COLUMNS: usize = 300;
/// Images that differ nowhere by more than this visible fraction look alike: two steps of 8-bit grey.
const MAX_EQUAL_DIFFERENCE: f32 = 2.0 / 255.0;

/// Images, masks and spectrum of a receiver.
pub(super) fn section(record: &Record, images: &ReceiverImages) -> Result<Markup> {
    let ReceiverImages { name, surface, reference, exact16, mr, clusters } = images;
    let unit = &record.unit;
    let mut features = FeatureSet::new(reference, &FeatureOptions::default())?;
    let range = difference_range(images)?;
    let compared = Compared { images, range, unit };
    let (mut rows, mut same) = (Vec::new(), Vec::new());
    let mut shown: Vec<(String, &Image)> = vec![("exact rays, 16".into(), exact16)];
    for MrImage { size, image, handed_over } in mr {
        let label = format!("s = {}", length(f64::from(*size), unit));
        if let Some(like) = looks_like(&shown, image) {
            same.push(if *handed_over {
                format!("{label}: all bundles were handed to Embree; this is the image of exact rays.")
            } else {
                format!("{label}: no texel differs visibly from the image of {like}.")
            });
            continue;
        }
        rows.push(compared.row(&label, f64::from(*size), image, &mut features)?);
        shown.push((label, image));
    }
    let unlike = clusters.as_ref().filter(|image| looks_like(&shown, image).is_none());
    if let (Some(image), Some(largest)) = (unlike, mr.last()) {
        let s = f64::from(largest.size);
        let label = format!(
            "s = {}, answered by clusters: not in the table, because exact rays are faster here",
            length(s, unit)
        );
        rows.push(compared.row(&label, s, image, &mut features)?);
    }
    let exact = fbem(reference, exact16, &sizes(reference, mr), &FbemOptions::default())?;
    let own = mr
        .iter()
        .map(|row| fbem_at(reference, &row.image, f64::from(row.size)))
        .collect::<Result<Vec<_>>>()?;
    let spot = Spot::of(reference, exact16)?;
    Ok(html! {
        article {
            h3 { (name) }
            p.note { (texels(reference, *surface, unit)) }
            p.note.legend { span { "Differences:" } span { "−" (number(f64::from(range))) } span.bar {} span { "+" (number(f64::from(range))) } }
            div.images {
                (scaled(reference, unit)?)
                (picture(&grey(exact16, 1.0), Some(&spot), "exact, 16 rays", &rms(reference, exact16)?)?)
                (picture(&difference(reference, exact16, range)?, Some(&spot), "difference", &format!(
                    "exact, 16 rays − reference; circle: the largest, {}", signed(spot.difference)
                ))?)
            }
            @for row in same { p.note { (row) } }
            @for row in rows { (row) }
            (spectrum(&exact, &own, unit)?)
        }
    })
}

/// Data that all rows of images share.
struct Compared<'a> {
    images: &'a ReceiverImages,
    /// End of the colour scale of differences.
    range: f32,
    unit: &'a str,
}

impl Compared<'_> {
    /// An image at feature size `s`, its difference to the reference, the feature mask, and a cross-section.
    fn row(&self, label: &str, s: f64, image: &Image, features: &mut FeatureSet) -> Result<Markup> {
        let ReceiverImages { reference, exact16, .. } = self.images;
        let mask = features.mask(s);
        let error = fbem_at(reference, image, s)?;
        let spot = Spot::of(reference, image)?;
        let largest = format!(
            "FBEM {}; circle: the largest, {} at texel {}, {}",
            number(error.value),
            signed(spot.difference),
            spot.x,
            spot.y
        );
        let colours = difference(reference, image, self.range)?;
        let tinted = mask_overlay(reference, 1.0, &mask)?;
        Ok(html! {
            h4 { (label) }
            div.images {
                (picture(&grey(image, 1.0), Some(&spot), "multi-resolution", &rms(reference, image)?)?)
                (picture(&colours, Some(&spot), "difference", &largest)?)
                (picture(&tinted, None, "feature mask", &covered(error.masked_fraction))?)
            }
            (cross_section([reference, exact16, image], spot.y, self.unit)?)
        })
    }
}

fn rms(reference: &Image, image: &Image) -> Result<String> {
    Ok(format!("RMS {}", number(norms(reference, image)?.l2)))
}

/// The name of a shown image that looks like this one.
fn looks_like<'a>(shown: &'a [(String, &Image)], image: &Image) -> Option<&'a str> {
    let alike = |other: &Image| {
        other.data().len() == image.data().len()
            && other.data().iter().zip(image.data()).all(|(a, b)| (a - b).abs() <= MAX_EQUAL_DIFFERENCE)
    };
    shown.iter().find(|(_, other)| alike(other)).map(|(name, _)| name.as_str())
}

/// Number and size of the texels, and the window that they cover.
fn texels(image: &Image, surface: [f64; 2], unit: &str) -> String {
    let (width, height, texel) = (image.width(), image.height(), image.texel());
    let window = [width as f64 * texel, height as f64 * texel];
    let sides = |[w, h]: [f64; 2]| format!("{} × {}", length(w, unit), length(h, unit));
    let of = match window[0] < 0.99 * surface[0] || window[1] < 0.99 * surface[1] - texel {
        true => format!(": a window of {} of a surface of {}", sides(window), sides(surface)),
        false => format!(": the surface of {}", sides(window)),
    };
    format!("{width} × {height} texels of {}{of}.", length(texel, unit))
}

/// The texel with the largest difference to the reference.
pub(super) struct Spot {
    pub x: usize,
    pub y: usize,
    pub difference: f64,
    /// Columns and rows of the image.
    of: [usize; 2],
}

impl Spot {
    pub fn of(reference: &Image, image: &Image) -> Result<Spot> {
        let d = differences(reference, image)?;
        let largest = |best: usize, k: usize| if d[k].abs() > d[best].abs() { k } else { best };
        let at = (0..d.len()).fold(0, largest);
        let width = image.width();
        Ok(Spot { x: at % width, y: at / width, difference: d[at], of: [width, image.height()] })
    }

    /// A circle around the texel.
    fn circle(&self) -> Markup {
        let part = |at: usize, n: usize| 100.0 * (at as f64 + 0.5) / n as f64;
        let place = format!("left:{:.2}%;top:{:.2}%", part(self.x, self.of[0]), part(self.y, self.of[1]));
        html! { div.spot style=(place) {} }
    }
}

/// Sizes of the spectrum of the exact image: up to 1.5 times the largest size of an MR image.
fn sizes(reference: &Image, mr: &[MrImage]) -> Vec<f64> {
    let largest = mr.iter().fold(0.0f64, |m, row| m.max(f64::from(row.size)));
    let mut sizes = spectrum_sizes(reference, 14);
    if largest > 0.0 {
        sizes.retain(|s| *s <= 1.5 * largest);
        sizes.extend(mr.iter().map(|row| f64::from(row.size)));
        sizes.sort_by(f64::total_cmp);
        sizes.dedup_by(|a, b| (*a - *b).abs() < 1e-6 * *b);
    }
    sizes
}

/// End of the colour scale of differences: a round number that at least 99 of 100 texels do not exceed.
fn difference_range(images: &ReceiverImages) -> Result<f32> {
    let mut largest = 0.0;
    for image in images.mr.iter().map(|row| &row.image).chain([&images.exact16]) {
        let mut d: Vec<f64> = differences(&images.reference, image)?.into_iter().map(f64::abs).collect();
        d.sort_by(f64::total_cmp);
        largest = d[d.len() * 99 / 100].max(largest);
    }
    Ok([0.01, 0.02, 0.05, 0.1, 0.2, 0.5].into_iter().find(|r| largest <= f64::from(*r)).unwrap_or(1.0))
}

fn covered(part: f64) -> String {
    format!("{:.0} % of the image", 100.0 * part)
}

/// A picture with its caption and, if there is one, a circle around a texel.
fn picture(picture: &Picture, spot: Option<&Spot>, what: &str, note: &str) -> Result<Markup> {
    let class = (picture.width < MIN_SMOOTHED_COLUMNS).then_some("texels");
    Ok(html! {
        figure {
            div.frame {
                img class=[class] src=(data_url(picture)?) alt=(what);
                @if let Some(spot) = spot { (spot.circle()) }
            }
            figcaption { b { (what) } " " (note) }
        }
    })
}

/// The reference with a scale bar.
fn scaled(reference: &Image, unit: &str) -> Result<Markup> {
    let whole = reference.width() as f64 * reference.texel();
    let power = 10f64.powf((whole / 3.0).log10().floor());
    let bar = [5.0, 2.0, 1.0].into_iter().map(|m| m * power).find(|b| *b <= whole / 3.0).unwrap_or(power);
    let class = (reference.width() < MIN_SMOOTHED_COLUMNS).then_some("texels");
    Ok(html! {
        figure {
            div.frame {
                img class=[class] src=(data_url(&grey(reference, 1.0))?) alt="reference";
                div.length style=(format!("width:{:.2}%", 100.0 * bar / whole)) {}
                div.length-name { (length(bar, unit)) }
            }
            figcaption { b { "reference" } " exact, very many rays" }
        }
    })
}
