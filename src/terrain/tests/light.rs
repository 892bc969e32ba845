use super::*;
use glam::DVec3;
use std::f64::consts::PI;

fn sun(azimuth: f64, elevation: f64, half_angle: f64) -> Sun {
    Sun { azimuth, elevation, half_angle }
}

/// A wall from south to north in column 100.
fn wall() -> Grid {
    let heights = (0..201 * 51).map(|i| if i % 201 == 100 { 20.0 } else { 0.0 }).collect();
    Grid::new(201, 51, [1.0; 2], heights).expect("a grid")
}

#[test]
fn shadows_have_their_length() {
    let grid = wall();
    for (azimuth, elevation) in
        [(PI / 2.0, 0.4), (PI / 2.0 + 0.5, 0.4), (3.0 * PI / 2.0, 0.3), (PI / 3.0, 0.7)]
    {
        let lit = sunlit(&grid, &sun(azimuth, elevation, 0.0), &flat()).expect("sunlit");
        // Across the wall the shadow is shorter by the sine of the azimuth.
        let length = 20.0 / elevation.tan() * azimuth.sin();
        for column in 0..201usize {
            let behind = (100.0 - column as f64) / length;
            let value = lit[25 * 201 + column];
            if behind > 0.1 && behind < 1.0 - 1.0 / length.abs() {
                assert_eq!(value, 0.0, "azimuth {azimuth}, column {column}");
            } else if behind > 1.0 + 1.0 / length.abs() || behind < -2.0 / length.abs() {
                assert_eq!(value, 1.0, "azimuth {azimuth}, column {column}");
            }
        }
    }
    let night = sunlit(&grid, &sun(1.0, -0.1, 0.00465), &flat()).expect("sunlit");
    assert!(night.iter().all(|v| *v == 0.0));
}

/// Shadows end between samples: where a ray to the sun passes an edge by less than the distance of samples, the sweep may differ
/// from it.
#[test]
fn shadows_of_rough_terrain_agree_with_exact_horizons() {
    let grid = fractal(300, 200, 10.0, 1500.0, 0.5, 9).expect("a grid");
    for (azimuth, elevation) in [(0.3f64, 0.25f64), (2.0, 0.1), (4.4, 0.4)] {
        let lit = sunlit(&grid, &sun(azimuth, elevation, 0.0), &flat()).expect("sunlit");
        let (mut wrong, mut shaded) = (0, 0);
        for [c, r] in spread(&grid, 3000) {
            let own = f64::from(tilt(&grid, [c, r], azimuth).own_horizon());
            let is_lit = elevation.tan() > own.max(exact_tangent(&grid, [c, r], azimuth));
            wrong += usize::from(is_lit != (lit[r * 300 + c] > 0.5));
            shaded += usize::from(!is_lit);
        }
        assert!(
            shaded > 100 && wrong < 30,
            "{azimuth} {elevation}: {wrong} of 3000 differ, {shaded} in shadow"
        );
    }
}

/// Horizons in azimuths one by one are those of shadows, also on grids that are much longer than wide.
#[test]
fn horizons_bound_shadows() {
    for (columns, rows) in [(150, 120), (9, 700), (700, 9), (2, 40)] {
        let rough = fractal(columns.max(9), rows.max(9), 5.0, 100.0, 0.6, 1).expect("a grid");
        let heights = (0..columns * rows).map(|i| rough.height(i % columns, i / columns)).collect();
        let grid = Grid::new(columns, rows, [5.0, 3.0], heights).expect("a grid");
        let found = horizon(&grid, 9, &flat()).expect("horizons");
        assert_eq!((found.azimuths.len(), found.elevations.len()), (9, 9));
        for (azimuth, elevations) in found.azimuths.iter().zip(&found.elevations) {
            let lit = sunlit(&grid, &sun(*azimuth, 0.3, 0.0), &flat()).expect("sunlit");
            for (lit, elevation) in lit.iter().zip(elevations) {
                // Lit samples may have a lower horizon of their own slope.
                assert!(*elevation >= 0.0 && (*lit == 0.0 || *elevation < 0.3 + 1e-4));
            }
        }
    }
}

/// The part of a disc above a skyline, whose elevations depend on the azimuth from the middle of the disc, by vertical chords.
fn part_above(elevation: f64, radius: f64, skyline: impl Fn(f64) -> f64) -> f64 {
    let (mut seen, mut all) = (0.0, 0.0);
    for k in 0..1000 {
        let x = (f64::from(k) + 0.5) / 500.0 - 1.0;
        let half = radius * (1.0 - x * x).sqrt();
        let above = elevation - skyline(x * radius / elevation.cos());
        seen += (above + half).clamp(0.0, 2.0 * half);
        all += 2.0 * half;
    }
    seen / all
}

#[test]
fn half_shadows_are_as_wide_as_the_disc() {
    let (grid, elevation, half) = (wall(), 0.5f64, 0.05f64);
    let lit = sunlit(&grid, &sun(PI / 2.0, elevation, half), &flat()).expect("sunlit");
    let mut half_lit = 0;
    for column in 0..98usize {
        let horizon = |aside: f64| (20.0 * aside.cos() / (100.0 - column as f64)).atan();
        let expected = part_above(elevation, half, horizon);
        let value = f64::from(lit[25 * 201 + column]);
        assert!((value - expected).abs() < 1e-3, "column {column}: {value} instead of {expected}");
        half_lit += usize::from(value > 0.0 && value < 1.0);
    }
    assert!(half_lit > 5);
}

