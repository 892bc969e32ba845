//! Patches, discs and samples.

use super::*;
use crate::sky::cosine::Extent;

/// Cosine-weighted solid angle by midpoints.
fn brute(extent: &Extent, normal: DVec3, steps: usize) -> f64 {
    let part = |k: usize| (k as f64 + 0.5) / steps as f64;
    let sum: f64 =
        (0..steps * steps).map(|k| extent.at(part(k / steps), part(k % steps)).dot(normal).max(0.0)).sum();
    sum / (steps * steps) as f64 * extent.solid_angle()
}

#[test]
fn clipped_patches_agree_with_brute_force() {
    let extents = [
        Extent { z: [0.0, 1.0], v: [0.0, TAU] },
        Extent { z: [-1.0, 0.0], v: [0.0, TAU] },
        Extent { z: [0.0, 1.0], v: [0.0, PI / 2.0] },
        Extent { z: [0.5, 0.75], v: [PI / 2.0, 3.0 * PI / 4.0] },
        Extent { z: [0.0, 0.25], v: [5.0, 6.2] },
        Extent { z: [-0.75, -0.5], v: [1.0, 4.5] },
        Extent { z: [0.9, 1.0], v: [4.0, 4.7] },
        Extent { z: [0.3, 0.31], v: [6.1, TAU] },
    ];
    // Axes and diagonals make the receiver's horizon coincide with edges and corners.
    let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
    let diagonals = [
        DVec3::new(1.0, 1.0, 0.0),
        DVec3::new(1.0, 0.0, 1.0),
        DVec3::new(-1.0, 1.0, 1e-9),
        DVec3::new(1e-12, 0.0, 1.0),
    ];
    let normals: Vec<DVec3> =
        axes.into_iter().chain(diagonals.map(DVec3::normalize)).chain(directions(150)).collect();
    for extent in &extents {
        for normal in &normals {
            let (exact, wanted) = (extent.projected(*normal), brute(extent, *normal, 200));
            // The midpoint rule is off by about a step along the horizon.
            assert!(
                (exact - wanted).abs() < 8e-5 * extent.solid_angle() + 1e-8,
                "{extent:?} {normal}: {exact}, not {wanted}"
            );
        }
    }
}

#[test]
fn patches_add_up() {
    let mut options = SkyOptions::parse("perez:700,100").and_then(|o| o.with_sun("140,40")).expect("options");
    options.ground = Some(Amount::Grey(0.3));
    let sky = options.environment(DVec3::Y).expect("a sky");
    let patches = sky.patches();
    assert_eq!(patches.roots().len(), 2);
    let leaves: Vec<u32> =
        (0..patches.all().len() as u32).filter(|k| patches.children(*k).is_empty()).collect();
    let upper: f64 = leaves
        .iter()
        .map(|k| patches.patch(*k))
        .filter(|p| p.extent.z[0] >= 0.0)
        .map(|p| p.solid_angle)
        .sum();
    let all: f64 = leaves.iter().map(|k| patches.patch(*k).solid_angle).sum();
    assert_near(upper, TAU, 1e-12);
    assert_near(all, 2.0 * TAU, 1e-12);
    for k in 0..patches.all().len() as u32 {
        let (patch, children) = (patches.patch(k), patches.children(k));
        if children.is_empty() {
            continue;
        }
        let (mut moment, mut mean) = (DVec3::ZERO, 0.0);
        for child in children.map(|k| patches.patch(k)) {
            assert_near(child.solid_angle, patch.solid_angle / 4.0, 1e-9);
            moment += child.moment;
            mean += child.mean[0] / 4.0;
            assert!(patch.min[0] <= child.min[0] && child.max[0] <= patch.max[0]);
            assert!(child.min[0] <= child.mean[0] && child.mean[0] <= child.max[0] + 1e-12);
        }
        assert!(moment.distance(patch.moment) < 1e-12 && (mean - patch.mean[0]).abs() < 1e-12 * mean);
    }
}

/// Normals whose horizons go along edges and through corners of patches, as numbers of 32 and 64 bits.
fn aligned_normals() -> Vec<DVec3> {
    let heights = [0.0, 1e-8, -1e-8, 0.25, -0.5, 0.5f64.sqrt()];
    let normals = (0..16).flat_map(|k| heights.map(|z| frame::spherical(z, TAU * f64::from(k) / 16.0)));
    normals.flat_map(|n| [n, n.as_vec3().as_dvec3()]).collect()
}

#[test]
fn clipped_patches_are_the_sum_of_their_parts() {
    let mut options = SkyOptions::parse("uniform").expect("options");
    options.ground = Some(Amount::Grey(0.3));
    let sky = options.environment(DVec3::Z).expect("a sky");
    let patches = sky.patches();
    for normal in aligned_normals().into_iter().chain(directions(60)) {
        // Patches of five levels, clipped also where they need not be.
        for k in 0..700 {
            let clipped = |k: u32| patches.patch(k).extent.projected(normal);
            let own = clipped(k);
            assert!(
                (patches.projected(k, normal) - own).abs() < 1e-6,
                "{normal} {:?}",
                patches.patch(k).extent
            );
            let children = patches.children(k);
            let sum: f64 = children.clone().map(clipped).sum();
            assert!(
                children.is_empty() || (sum - own).abs() < 1e-6,
                "{normal} {:?}",
                patches.patch(k).extent
            );
        }
    }
}

