//! Images of a run as files.

use super::super::args::{distinct, plain};
use mrvis::Result;
use mrvis::internals::bench::page::{MrImage, ReceiverImages};
use mrvis::internals::image_io::{difference, grey, mask_overlay, write_exr, write_png};
use mrvis::internals::metrics::FeatureSet;
use mrvis::metrics::{FeatureOptions, Image};
use std::path::Path;

/// Writes images as PNG (tone-mapped) and EXR (values), differences and feature masks.
pub fn write_pictures(folder: &Path, receivers: &[ReceiverImages]) -> Result<()> {
    let stems = distinct(receivers.iter().map(|receiver| file_stem(&receiver.name)));
    for (receiver, stem) in receivers.iter().zip(stems) {
        let both = |what: &str, image: &Image| -> Result<()> {
            write_png(&folder.join(format!("{stem}-{what}.png")), &grey(image, 1.0))?;
            write_exr(&folder.join(format!("{stem}-{what}.exr")), image)
        };
        let reference = &receiver.reference;
        both("reference", reference)?;
        let compared = |what: &str, image: &Image| -> Result<()> {
            both(what, image)?;
            let picture = difference(reference, image, 0.5)?;
            write_png(&folder.join(format!("{stem}-{what}-difference.png")), &picture)
        };
        compared("exact16", &receiver.exact16)?;
        let mut features = FeatureSet::new(reference, &FeatureOptions::default())?;
        for MrImage { size: s, image, .. } in &receiver.mr {
            compared(&format!("mr-{s}"), image)?;
            let mask = mask_overlay(reference, 1.0, &features.mask(f64::from(*s)))?;
            write_png(&folder.join(format!("{stem}-mask-{s}.png")), &mask)?;
        }
    }
    Ok(())
}

/// Whether a picture of a receiver with one of the stems may get the name `file`.
pub fn may_be_written(stems: &[String], file: &str) -> bool {
    let Some((name, _)) = file.rsplit_once('.').filter(|(_, end)| ["png", "exr"].contains(end)) else {
        return false;
    };
    let number = |text: &str| text.parse::<f32>().is_ok();
    let is_picture = |what: &str| {
        let of_size = what.strip_prefix("mr-").map(|s| s.strip_suffix("-difference").unwrap_or(s));
        ["reference", "exact16", "exact16-difference"].contains(&what)
            || of_size.or(what.strip_prefix("mask-")).is_some_and(number)
    };
    // Of equal stems the later ones are numbered.
    let numbered = |rest: &str| rest.split_once('-').is_some_and(|(n, what)| number(n) && is_picture(what));
    let of_stem = |stem: &String| name.strip_prefix(stem).and_then(|rest| rest.strip_prefix('-'));
    stems.iter().filter_map(of_stem).any(|rest| is_picture(rest) || numbered(rest))
}

/// A name that is valid in every file system.
pub fn file_stem(name: &str) -> String {
    let stem = plain(name);
    if stem.is_empty() { "receiver".into() } else { stem }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_file_names() {
        assert_eq!(file_stem("a/b: c"), "a_b__c");
        assert_eq!(file_stem(""), "receiver");
    }

    #[test]
    fn names_of_pictures_are_known() {
        let stems = ["floor".to_string()];
        for name in ["floor-reference.exr", "floor-2-mask-0.5.png", "floor-mr-0.25-difference.png"] {
            assert!(may_be_written(&stems, name), "{name}");
        }
        for name in ["wood.png", "floor.png", "wall-reference.exr", "floor-reference.obj", "floor-mask-a.png"]
        {
            assert!(!may_be_written(&stems, name), "{name}");
        }
    }
}
