//! Local passes that are cut short.

use super::*;
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::refinement::Ended;
use crate::scene::testing::{Pieces, facing_down};
use std::collections::HashMap;

/// A local pass of many elements that is interrupted at its beginning or in its middle traces few more rays; the light is that of the
/// whole pass within the error bars, and notes say what it is.
#[test]
fn an_interrupted_pass_of_many_elements_keeps_its_light() {
    let scene = crate::scene::testing::forest(27, 1200);
    let options = Options { error: 0.1, audit: 0, ..Options::default() };
    let model = model_for(&scene, &options);
    let solve = |stop: &dyn Progress| run(&model, &[], &options, stop).expect("a solution");
    let all = solve(&());
    let leaves = all.mesh.elements.len();
    // No more than 100,000 have rays all the same.
    assert!(leaves > 105_000, "{leaves} elements");
    let place = |mesh: &RadiosityMesh, e: &Element| {
        e.corners.map(|c| mesh.vertices[c as usize].to_array().map(f32::to_bits))
    };
    let places: HashMap<_, _> = all.mesh.elements.iter().map(|e| (place(&all.mesh, e), e)).collect();
    for steps in [0, leaves / 2] {
        let stop = stop_when(|told| told.stage == "local pass, rays" && told.stage_steps >= steps as u64);
        let Outcome { mesh, record, .. } = solve(&stop);
        assert!(record.interrupted && record.ended != Ended::Interrupted, "{:?}", record.ended);
        let notes = record.warnings.join("\n");
        assert!(notes.contains("elements have no rays") && notes.contains("an interruption"), "{notes}");
        assert!(record.exact_rays < all.record.exact_rays / 2, "{steps}: {} rays", record.exact_rays);
        let ratio = mean(record.mean_irradiance) / mean(all.record.mean_irradiance);
        assert!((ratio - 1.0).abs() < 0.1, "{steps}: {ratio}");
        let created = record.ledger.created.abs() / record.ledger.emitted;
        assert!(created < 0.02, "{steps}: {created}");
        // Most elements are the same, as surfaces had been split before; some are split further where light differs on them.
        let (mut squares, mut bars, mut found) = (0.0, 0.0, 0);
        for got in &mesh.elements {
            let Some(want) = places.get(&place(&mesh, got)) else { continue };
            found += 1;
            squares += got.area * (mean(got.irradiance) - mean(want.irradiance)).powi(2);
            bars += got.area * mean(got.error).powi(2) + got.area * mean(want.error).powi(2);
        }
        assert!(found > 100_000 && found < mesh.elements.len(), "{found}");
        let part: f64 = (squares / bars).sqrt();
        assert!((0.25..1.5).contains(&part), "{steps}: errors are {part} of their bars");
    }
}

/// Time that is up before the local pass: the largest elements, on which most light falls, have rays all the same.
#[test]
fn late_passes_trace_what_is_large() {
    let scene = room(true);
    let whole = Options { error: 0.05, audit: 0, ..Options::default() };
    let options = Options { max_seconds: Some(1e-6), ..whole.clone() };
    let late = solved(&scene, &[], &options).record;
    let all = solved(&scene, &[], &whole).record;
    let ratio = mean(late.mean_irradiance) / mean(all.mean_irradiance);
    assert!((ratio - 1.0).abs() < 0.1 && late.exact_rays < all.exact_rays / 2, "{ratio}");
    assert!(!late.warnings.join(" ").contains("have no rays"), "{:?}", late.warnings);
}

/// Time that is up before the local pass of a white box of shelves, each nearer to the next than elements are wide: most light goes through gaps, several times.
#[test]
fn late_passes_keep_the_light_in_gaps() {
    let mut pieces = Pieces::empty();
    pieces.grey("box", 0.9).room(DVec3::ZERO, DVec3::splat(2.0)).object("shelves");
    for k in 1..20 {
        let z = 0.1 * f64::from(k);
        pieces.rectangle(DVec3::new(0.0, 0.0, z), DVec3::X, 2.0 * DVec3::Y);
    }
    pieces.glowing("lamp", 10.0).object("lamp").polygon(&facing_down([1.7, 1.9], [0.9, 1.1], 1.99));
    let options = Options { max_seconds: Some(1e-6), audit: 0, ..Options::default() };
    let record = solved(&pieces.scene(), &[], &options).record;
    let created = record.ledger.created / record.ledger.emitted;
    assert!(created.abs() < 0.03, "{created}");
}
