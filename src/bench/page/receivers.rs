//! Shadow images of one receiver.

use base64::Engine;
use maud::{Markup, html};

use super::{ReceiverImages, length, plots};
use crate::Result;
use crate::bench::record::Record;
use crate::image_io::{Picture, difference, grey, mask_overlay};
use crate::metrics::{
    Fbem, FbemOptions, FeatureOptions, FeatureSet, Image, difference as differences, fbem, norms, spectrum,
    spectrum_sizes,
};
use crate::plot::number;

/// Images with fewer pixels per side are enlarged by an integer factor, so that texels stay sharp: 256 pixels are 2.2
/// cm in print at 300 pixels per inch. Layout only.
const MIN_SIDE_PIXELS: usize = 256;

/// Images, masks and spectrum of a receiver.
pub(super) fn section(record: &Record, images: &ReceiverImages) -> Result<Markup> {
    let ReceiverImages { name, reference, exact16, mr } = images;
    let unit = &record.unit;
    let mut features = FeatureSet::new(reference, &FeatureOptions::default())?;
    let range = difference_range(images)?;
    let rms = |image| Ok::<_, crate::Error>(number(norms(reference, image)?.l2));
    let mut rows = Vec::new();
    for (size, image) in mr {
        let mask = features.mask(f64::from(*size));
        let error = fbem_at(reference, image, f64::from(*size))?;
        rows.push(html! {
            h4 { "s = " (length(f64::from(*size), unit)) }
            div.images {
                (picture(&grey(image, 1.0), "multi-resolution", &format!("RMS {}", rms(image)?))?)
                (picture(&difference(reference, image, range)?, "difference", &format!("FBEM {}", number(error.value)))?)
                (picture(&mask_overlay(reference, 1.0, &mask)?, "feature mask", &covered(error.masked_fraction))?)
            }
        });
    }
    let exact = spectrum(reference, exact16, &sizes(reference, mr), &FbemOptions::default())?;
    let own = mr
        .iter()
        .map(|(size, image)| fbem_at(reference, image, f64::from(*size)))
        .collect::<Result<Vec<_>>>()?;
    Ok(html! {
        article {
            h3 { (name) }
            p.note {
                (reference.width()) " × " (reference.height()) " texels of " (length(reference.texel(), unit))
                ". Differences are shown on the scale " (legend(range))
            }
            div.images {
                (scaled(reference, unit)?)
                (picture(&grey(exact16, 1.0), "exact, 16 rays", &format!("RMS {}", rms(exact16)?))?)
                (picture(&difference(reference, exact16, range)?, "difference", "exact, 16 rays − reference")?)
            }
            @for row in rows { (row) }
            (plots::spectrum(&exact, &own, unit)?)
        }
    })
}

/// FBEM with default options.
pub(super) fn fbem_at(reference: &Image, image: &Image, size: f64) -> Result<Fbem> {
    fbem(reference, image, &FbemOptions { size, ..FbemOptions::default() })
}

/// Sizes of the spectrum of the exact image: up to 1.5 times the largest size of an MR image.
fn sizes(reference: &Image, mr: &[(f32, Image)]) -> Vec<f64> {
    let largest = mr.iter().fold(0.0f64, |m, (s, _)| m.max(f64::from(*s)));
    let mut sizes = spectrum_sizes(reference, 14);
    if largest > 0.0 {
        sizes.retain(|s| *s <= 1.5 * largest);
        sizes.extend(mr.iter().map(|(s, _)| f64::from(*s)));
        sizes.sort_by(f64::total_cmp);
        sizes.dedup_by(|a, b| (*a - *b).abs() < 1e-6 * *b);
    }
    sizes
}

/// End of the colour scale of differences: a round number that at least 99 of 100 texels do not exceed.
fn difference_range(images: &ReceiverImages) -> Result<f32> {
    let mut largest = 0.0;
    for image in images.mr.iter().map(|(_, image)| image).chain([&images.exact16]) {
        let mut d: Vec<f64> = differences(&images.reference, image)?.into_iter().map(f64::abs).collect();
        d.sort_by(f64::total_cmp);
        largest = d[d.len() * 99 / 100].max(largest);
    }
    Ok([0.01, 0.02, 0.05, 0.1, 0.2, 0.5].into_iter().find(|r| largest <= f64::from(*r)).unwrap_or(1.0))
}

fn legend(range: f32) -> Markup {
    let end = number(f64::from(range));
    html! { span.legend { "−" (end) span.bar {} "+" (end) } }
}

fn covered(part: f64) -> String {
    format!("{:.0} % of the image", 100.0 * part)
}

/// A picture with its caption.
fn picture(picture: &Picture, what: &str, note: &str) -> Result<Markup> {
    Ok(html! {
        figure { img src=(data_url(picture)?) alt=(what); figcaption { b { (what) } " " (note) } }
    })
}

/// The reference with a scale bar.
fn scaled(reference: &Image, unit: &str) -> Result<Markup> {
    let whole = reference.width() as f64 * reference.texel();
    let power = 10f64.powf((whole / 3.0).log10().floor());
    let bar = [5.0, 2.0, 1.0].into_iter().map(|m| m * power).find(|b| *b <= whole / 3.0).unwrap_or(power);
    Ok(html! {
        figure {
            div.frame {
                img src=(data_url(&grey(reference, 1.0))?) alt="reference";
                div.scale style=(format!("width:{:.2}%", 100.0 * bar / whole)) { span { (length(bar, unit)) } }
            }
            figcaption { b { "reference" } " exact, very many rays" }
        }
    })
}

fn data_url(picture: &Picture) -> Result<String> {
    let times = MIN_SIDE_PIXELS / picture.width.max(picture.height).max(1);
    let png = picture.enlarged(times).png()?;
    Ok(format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(png)))
}
