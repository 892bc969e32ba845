use super::*;

/// Largest relative error of the closed forms.
const TOLERANCE: f64 = 0.003;

fn check(name: &str, value: f32, expected: f64) {
    let error = f64::from(value) / expected - 1.0;
    assert!(error.abs() < TOLERANCE, "{name}: {value} instead of {expected}, error {error:.5}");
}

#[test]
fn slopes_have_their_closed_form_everywhere() {
    for inclination in [0.0f64, 0.2, 0.7, 1.2] {
        for azimuth in [0.0, 0.3, 1.0, 4.0] {
            let grid = plane(65, 10.0, inclination, azimuth).expect("a grid");
            for (i, value) in sky_view(&grid).into_iter().enumerate() {
                check(
                    &format!("slope {inclination} to {azimuth}, sample {i}"),
                    value,
                    (1.0 + inclination.cos()) / 2.0,
                );
            }
        }
    }
}

#[test]
fn valleys_have_their_closed_form() {
    for inclination in [0.3f64, 0.6, 0.9] {
        // The valley is 16 times as long as wide: the sky at its ends is seen within 4° of the horizon.
        let grid = valley(101, 1601, 2.0, inclination).expect("a grid");
        let values = sky_view(&grid);
        for column in [50usize, 49, 47, 37, 25, 10, 1] {
            let up = (50 - column) as f64;
            let elevation = ((50.0 - up) * inclination.tan() / (50.0 + up)).atan();
            let expected = match column {
                50 => inclination.cos(),
                _ => (1.0 + (inclination + elevation).cos()) / 2.0,
            };
            check(&format!("valley {inclination}, column {column}"), values[800 * 101 + column], expected);
        }
    }
}

#[test]
fn street_canyons_have_their_closed_form() {
    for height in [25.0f64, 100.0] {
        let grid = canyon(121, 2401, 1.0, 100.0, height).expect("a grid");
        // Near a wall the sky narrows to the directions of the street.
        let values = sky_view_factor(&grid, 64, &flat()).expect("sky view factors");
        for column in [60usize, 50, 35, 25, 15] {
            let x = column as f64 - 60.0;
            // Steeper than 10 : 1 more azimuths are needed.
            if height > 10.0 * (50.0 - x.abs()) {
                continue;
            }
            let expected = [50.0 - x, 50.0 + x].map(|d| (height / d).atan().cos()).iter().sum::<f64>() / 2.0;
            check(&format!("canyon {height}, column {column}"), values[1200 * 121 + column], expected);
        }
    }
}

/// The same street from west to east goes through the transposed grid.
#[test]
fn directions_are_alike() {
    let across = canyon(121, 601, 1.0, 60.0, 40.0).expect("a grid");
    let turned = across.transposed().expect("a grid");
    let (a, b) = (sky_view(&across), sky_view(&turned));
    for [c, r] in spread(&across, 500) {
        let (a, b) = (a[r * across.columns() + c], b[c * turned.columns() + r]);
        assert!((a - b).abs() < 1e-5, "{c} {r}: {a} {b}");
    }
}

#[test]
fn courtyards_have_their_closed_form() {
    // The wall's samples are up to a cell outside the circle, 1/400 of its radius or 1/200: the lower the wall, the less it matters.
    for (height, size, cell) in [(20.0f64, 423, 0.25), (50.0, 843, 0.125)] {
        let grid = courtyard(size, cell, 50.0, height).expect("a grid");
        let value = sky_view(&grid)[(size / 2) * (size + 1)];
        check(&format!("courtyard {height}"), value, 2500.0 / (2500.0 + height * height));
    }
}

#[test]
fn rough_terrain_agrees_with_exact_horizons() {
    for (roughness, bound) in [(0.5, 0.0015), (0.6, 0.003)] {
        let grid = fractal(400, 300, 10.0, 1500.0, roughness, 7).expect("a grid");
        let values = sky_view(&grid);
        let errors: Vec<f64> = spread(&grid, 200)
            .map(|[c, r]| f64::from(values[r * 400 + c]) - exact_sky_view(&grid, [c, r]))
            .collect();
        let mean = errors.iter().map(|e| e.abs()).sum::<f64>() / errors.len() as f64;
        assert!(mean < bound, "roughness {roughness}: mean error {mean}");
    }
}