#[test]
fn slopes_that_face_away_are_in_shadow() {
    // Falls to the east by 0.5 rad.
    let grid = plane(21, 1.0, 0.5, PI / 2.0).expect("a grid");
    let towards = |azimuth, elevation| {
        sunlit(&grid, &sun(azimuth, elevation, 0.0), &flat()).expect("sunlit")[10 * 21 + 10]
    };
    assert_eq!([towards(PI / 2.0, 0.1), towards(1.5 * PI, 0.45), towards(1.5 * PI, 0.55)], [1.0, 0.0, 1.0]);
}

/// A skyline that rises by 45 degrees to the east cuts the disc of the sun askew.
#[test]
fn the_visible_part_of_the_sun_follows_the_slope_of_the_skyline() {
    let height = |i: usize| if i / 301 < 30 { (50.0 + (i % 301) as f32 - 150.0).max(0.0) } else { 0.0 };
    let grid = Grid::new(301, 151, [1.0; 2], (0..301 * 151).map(height).collect()).expect("a grid");
    let (distance, radius) = (101.0f64, 0.05f64);
    let skyline = |azimuth: f64| (50.0 / distance * azimuth.cos() + azimuth.sin()).atan();
    for above in [-0.8, -0.4, 0.0, 0.4, 0.8] {
        let elevation = skyline(0.0) + above * radius;
        let want = part_above(elevation, radius, skyline);
        let found = sunlit(&grid, &sun(0.0, elevation, radius), &flat()).expect("sunlit")[130 * 301 + 150];
        assert!((f64::from(found) - want).abs() < 0.02, "{above}: {found} instead of {want}");
    }
}

#[test]
fn the_sun_on_a_tilted_plane_is_a_cosine() {
    for (inclination, facing) in [(0.4f64, 2.0f64), (0.9, 5.0)] {
        let grid = plane(41, 1.0, inclination, facing).expect("a grid");
        for (azimuth, elevation) in [(2.3f64, 0.6f64), (4.0, 1.2)] {
            let direction =
                DVec3::new(azimuth.sin() * elevation.cos(), azimuth.cos() * elevation.cos(), elevation.sin());
            let normal = DVec3::new(
                facing.sin() * inclination.sin(),
                facing.cos() * inclination.sin(),
                inclination.cos(),
            );
            let light = Light { sun: sun(azimuth, elevation, 0.00465), direct_normal: 800.0, sky: &|_| 0.0 };
            let values = irradiance(&grid, &light, 16, &flat()).expect("irradiance");
            let expected = 800.0 * normal.dot(direction).max(0.0);
            for value in values {
                assert!(
                    (f64::from(value) - expected).abs() < 0.0005 * 800.0,
                    "{value} instead of {expected}"
                );
            }
        }
    }
}

#[test]
fn a_uniform_sky_gives_its_view_factor() {
    let grid = fractal(120, 90, 10.0, 600.0, 0.55, 5).expect("a grid");
    let light = Light { sun: sun(0.0, 0.0, 0.0), direct_normal: 0.0, sky: &|_| 2.0 };
    let values = irradiance(&grid, &light, 32, &flat()).expect("irradiance");
    for (value, view) in values.iter().zip(sky_view(&grid)) {
        assert!((f64::from(*value) - 2.0 * PI * f64::from(view)).abs() < 1e-3, "{value} {view}");
    }
}

/// The overcast sky of Moon and Spencer, L = (1 + 2 sin e)/3, on a horizontal plane: 7π/9; with a band of a quarter of the
/// azimuths alone: a quarter.
#[test]
fn other_skies_have_their_irradiance() {
    let grid = plane(9, 1.0, 0.0, 0.0).expect("a grid");
    let value = |sky: &(dyn Fn(DVec3) -> f64 + Sync)| {
        let light = Light { sun: sun(0.0, 0.0, 0.0), direct_normal: 0.0, sky };
        f64::from(irradiance(&grid, &light, 16, &flat()).expect("irradiance")[40])
    };
    let overcast = |d: DVec3| (1.0 + 2.0 * d.z) / 3.0;
    assert!((value(&overcast) - 7.0 * PI / 9.0).abs() < 1e-4);
    let quarter = |d: DVec3| if d.x > 0.0 && d.y > 0.0 { overcast(d) } else { 0.0 };
    assert!((value(&quarter) - 7.0 * PI / 36.0).abs() < 1e-4);
}

#[test]
fn bad_light_is_refused() {
    let grid = plane(9, 1.0, 0.0, 0.0).expect("a grid");
    let refusal = |direct_normal: f64, elevation: f64, sky: f64| {
        let light = Light { sun: sun(0.0, elevation, 0.0), direct_normal, sky: &move |_| sky };
        irradiance(&grid, &light, 16, &flat()).expect_err("refused").to_string()
    };
    assert!(refusal(-1.0, 0.1, 1.0).contains("`direct_normal` -1"));
    assert!(refusal(1.0, f64::NAN, 1.0).contains("`elevation`"));
    assert!(refusal(1.0, 0.1, -2.0).contains("radiance -2"));
    assert!(refusal(1.0, 0.1, f64::NAN).contains("radiance NaN"));
    assert!(sky_view_factor(&grid, 3, &flat()).expect_err("refused").to_string().contains("`azimuths` 3"));
    let tiny = SweepOptions { earth_radius: Some(1.0) };
    assert!(sky_view_factor(&grid, 8, &tiny).expect_err("refused").to_string().contains("`earth_radius`"));
}