#[test]
fn patches_are_compact_and_within_their_cones() {
    let sky = environment("cie:12,100", "200,30");
    let patches = sky.patches();
    for patch in patches.all() {
        for k in 0..36 {
            let local = patch.extent.at(f64::from(k / 6) / 5.0, f64::from(k % 6) / 5.0);
            let angle = 2.0 * (0.5 * sky.frame().world(local).distance(patch.axis)).min(1.0).asin();
            assert!(angle <= patch.half_angle + 1e-9, "{patch:?}: {angle}");
        }
        // A square of the same solid angle has the half angle 0.71 sqrt(Ω).
        assert!(patch.half_angle < 1.45 * patch.solid_angle.sqrt(), "{patch:?}");
    }
    for v in directions(3000) {
        let Some(k) = patches.find(v) else {
            assert!(v.z <= 0.0);
            continue;
        };
        let (patch, value) = (patches.patch(k), sky.radiance(v)[0]);
        assert!(patch.axis.dot(v) >= patch.half_angle.cos() - 1e-9);
        // Bounds are by samples: a corner that was not sampled differs by less than a tenth of the range.
        let slack = 0.1 * (patch.max[0] - patch.min[0]) + 1e-9;
        assert!(value >= patch.min[0] - slack && value <= patch.max[0] + slack, "{patch:?} {value}");
    }
}

#[test]
fn densities_integrate_to_one_and_estimates_are_unbiased() {
    let mut options = SkyOptions::parse("perez:800,80").and_then(|o| o.with_sun("220,35")).expect("options");
    for ground in [None, Some(Amount::Grey(0.25))] {
        options.ground = ground;
        let sky = options.environment(DVec3::Z).expect("a sky");
        assert_near(integral_of_density(|v| sky.pdf(v)), 1.0, 1e-6);
        let normal = DVec3::new(0.3, -0.8, 0.52).normalize();
        let wanted = sky.sky_irradiance(normal)[0];
        let wanted_sphere = integral(1024, -1.0, |v| sky.radiance(v)[0]);
        let count = 20_000;
        let (mut sum, mut squares, mut sphere) = (0.0, 0.0, 0.0);
        for u in square(count) {
            let sample = sky.sample(u);
            assert!((sample.direction.length() - 1.0).abs() < 1e-12);
            assert_near(sample.pdf, sky.pdf(sample.direction), 1e-9);
            assert_eq!(sample.radiance, sky.radiance(sample.direction));
            let weight = sample.radiance[0] / sample.pdf;
            sum += weight * sample.direction.dot(normal).max(0.0) / count as f64;
            sphere += weight / count as f64;
            squares += weight * weight / count as f64;
        }
        assert_near(sum, wanted, 2e-3);
        assert_near(sphere, wanted_sphere, 5e-4);
        // The density is nearly proportional to radiance.
        let spread = (squares - sphere * sphere).max(0.0).sqrt() / sphere;
        assert!(spread < 0.02, "relative standard deviation {spread}");
    }
}

#[test]
fn samples_reach_both_ends_of_the_square() {
    let sky = environment("overcast", "none");
    for u in [[0.0, 0.0], [0.0, 1.0f64.next_down()], [1.0f64.next_down(), 0.0], [1.0f64.next_down(); 2]] {
        let sample = sky.sample(u);
        assert!(sample.direction.z > 0.0 && sample.pdf > 0.0 && sample.radiance[0] > 0.0, "{sample:?}");
    }
    // A sun alone: directions are uniform and dark.
    let dark = environment("none", "180,45:500");
    let sample = dark.sample([0.3, 0.6]);
    assert_eq!(sample.radiance, [0.0; 3]);
    assert_near(sample.pdf, 1.0 / TAU, 1e-9);
}

#[test]
fn the_disc_has_the_irradiance_of_the_sun() {
    let direction = DVec3::new(0.3, 0.4, 0.866).normalize();
    for diameter in [0.533f64, 20.0] {
        let sun = Sun { direction, diameter: diameter.to_radians(), irradiance: [800.0, 400.0, 0.0] };
        let (mut facing, mut outside) = (0.0, 0);
        let count = 4000;
        for u in square(count) {
            let v = sun.sample(u);
            facing += sun.radiance()[0] * v.dot(direction) * sun.solid_angle() / count as f64;
            outside += usize::from(!sun.contains(v));
        }
        assert_near(facing, 800.0, 1e-5);
        // Rounding at the edge.
        assert!(outside <= 2, "{outside}");
        assert!(!sun.contains(frame::spherical(direction.z, 0.0)));
        assert_near(sun.irradiance_on(direction)[1], 400.0, 1e-12);
        // The receiver's horizon cuts the disc.
        for part in [-1.5, -0.9, -0.4, 0.0, 0.3, 0.8, 1.2] {
            let (x, _) = direction.any_orthonormal_pair();
            let up = PI / 2.0 - part * 0.5 * sun.diameter;
            let normal = up.cos() * direction + up.sin() * x;
            let steps = 700;
            let at = |k: usize| (k as f64 + 0.5) / steps as f64;
            let seen =
                (0..steps * steps).map(|k| sun.sample([at(k / steps), at(k % steps)]).dot(normal).max(0.0));
            let wanted = seen.sum::<f64>() / (steps * steps) as f64 * sun.solid_angle() * sun.radiance()[0];
            let found = sun.irradiance_on(normal)[0];
            assert!((found - wanted).abs() < 5e-4 * wanted + 1e-5, "{part}: {found}, not {wanted}");
        }
    }
    assert_near(Sun::new(direction, [1.0; 3]).solid_angle(), 6.796e-5, 1e-3);
}
