//! Maps of the sky.

use super::*;
use image::{Rgb, Rgb32FImage};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Writes a map with a value by azimuth and angle to the zenith, degrees.
fn write(folder: &Path, size: (u32, u32), value: impl Fn(f64, f64) -> [f32; 3]) -> PathBuf {
    let path = folder.join("sky.exr");
    let span = if size.0 == 2 * size.1 { 180.0 } else { 90.0 };
    let image = Rgb32FImage::from_fn(size.0, size.1, |x, y| {
        let azimuth = (f64::from(x) + 0.5) / f64::from(size.0) * 360.0 - 180.0;
        Rgb(value(azimuth, (f64::from(y) + 0.5) / f64::from(size.1) * span))
    });
    image.save(&path).expect("written");
    path
}

fn environment_of(options: &SkyOptions) -> Environment {
    options.environment(DVec3::Z).expect("an environment")
}

#[test]
fn maps_are_oriented() {
    let folder = tempfile::tempdir().expect("a folder");
    let smooth = |azimuth: f64, angle: f64| {
        let (a, z) = (azimuth.to_radians(), angle.to_radians());
        [2.0 + z.cos(), 2.0 + z.sin() * a.sin(), 2.0 + z.sin() * a.cos()].map(|v| v as f32)
    };
    let path = write(folder.path(), (512, 256), smooth);
    let mut options = SkyOptions::parse(&path.display().to_string()).expect("a map");
    let sky = environment_of(&options);
    for v in directions(500) {
        for (value, wanted) in sky.radiance(v).into_iter().zip([2.0 + v.z, 2.0 + v.x, 2.0 + v.y]) {
            assert_near(value, wanted, 1e-3);
        }
    }
    // The lower half of a map is light, too.
    assert_eq!(sky.patches().roots().len(), 2);
    assert_near(sky.irradiance(DVec3::NEG_Z)[1], 2.0 * PI, 1e-3);
    // ∫ (2 + x) x over the half sphere about x is 2 π + 2 π / 3.
    assert_near(sky.irradiance(DVec3::X)[1], 2.0 * PI + 2.0 * PI / 3.0, 1e-3);
    assert_near(integral_of_density(|v| sky.pdf(v)), 1.0, 1e-6);
    options.map_north = 90.0;
    assert_near(environment_of(&options).radiance(DVec3::X)[2], 3.0, 1e-3);
    options.ground = Some(Amount::Grey(0.5));
    let over_ground = environment_of(&options);
    let horizontal = over_ground.sky().expect("a sky").horizontal_irradiance()[0];
    assert_near(horizontal, 2.0 * PI + 2.0 * PI / 3.0, 1e-3);
    assert_near(over_ground.radiance(DVec3::NEG_Z)[0], 0.5 * horizontal / PI, 1e-9);
}

#[test]
fn hdr_maps_keep_their_light() {
    let folder = tempfile::tempdir().expect("a folder");
    let light = |azimuth: f64, angle: f64| {
        [1.0, 0.3, 0.1]
            .map(|part| (part * (2.0 + azimuth.to_radians().sin() * angle.to_radians().sin())) as f32)
    };
    let exr = write(folder.path(), (256, 128), light);
    let hdr = exr.with_extension("hdr");
    image::open(&exr).expect("read").into_rgb32f().save(&hdr).expect("written");
    let [exact, found] = [exr, hdr].map(|path| {
        let options = SkyOptions::parse(&path.display().to_string()).expect("a map");
        environment_of(&options).irradiance(DVec3::Z)
    });
    // Mantissas are cut off to 8 bits: without half a step the weakest channel loses 2 %.
    for (found, exact) in found.into_iter().zip(exact) {
        assert_near(found / exact, 1.0, 1e-3);
    }
}

#[test]
fn bright_texels_keep_their_light() {
    let folder = tempfile::tempdir().expect("a folder");
    // A map of the upper half with one texel that holds most of the light.
    let path = write(folder.path(), (1024, 256), |azimuth, angle| {
        if (45.0..45.3).contains(&azimuth) && (angle - 40.0).abs() < 0.18 { [1e5; 3] } else { [1.0; 3] }
    });
    let mut options = SkyOptions::parse(&path.display().to_string()).expect("a map");
    let map = Arc::new(SkyMap::read(&path, 0.0).expect("a map"));
    let sky = Sky::new(Shape::Uniform, Some(map), false, Level::Times(1.0)).expect("a sky");
    let whole = Environment::new(Frame::upright(DVec3::Z).expect("a frame"), Some(sky), Vec::new(), [0.0; 3]);
    let texel = (PI / 512.0f64).powi(2) * f64::sin(40f64.to_radians()) * f64::cos(40f64.to_radians());
    assert_near(whole.irradiance(DVec3::Z)[0], PI + 1e5 * texel, 0.02);
    let count = 300_000;
    let sum: f64 =
        square(count).map(|u| whole.sample(u)).map(|s| s.radiance[0] / s.pdf * s.direction.z).sum();
    assert_near(sum / count as f64, PI + 1e5 * texel, 0.01);
    // The texel is a sun with the same light on all planes, and the rest of the sky is even.
    let sky = environment_of(&options);
    let [sun] = sky.suns() else { panic!("{} suns", sky.suns().len()) };
    assert_near(sun.solid_angle(), texel / f64::cos(40f64.to_radians()), 1e-2);
    assert_near(sky.sky_irradiance(DVec3::Z)[0], PI, 0.01);
    let is_stated = |note: &String| {
        note.starts_with("diffuse horizontal irradiance 3.1") && note.contains("without the bright spots")
    };
    assert!(sky.notes.iter().any(is_stated), "{:?}", sky.notes);
    for v in directions(100) {
        assert_near(sky.irradiance(v)[0], whole.irradiance(v)[0], 0.02);
    }
    options.diffuse_horizontal = Some(Amount::Grey(50.0));
    assert_near(environment_of(&options).irradiance(DVec3::Z)[2], 50.0, 0.02);
}

