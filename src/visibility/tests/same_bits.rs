//! Independence of answers from neighbouring bundles, instruction set, number of threads, and earlier queries.

use super::*;
use crate::scene::testing::{direction, in_cube};
use crate::simd::Isa;
use rayon::prelude::*;

const ISAS: [Isa; 3] = [Isa::Portable, Isa::Avx2, Isa::Avx512];

/// Bundles queried together share the upper part of the traversal: exact answers are bit-identical, aggregated ones
/// differ at most by the direction for which optics are interpolated.
#[test]
fn groups_answer_as_their_bundles_do() {
    for name in ["forest", "cubes", "desk-room", "bookshelf"] {
        let stage = Stage::generated(name);
        let engine = stage.engine(LeafMode::Exact);
        let emitter = &stage.scene.emitters[0].triangles;
        let ends = end_rule(&stage.scene);
        let mut random = Pcg64Mcg::new(12);
        let surfaces = stage.surfaces();
        let mut packets = Vec::new();
        for _ in 0..20 {
            // Several points around one point of a surface.
            let middle = stage.point(&mut random, &surfaces);
            for _ in 0..25 {
                let from = middle + 0.02 * stage.size() * direction(&mut random);
                let mut packet = Packet::EMPTY;
                (0..16).for_each(|i| packet.set(i, from, stage.point(&mut random, emitter), ends));
                packets.push(packet);
            }
        }
        let width = stage.scene.emitters[0].min_width;
        for (e, s) in [(1e-6 * width, 1e-6 * stage.size()), (width, 0.02 * stage.size())] {
            let bundles: Vec<Bundle> = packets.iter().map(|p| Bundle::of_packet(p, e)).collect();
            let mut workspace = Workspace::default();
            let mut together = Vec::new();
            engine.answers(&bundles, s, &mut workspace, |answer| together.push(answer));
            assert_eq!(together.len(), bundles.len());
            let (mut sum, mut nodes) = (0.0, [0, 0]);
            for (bundle, shared) in bundles.iter().zip(&together) {
                let alone = engine.answer(*bundle, s, &mut workspace);
                nodes = [nodes[0] + alone.cost.nodes, nodes[1] + shared.cost.nodes];
                if alone.cost.aggregated + shared.cost.aggregated == 0 {
                    assert_eq!(alone.transmittance, shared.transmittance, "{name}, e {e}, s {s}");
                }
                sum += f64::from(shared.transmittance - alone.transmittance);
            }
            let mean = sum / bundles.len() as f64;
            assert!(mean.abs() < 0.01, "{name}, e {e}, s {s}: groups answer {mean:+.4} more");
            assert!(nodes[1] < nodes[0] / 2, "{name}, e {e}, s {s}: nothing is shared: {nodes:?}");
        }
    }
}

#[test]
fn instruction_sets_threads_and_history_change_no_bit() {
    for name in ["forest", "desk-room"] {
        let stage = Stage::generated(name);
        let packets = stage.bundles(8, 300, 16);
        let e = 0.3 * stage.scene.emitters[0].min_width;
        for leaf in [LeafMode::Exact, LeafMode::Average] {
            for s in stage.sizes() {
                let ask = |engine: &MultiResolution, packet: &Packet, workspace: &mut Workspace| {
                    let bundle = Bundle::of_packet(packet, e);
                    let answer = engine.answer(bundle, s, workspace);
                    let bits = [answer.transmittance, answer.lo, answer.hi].map(f32::to_bits);
                    (engine.transmittances(packet, e, s, workspace).map(f32::to_bits), bits, answer.cost)
                };
                let plain = stage.engine(leaf).with_isa(Isa::Portable);
                let reference: Vec<_> =
                    packets.iter().map(|p| ask(&plain, p, &mut Workspace::default())).collect();
                for isa in ISAS.into_iter().filter(|isa| isa.available()) {
                    let engine = stage.engine(leaf).with_isa(isa);
                    assert_eq!(engine.isa(), isa);
                    // In reverse order with one workspace: earlier queries must have no effect.
                    let mut kept = Workspace::default();
                    let mut again: Vec<_> =
                        packets.iter().rev().map(|p| ask(&engine, p, &mut kept)).collect();
                    again.reverse();
                    assert!(again == reference, "{name}, {leaf:?}, s {s}: {} differs", isa.name());
                }
                let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
                let engine = stage.engine(leaf);
                let shared: Vec<_> = pool.install(|| {
                    packets.par_iter().map_init(Workspace::default, |w, p| ask(&engine, p, w)).collect()
                });
                assert!(shared == reference, "{name}, {leaf:?}, s {s}: two threads differ");
            }
        }
    }
}

#[test]
fn bundles_with_sizes_of_their_own_answer_as_they_do_alone() {
    let stage = Stage::generated("forest");
    let engine = stage.engine(LeafMode::Average);
    let mut random = Pcg64Mcg::new(5);
    let (mut workspace, mut differ, mut fractions) = (Workspace::default(), 0.0, 0);
    let bounds = stage.scene.bounds;
    for _ in 0..20 {
        // Adjacent bundles, so that they share a frontier.
        let [a, b] = [0, 1].map(|_| bounds.min + in_cube(&mut random).as_vec3() * (bounds.max - bounds.min));
        let packets: Vec<Packet> = (0..12).map(|_| around(a, b, 0.3, &mut random)).collect();
        let sizes: Vec<f32> = (0..12).map(|k| 0.02 * 1.5f32.powi(k)).collect();
        let bundles: Vec<Bundle> = packets.iter().map(|p| Bundle::of_packet(p, 0.3)).collect();
        let mut together = Vec::new();
        engine.answers_lanes(&bundles, &sizes, &mut workspace, |k, answer, lanes| {
            assert_eq!(k, together.len());
            let mean = packets[k].lanes().map(|l| lanes[l]).sum::<f32>() / packets[k].len() as f32;
            assert!((mean - answer.transmittance).abs() < 1e-5, "{mean} {answer:?}");
            together.push(*lanes);
        });
        for (k, lanes) in together.iter().enumerate() {
            let (_, alone) = engine.answer_lanes(&packets[k], 0.3, sizes[k], &mut workspace);
            for (x, y) in lanes.iter().zip(alone) {
                differ += x - y;
                fractions += usize::from(*x > 0.0 && *x < 1.0);
            }
        }
    }
    // As for groups, single aggregated answers may differ, but not the mean.
    let mean = differ / (20 * 12 * LANES) as f32;
    assert!(mean.abs() < 0.01 && fractions > 100, "{mean} {fractions}");
}

/// Segments between boxes around two points.
fn around(a: Vec3, b: Vec3, width: f32, random: &mut Pcg64Mcg) -> Packet {
    let ends = EndRule::new(1.0);
    let mut packet = Packet::EMPTY;
    for lane in 0..LANES {
        let [from, to] = [a, b].map(|p| p + width * (in_cube(random).as_vec3() - 0.5));
        packet.set(lane, from, to, ends);
    }
    packet
}