#[test]
fn cells_need_not_be_square() {
    // A plane and a ridge whose samples are 4 times farther apart in one direction.
    let heights = |i: usize| ((i % 100) as f32 * 2.0).min(90.0);
    let grid = Grid::new(100, 40, [2.0, 8.0], (0..4000).map(heights).collect()).expect("a grid");
    let expected = (1.0 + std::f64::consts::FRAC_PI_4.cos()) / 2.0;
    check("slope of oblong cells", sky_view(&grid)[20 * 100 + 20], expected);
    assert!((sky_view(&grid)[20 * 100 + 80] - 1.0).abs() < 1e-6);
}

#[test]
fn sums_are_the_same_bits_on_any_number_of_threads() {
    let grid = fractal(333, 257, 5.0, 300.0, 0.55, 3).expect("a grid");
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| sky_view(&grid))
    };
    let bits = |values: Vec<f32>| values.into_iter().map(f32::to_bits).collect::<Vec<_>>();
    let one = bits(on(1));
    assert!(one == bits(on(2)) && one == bits(on(3)));
}

#[test]
fn holes_block_nothing_and_get_no_value() {
    let wall = |c: usize| if c == 20 { 30.0 } else { 0.0 };
    let heights = |hole: bool| {
        (0..41 * 41).map(move |i| if hole && i % 41 == 20 { f32::NAN } else { wall(i % 41) }).collect()
    };
    let solid = Grid::new(41, 41, [1.0; 2], heights(false)).expect("a grid");
    let open = Grid::new(41, 41, [1.0; 2], heights(true)).expect("a grid");
    assert_eq!(open.holes(), 41);
    let (solid, open) = (sky_view(&solid), sky_view(&open));
    for (i, value) in open.iter().enumerate() {
        match i % 41 {
            20 => assert!(value.is_nan()),
            _ => assert!((value - 1.0).abs() < 1e-6, "sample {i}: {value}"),
        }
    }
    assert!(solid[20 * 41 + 15] < 0.7 && solid.iter().all(|v| v.is_finite()));
}

#[test]
fn the_curved_earth_hides_what_is_far() {
    // A ridge of 2 km at the west end of a sea of 300 km.
    let heights = (0..301 * 21).map(|i| if i % 301 == 0 { 2000.0 } else { 0.0 }).collect();
    let grid = Grid::new(301, 21, [1000.0; 2], heights).expect("a grid");
    let curved = SweepOptions { earth_radius: Some(EARTH_RADIUS) };
    let towards_west =
        |options: &SweepOptions| horizon(&grid, 4, options).expect("horizons").elevations.remove(3);
    let (flat, curved) = (towards_west(&flat()), towards_west(&curved));
    for column in [1usize, 5, 12, 13, 40, 100, 150, 159, 161, 200, 300] {
        let d = column as f64 * 1000.0;
        let i = 10 * 301 + column;
        let expected = (2000.0 / d - d / (2.0 * EARTH_RADIUS)).max(0.0).atan();
        assert!((f64::from(flat[i]) - (2000.0 / d).atan()).abs() < 2e-5, "flat, {d} m: {}", flat[i]);
        assert!((f64::from(curved[i]) - expected).abs() < 2e-5, "{d} m: {} instead of {expected}", curved[i]);
    }
    // √(2 R h) = 159.6 km.
    assert!(curved[10 * 301 + 159] > 0.0 && curved[10 * 301 + 160] == 0.0);
}

#[test]
fn a_curved_sea_sees_the_whole_sky() {
    let grid = Grid::new(200, 200, [2000.0; 2], vec![5.0; 40_000]).expect("a grid");
    let values =
        sky_view_factor(&grid, 16, &SweepOptions { earth_radius: Some(EARTH_RADIUS) }).expect("values");
    assert!(values.iter().all(|v| (v - 1.0).abs() < 1e-6));
}

/// The horizon of a slope is the slope itself, however long cells are.
#[test]
fn slopes_of_long_cells_have_their_horizon() {
    for cell in [[1.0, 50.0], [50.0, 1.0], [10.0, 25.0]] {
        let height = |k: usize| 0.5 * cell[0] * (k % 101) as f64 + 0.3 * cell[1] * (k / 101) as f64;
        let grid =
            Grid::new(101, 101, cell, (0..101 * 101).map(|k| height(k) as f32).collect()).expect("a grid");
        let found = horizon(&grid, 64, &flat()).expect("horizons");
        for (azimuth, band) in found.azimuths.iter().zip(&found.elevations) {
            // Rows lead to the south.
            let wanted = (0.5 * azimuth.sin() - 0.3 * azimuth.cos()).max(0.0).atan().to_degrees();
            let value = f64::from(band[50 * 101 + 50].to_degrees());
            assert!((value - wanted).abs() < 0.3, "{cell:?}, azimuth {azimuth}: {value} instead of {wanted}");
        }
    }
}
