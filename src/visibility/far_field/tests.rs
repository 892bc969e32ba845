//! Probes against closed forms and brute force.

use super::*;
use crate::ray::LANES;
use crate::scene::testing::{Pieces, unit};
use crate::visibility::LeafMode;
use crate::visibility::tests::Stage;
use glam::{DVec3, Vec3};
use rand_pcg::Pcg64Mcg;

/// A floor, a square lamp of 4 by 4 at a height of 10 above its centre, and what is added.
fn scene(add: impl FnOnce(&mut Pieces)) -> Scene {
    let mut pieces = Pieces::new();
    pieces.object("floor").quad(DVec3::ZERO, DVec3::X * 40.0, DVec3::Y * 40.0);
    add(&mut pieces);
    pieces.light(DVec3::Z * 10.0, DVec3::X * 4.0, DVec3::Y * -4.0);
    pieces.scene()
}

fn engine(scene: &Scene) -> MultiResolution {
    let stage = Stage::apart(scene.clone(), &Default::default());
    stage.engine(LeafMode::Exact).with_cut(Some(Arc::new(DistanceCut::build(scene))))
}

fn samplers(scene: &Scene) -> Vec<EmitterSampler> {
    let magnitudes = scene.face_magnitudes();
    scene.emitters.iter().map(|emitter| EmitterSampler::new(scene, emitter, &magnitudes)).collect()
}

fn on_floor(x: f32, y: f32) -> Probe {
    Probe::new(Vec3::new(x, y, 0.0), Vec3::Z, 20.0)
}

/// A wall of height 3 at x = 2 is met by balls that reach it, by no others; the floor is met by none.
#[test]
fn a_ball_is_clear_up_to_the_nearest_wall() {
    let scene = scene(|p| {
        p.object("wall").quad(DVec3::new(2.0, 0.0, 1.5), DVec3::Y * 30.0, DVec3::Z * 3.0);
    });
    let (engine, samplers) = (engine(&scene), samplers(&scene));
    let field = FarField::new(&engine, &scene, &samplers, 16, 1).expect("a cut");
    for x in [-9.0, -3.0, 0.0, 1.9, 2.2, 5.0] {
        let distance = (x - 2.0f32).abs();
        for (part, clear) in [(0.3, true), (0.99, true), (1.01, false), (1.5, false)] {
            assert_eq!(on_floor(x, 1.0).is_empty_within(&field.cut, part * distance), clear, "{x} {part}");
        }
    }
}

/// A ball is clear only if no triangle blocks any segment inside it: no light leaks through what lies between a receiver and a probe.
#[test]
fn nothing_blocks_segments_in_clear_balls() {
    let scene = scene(|p| {
        let mut random = Pcg64Mcg::new(3);
        p.object("leaves");
        for _ in 0..300 {
            let at =
                DVec3::new(16.0 * unit(&mut random) - 8.0, 16.0 * unit(&mut random) - 8.0, unit(&mut random));
            p.quad(at, DVec3::new(0.2, 0.1, 0.1), DVec3::new(-0.1, 0.2, 0.05));
        }
    });
    let (engine, samplers) = (engine(&scene), samplers(&scene));
    let field = FarField::new(&engine, &scene, &samplers, 16, 1).expect("a cut");
    let mut random = Pcg64Mcg::new(5);
    let mut draw = move || unit(&mut random) as f32 - 0.5;
    let (mut clear, mut blocked, mut met) = (0, Vec::new(), 0);
    for _ in 0..2000 {
        let (probe, radius) = (on_floor(16.0 * draw(), 16.0 * draw()), 0.2 + draw().abs());
        let mut packet = Packet::EMPTY;
        for lane in 0..LANES {
            let inside = |v: Vec3| {
                probe.at + radius * 0.99 * v / v.length().max(1.0) * Vec3::new(1.0, 1.0, v.z.signum())
            };
            let [a, b] = [(); 2].map(|()| inside(Vec3::new(2.0 * draw(), 2.0 * draw(), 2.0 * draw())));
            packet.set_between(lane, a, b, [0.0, 1.0]);
        }
        let answer = engine.exact().answer(Bundle::of_packet(&packet, 0.0), &mut blocked);
        if probe.is_empty_within(&field.cut, radius) {
            assert_eq!(answer.transmittance, 1.0);
            clear += 1;
        }
        met += usize::from(answer.transmittance < 1.0);
    }
    assert!(clear > 200 && met > 200, "{clear} clear, {met} not");
}

/// A roof over the half x < 0 of the lamp's segments from the origin, half of each set; a closed room is dark, open floor is lit.
#[test]
fn probes_see_what_closed_forms_say() {
    let scene = scene(|p| {
        p.object("roof").quad(DVec3::new(-5.0, 0.0, 5.0), DVec3::X * 10.0, DVec3::Y * 10.0);
        p.object("room").cuboid(DVec3::new(12.0, -1.0, -0.5), DVec3::new(2.0, 2.0, 2.0));
    });
    let (engine, samplers) = (engine(&scene), samplers(&scene));
    let field = FarField::new(&engine, &scene, &samplers, 64, 1).expect("a cut");
    let mut scratch = FarFieldBuffers::default();
    let mut visible = |x: f32, sets| field.visible(&on_floor(x, 0.0), 0, sets, &mut scratch).transmittance;
    // Cells that the roof's edge crosses are counted by their one segment: eight of 64.
    for set in 0..20 {
        assert!((visible(0.0, set..set + 1) - 0.5).abs() < 4.0 / 64.0, "{set}");
        assert_eq!((visible(13.0, set..set + 1), visible(18.0, set..set + 1)), (0.0, 1.0));
    }
    assert!((visible(0.0, 0..16) - 0.5).abs() < 0.01);
}
