//! Lamp shades: light that white walls around a lamp send to each other many times.

use super::*;

/// A deep white shade, open below, with a lamp below its closed top, in a black room.
fn shade() -> Scene {
    let mut pieces = Pieces::empty();
    let at = DVec3::new(2.94, 1.94, 2.3);
    let (x, y, z) = (0.12 * DVec3::X, 0.12 * DVec3::Y, 0.31 * DVec3::Z);
    pieces.grey("room", 0.0).room(DVec3::ZERO, DVec3::new(6.0, 4.0, 3.0));
    pieces.grey("shade", 0.8);
    for (at, a, b) in [(at, x, z), (at, y, z), (at + x, y, z), (at + y, x, z), (at + z, x, y)] {
        pieces.rectangle(at, a, b);
    }
    pieces.glowing("lamp", 1000.0).polygon(&facing_down([2.95, 3.05], [1.95, 2.05], 2.6));
    pieces.scene()
}

/// Elements that only points need have few rays. The light at the points is that of 8 million paths, which end on them within 0.04 %; the lamp is hidden from
/// them, and all of it has been reflected.
#[test]
fn few_rays_leave_no_more_light_in_a_shade_than_there_is() {
    let scene = shade();
    let beside = [
        (1.4, 0.5),
        (1.4, -0.5),
        (-1.4, 0.5),
        (-1.4, -0.5),
        (0.5, 1.4),
        (0.5, -1.4),
        (-0.5, 1.4),
        (-0.5, -1.4),
    ];
    let point = |(x, y)| Point { position: DVec3::new(3.0 + x, 2.0 + y, 0.0), normal: DVec3::Z };
    let points = beside.map(point);
    let (seeds, mut ratio) = (12, 0.0);
    for seed in 1..=seeds {
        let options = Options { elements: false, seed, audit: 0, ..Options::default() };
        let Outcome { irradiance, record, .. } = solved(&scene, &points, &options);
        ratio += irradiance.iter().map(|e| e[0]).sum::<f64>() / 8.0 / 0.1171 / f64::from(seeds as u32);
        assert!(record.ledger.created.abs() < 1e-3 * record.ledger.emitted, "{seed}: {:?}", record.ledger);
    }
    assert!((ratio - 1.0).abs() < 0.04, "{ratio}");
}
