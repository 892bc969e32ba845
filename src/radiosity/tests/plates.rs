//! A lamp, a floor and a plate between them, whose form factors are published.

use super::*;
use crate::form_factors::testing::obstructed;
use crate::radiosity::links::Link;
use std::f64::consts::FRAC_1_PI;

/// A unit lamp of radiosity 1 that faces a unit square at z = 0, and between them a black square of side `size`.
fn plates(low: DVec3, size: f64) -> Scene {
    let mut pieces = Pieces::empty();
    pieces.glowing("lamp", FRAC_1_PI as f32).rectangle(DVec3::Z, DVec3::Y, DVec3::X);
    pieces.grey("floor", 0.0).rectangle(DVec3::ZERO, DVec3::X, DVec3::Y);
    pieces.grey("blocker", 0.0).rectangle(low, size * DVec3::X, size * DVec3::Y);
    pieces.scene()
}

#[test]
fn solutions_of_published_obstructed_pairs() {
    // The lamp's radiosity is 1, so the floor's mean irradiance is the form factor.
    let n = 24;
    let at = |k: usize| (k as f64 + 0.5) / n as f64;
    let point = |k: usize| Point { position: DVec3::new(at(k % n), at(k / n), 0.0), normal: DVec3::Z };
    let grid: Vec<Point> = (0..n * n).map(point).collect();
    for (id, quantity, low, size) in [
        ("facet_shapiro", "F(y=1 -> y=0)", DVec3::new(0.25, 0.25, 0.75), 0.5),
        ("view3d_square_obstruction", "F(z=0 -> z=1)", DVec3::new(0.0, 0.0, 0.5), 0.5),
        ("centred_half_obstruction", "F12", DVec3::new(0.25, 0.25, 0.5), 0.5),
    ] {
        let want = obstructed(id, quantity);
        let options = Options { audit: 0, min_area: 1e-4, ..Options::default() };
        let outcome = solved(&plates(low, size), &grid, &options);
        let points = outcome.irradiance.iter().map(|e| e[0]).sum::<f64>() / grid.len() as f64;
        assert!((points / want - 1.0).abs() < 5e-3, "{id} at points: {points} instead of {want}");
        // Elements sample visibility with few segments; the errors have no bias.
        let floor = outcome.mesh.elements.iter().filter(|e| e.object == 1 && e.front);
        let (light, area) =
            floor.fold((0.0, 0.0), |(light, area), e| (light + e.irradiance[0] * e.area, area + e.area));
        let mean = light / area;
        assert!((mean / want - 1.0).abs() < 0.02, "{id} of the elements: {mean} instead of {want}");
    }
    let options = Options { audit: 0, elements: false, ..Options::default() };
    let hidden = solved(&plates(DVec3::new(-0.1, -0.1, 0.5), 1.2), &grid, &options);
    assert!(hidden.irradiance.iter().all(|e| *e == [0.0; 3]));
}

#[test]
fn ten_million_links_take_less_than_a_gibibyte() {
    // Stored size, and 32 bytes of temporary data per link during refinement and sweeps.
    let stored = size_of::<Link>();
    assert!(stored <= 40 && 10_000_000 * (stored + 32) < 1 << 30, "{stored}");
    let options = Options { error: 0.01, local_rays: Some(20_000), audit: 0, ..Options::default() };
    let record = solved(&plates(DVec3::new(0.25, 0.25, 0.5), 0.5), &[], &options).record;
    let (links, elements) = (record.links, record.elements);
    assert!(links > 2000, "{links}");
    // Memory is proportional to elements and links only.
    assert!(record.bytes < 80 * links + 400 * elements + 100_000, "{} {links} {elements}", record.bytes);
}
