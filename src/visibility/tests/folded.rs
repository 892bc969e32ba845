//! Folding: bundles of many packets trace means of adjacent segments through the clusters.

use super::*;
use crate::ray::gather_neighbours;
use crate::simd::Isa;

/// The same segments in an order in which adjacent lanes end far apart are not folded: the answers agree in the mean,
/// and nearly each. They are also bit-identical on every instruction set.
#[test]
fn neighbours_pass_as_one() {
    let stage = Stage::generated("forest");
    let engine = stage.engine(LeafMode::Exact);
    let others = [Isa::Avx2, Isa::Portable].map(|isa| stage.engine(LeafMode::Exact).with_isa(isa));
    let ends = end_rule(&stage.scene);
    let emitter = &stage.scene.emitters[0];
    let surfaces = stage.surfaces();
    let mut random = Pcg64Mcg::new(41);
    let mut workspace = Workspace::default();
    let s = 0.02 * stage.size();
    // Folded by two, then by four: number of packets, and allowed difference.
    for (packets, each) in [(4, 0.01), (16, 0.005)] {
        let n = packets * LANES;
        let (mut squares, mut sum, mut apart, mut count) = (0.0f64, 0.0f64, 0, 0);
        for _ in 0..400 {
            let from = stage.point(&mut random, &surfaces);
            let mut to: Vec<(Vec3, EndRule)> =
                (0..n).map(|_| (stage.point(&mut random, &emitter.triangles), ends)).collect();
            gather_neighbours(&mut to);
            let to: Vec<Vec3> = to.into_iter().map(|(p, _)| p).collect();
            let mut ask = |to: &dyn Fn(usize) -> Vec3| {
                let mut bundle = vec![Packet::EMPTY; packets];
                (0..n).for_each(|i| bundle[i / LANES].set(i % LANES, from, to(i), ends));
                let bundle_query = Bundle { packets: &bundle, emitter_size: emitter.min_width, emitter: &[] };
                let answer = engine.answer(bundle_query, s, &mut workspace);
                let sums = workspace.sums().to_vec();
                for other in &others {
                    let again = other.answer(bundle_query, s, &mut workspace);
                    let bits = |a: Answer| [a.transmittance, a.lo, a.hi].map(f32::to_bits);
                    assert_eq!((bits(again), again.cost), (bits(answer), answer.cost));
                    assert_eq!(workspace.sums(), sums);
                }
                // The sums of the packets agree with the bundle's answer.
                let whole: f32 = sums.iter().sum::<f32>() / n as f32;
                let silent = answer.cost.handed_over > 0 || answer.method == Method::Clear;
                assert!(silent || (whole - answer.transmittance).abs() < 1e-5, "{whole}: {answer:?}");
                answer
            };
            let near = ask(&|i| to[i]);
            let far = ask(&|i| to[i * (n / 2 - 3) % n]);
            assert!(near.lo <= near.transmittance && near.transmittance <= near.hi);
            if near.cost.aggregated > 0 && near.cost.handed_over + far.cost.handed_over == 0 {
                let difference = f64::from(near.transmittance - far.transmittance);
                (squares, sum) = (squares + difference * difference, sum + difference);
                apart += usize::from(difference.abs() > 1e-6);
                count += 1;
            }
        }
        let (rms, bias) = ((squares / f64::from(count)).sqrt(), sum / f64::from(count));
        assert!(count > 100 && apart > count as usize / 4, "{apart} of {count} differ: none is folded");
        assert!(rms < each && bias.abs() < 0.25 * each, "{packets} packets: {rms}, {bias}");
    }
}