#[test]
fn bright_spots_keep_their_shape() {
    let folder = tempfile::tempdir().expect("a folder");
    // The angle between a texel and a place, degrees.
    let apart = |azimuth: f64, angle: f64, of: [f64; 2]| {
        let unit = |azimuth: f64, angle: f64| {
            let (sin, cos) = angle.to_radians().sin_cos();
            DVec3::new(sin * azimuth.to_radians().sin(), sin * azimuth.to_radians().cos(), cos)
        };
        unit(azimuth, angle).angle_between(unit(of[0], of[1])).to_degrees()
    };
    let suns = |value: &dyn Fn(f64, f64) -> f32| {
        let path = write(folder.path(), (1024, 256), |azimuth, angle| [1.0 + value(azimuth, angle); 3]);
        let sky = environment_of(&SkyOptions::parse(&path.display().to_string()).expect("a map"));
        sky.suns().to_vec()
    };
    // A disc is one sun of its size, a strip is several along it, and what the rays of a point find is left in the sky.
    let disc = suns(&|azimuth, angle| if apart(azimuth, angle, [30.0, 40.0]) < 2.0 { 500.0 } else { 0.0 });
    let [disc] = disc[..] else { panic!("{disc:?}") };
    assert_near(disc.diameter.to_degrees(), 4.0, 0.1);
    assert_near(disc.irradiance[0], 500.0 * disc.solid_angle(), 0.02 * disc.irradiance[0]);
    let strip = suns(&|azimuth, angle| f32::from(azimuth.abs() < 6.0 && (angle - 45.0).abs() < 0.4) * 500.0);
    assert!((3..=8).contains(&strip.len()) && strip.iter().all(|sun| sun.diameter < 0.05), "{strip:?}");
    let wide = suns(&|azimuth, angle| if apart(azimuth, angle, [30.0, 40.0]) < 8.0 { 500.0 } else { 0.0 });
    assert!(wide.is_empty(), "{wide:?}");
    assert!(suns(&|azimuth, angle| (azimuth + angle) as f32 / 60.0 + 3.0).is_empty());
}

#[test]
fn maps_multiply_models() {
    let folder = tempfile::tempdir().expect("a folder");
    let path =
        write(folder.path(), (256, 128), |azimuth, _| if azimuth > 0.0 { [2.0, 1.0, 0.5] } else { [1.0; 3] });
    let mut options = SkyOptions::parse("perez:500,200").and_then(|o| o.with_sun("180,50")).expect("options");
    let plain = environment_of(&options);
    options.map = Some(path);
    let sky = environment_of(&options);
    let (east, west) = (DVec3::new(0.6, 0.0, 0.8), DVec3::new(-0.6, 0.0, 0.8));
    assert_near(sky.radiance(east)[0] / sky.radiance(west)[0], 2.0, 1e-6);
    assert_near(sky.radiance(east)[2] / sky.radiance(east)[1], 0.5, 1e-6);
    let up = DVec3::new(-0.28, 0.0, 0.96);
    assert_near(
        sky.radiance(west)[1] / sky.radiance(up)[1],
        plain.radiance(west)[1] / plain.radiance(up)[1],
        1e-6,
    );
    // Diffuse irradiance is that of the model, as luminance; the lower half is black.
    let rgb = sky.sky().expect("a sky").horizontal_irradiance();
    assert_near(0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2], 200.0, 1e-9);
    assert_eq!(sky.radiance(DVec3::NEG_Z), [0.0; 3]);
}

#[test]
fn bad_texels_are_repaired_and_counted_or_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let bad = |limit: f64| {
        move |azimuth: f64, angle: f64| match azimuth > 0.0 && azimuth < limit && angle < 1.0 {
            true => [f32::NAN, -1.0, f32::INFINITY],
            false => [3.0; 3],
        }
    };
    let path = write(folder.path(), (256, 128), bad(20.0));
    let options = SkyOptions::parse(&path.display().to_string()).expect("a map");
    let sky = environment_of(&options);
    assert!(sky.notes.iter().any(|n| n.contains("sky.exr: 14 texels")), "{:?}", sky.notes);
    assert_eq!(sky.radiance(DVec3::new(0.6, 0.0, 0.8)), [3.0; 3]);
    for (size, value, what) in [
        (
            (256, 128),
            Box::new(|a: f64, _: f64| [if a > 0.0 { f32::NAN } else { 1.0 }; 3])
                as Box<dyn Fn(f64, f64) -> [f32; 3]>,
            "16384 of 32768 texels are negative or not finite",
        ),
        ((256, 128), Box::new(|_, _| [0.0; 3]), "black"),
        ((200, 120), Box::new(|_, _| [1.0; 3]), "twice as wide as high"),
    ] {
        let path = write(folder.path(), size, value);
        let message = SkyOptions::parse(&path.display().to_string()).expect("a name").environment(DVec3::Z);
        let message = message.expect_err(what).to_string();
        assert!(
            message.contains("sky.exr: ") && message.contains(what) && !message.contains('\n'),
            "{message}"
        );
    }
    for name in ["nowhere.exr", "nowhere.hdr"] {
        assert!(matches!(SkyMap::read(&folder.path().join(name), 0.0), Err(crate::Error::Io { .. })));
    }
    let path = folder.path().join("picture.exr");
    std::fs::write(&path, b"no picture").expect("written");
    assert!(SkyMap::read(&path, 0.0).expect_err("no picture").to_string().contains("OpenEXR"));
}
