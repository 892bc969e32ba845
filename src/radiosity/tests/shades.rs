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
    let (seeds, mut ratio) = (6, 0.0);
    for seed in 1..=seeds {
        let options = Options { elements: false, seed, audit: 0, ..Options::default() };
        let Outcome { irradiance, record, .. } = solved(&scene, &points, &options);
        ratio += irradiance.iter().map(|e| e[0]).sum::<f64>() / 8.0 / 0.1171 / f64::from(seeds as u32);
        assert!(record.ledger.created.abs() < 1e-3 * record.ledger.emitted, "{seed}: {:?}", record.ledger);
    }
    assert!((ratio - 1.0).abs() < 0.04, "{ratio}");
}

/// A lamp two centimetres below the ceiling, facing it: most rays of elements miss the bright spot, which sends nearly all light of the room. Without shadow
/// rays to it the elements of the middle of the floor deviate by half of their mean and more.
#[test]
fn elements_have_the_light_of_a_bright_spot() {
    let mut pieces = Pieces::empty();
    pieces.grey("room", 0.6).room(DVec3::ZERO, DVec3::new(4.0, 6.0, 3.0));
    pieces.glowing("lamp", 1000.0).polygon(&facing_up([1.8, 2.2], [2.8, 3.2], 2.98));
    let options = Options { error: 0.1, audit: 0, ..Options::default() };
    let Outcome { mesh, record, .. } = solved(&pieces.scene(), &[], &options);
    let centre = |e: &Element| e.corners.map(|v| mesh.vertices[v as usize].as_dvec3() + mesh.origin);
    let in_middle = |e: &&Element| {
        centre(e).iter().all(|p| p.z == 0.0 && (p.x - 2.0).abs() < 0.7 && (p.y - 3.0).abs() < 0.7)
    };
    let sum = |of: &dyn Fn(f64) -> f64| -> f64 {
        mesh.elements.iter().filter(in_middle).map(|e| e.area * of(e.irradiance[0])).sum()
    };
    let (area, light, squares) = (sum(&|_| 1.0), sum(&|e| e), sum(&|e| e * e));
    let deviation = (squares * area / (light * light) - 1.0).sqrt();
    assert!(area > 1.0 && deviation < 0.4, "{area} {deviation}");
    assert!(record.ledger.created.abs() < 5e-3 * record.ledger.emitted, "{:?}", record.ledger);
}
