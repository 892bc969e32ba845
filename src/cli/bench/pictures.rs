//! Images of a run as files.

use super::super::args::{distinct, plain};
use crate::Result;
use crate::bench::page::{MrImage, ReceiverImages};
use crate::image_io::{difference, grey, mask_overlay, write_exr, write_png};
use crate::metrics::{FeatureOptions, FeatureSet, Image};
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

/// A name that is valid in every file system.
fn file_stem(name: &str) -> String {
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
}
