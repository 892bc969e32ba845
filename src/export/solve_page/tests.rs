//! The page of a solution of the Cornell box.

use super::*;
use crate::model::Model;
use crate::radiosity::Options;
use crate::scene::testing::generated;

fn page(audit: usize, photometry: Option<Photometry>) -> (String, Record) {
    let mut scene = generated("cornell");
    scene.materials[0].name = "<b>white</b>".into();
    let options = Options { audit, error: 0.2, local_rays: Some(0), ..Options::default() };
    let model = Model::prepare(scene, &options.prepare()).expect("a model");
    let outcome = crate::radiosity::run(&model, &[], &options, &()).expect("a solution");
    let view = PageView {
        name: "view <1>".into(),
        picture: Picture { width: 2, height: 2, pixels: vec![[9; 3]; 4] },
        seen: vec![
            PixelContent::Surface([1.0; 3]),
            PixelContent::Surface([2.0; 3]),
            PixelContent::Surface([5.0; 3]),
            PixelContent::Nothing,
        ],
    };
    let page = solve_page(
        &outcome.record,
        model.scene(),
        photometry,
        &outcome.mesh,
        &[view],
        &Markup::default(),
        "mrvis solve",
    )
    .expect("a page");
    (page, outcome.record)
}

#[test]
fn the_page_stands_alone_and_names_what_it_shows() {
    let (page, record) = page(60, None);
    assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>"));
    for outside in ["http://", "https://", "src=\"/", "href=", "@import", "url("] {
        let mut found = page.match_indices(outside).map(|(i, _)| &page[i..i + 40]);
        assert!(found.all(|s| s.starts_with("http://www.w3.org/2000/svg")), "{outside}");
    }
    assert!(page.contains("&lt;b&gt;white") && !page.contains("<b>white") && page.contains("view &lt;1&gt;"));
    // A picture and its irradiance; the flow; the audit for wide and for narrow windows.
    assert_eq!(page.matches("data:image/png;base64,").count(), 2);
    assert_eq!((page.matches("<svg class=\"flow\"").count(), page.matches("<svg ").count()), (1, 3));
    assert!(page.contains("W/m²") && page.contains(&format!("{} W", number(record.ledger.emitted))));
    assert!(
        page.contains("Are the error bars right?") && page.contains("for a normal distribution): the bars")
    );
    assert!(page.contains("escaped from the scene"));
}

#[test]
fn photometric_pages_are_in_lux_and_without_an_audit_say_nothing_about_it() {
    let photometry = Photometry::default();
    let (page, record) = page(0, Some(photometry));
    let mean = photometry.of(record.mean_irradiance);
    assert!(page.contains(&format!("{} lx", number(mean))) && page.contains("mean illuminance"));
    assert!(page.contains("illuminance of view") && !page.contains("mean irradiance"));
    let (powers, unit) = record.ledger.shown(Some(photometry));
    assert_eq!(unit, "lm");
    // The emission of the lamp is the only power of this page that exceeds all others: it is in the head and above the flow.
    assert_eq!(page.matches(&format!("{} lm", number(powers.emitted))).count(), 2);
    assert!(!page.contains(&format!("{} W", number(record.ledger.emitted))));
    assert!(record.audit.is_none_or(|audit| audit.elements == 0));
    assert!(!page.contains("Are the error bars right?"));
    // The pixels have 1, 2 and 5 W/m² in each channel.
    let lux = [1.0, 2.0, 5.0].map(|e| photometry.of([e; 3]) as f32);
    assert!(page.contains(&Bands::of(lux.into_iter()).legend("Illuminance in lx:", false).into_string()));
}

/// What emits is hatched, and its irradiance does not count in the choice of colours.
#[test]
fn emitters_are_not_painted_by_what_they_receive() {
    let view = |seen| PageView {
        name: "view".into(),
        picture: Picture { width: 4, height: 1, pixels: vec![[9; 3]; 4] },
        seen: [PixelContent::Surface([1.0; 3]), PixelContent::Surface([2.0; 3]), PixelContent::Nothing, seen]
            .to_vec(),
    };
    let page = |seen| pictures(&[view(seen)], LightUnit(None)).expect("a page").into_string();
    let emitting = page(PixelContent::Emitter);
    assert!(emitting.contains("emits light") && !page(PixelContent::Nothing).contains("emits light"));
    let bands = Bands::of([1.0, 2.0].into_iter());
    let mut picture = bands.picture(4, &[Some(1.0), Some(2.0), None, None]);
    picture.pixels[3] = hatched([3, 0]);
    assert!(emitting.contains(&data_url(&picture).expect("a picture")));
}
