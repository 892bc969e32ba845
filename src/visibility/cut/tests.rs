//! The cut against closed forms, brute force, and the umbra criterion.

use super::traverse::STACK;
use super::*;
use crate::ray::{Brute, EndRule, HitResult, LANES, Packet};
use crate::scene::testing::{Pieces, cloud, direction, in_cube, unit};
use glam::{DVec3, Vec3};
use rand_pcg::Pcg64Mcg;

/// A cloud of small squares in a box of 10 by 10 by 2, with a light far above.
fn slab(count: usize, edge: f64) -> Scene {
    let mut pieces = cloud(3, count, edge, DVec3::new(10.0, 10.0, 2.0), true);
    pieces.light(DVec3::new(5.0, 5.0, 40.0), DVec3::X * 8.0, DVec3::Y * 8.0);
    pieces.scene()
}

/// Leaves over a floor, with solid boxes between them.
fn yard() -> Scene {
    let mut pieces: Pieces = cloud(7, 4000, 0.08, DVec3::new(6.0, 6.0, 2.0), true);
    pieces.object("floor").quad(DVec3::new(3.0, 3.0, -0.1), DVec3::X * 30.0, DVec3::Y * 30.0);
    pieces.object("box").cuboid(DVec3::new(1.0, 1.0, 0.0), DVec3::new(2.0, 1.5, 1.5));
    pieces.light(DVec3::new(3.0, 3.0, 9.0), DVec3::X * 9.0, DVec3::Y * -9.0);
    pieces.scene()
}

/// Packets of sixteen segments from points in a box to points on a square above it.
fn packets(seed: u64, count: usize, low: Vec3, size: Vec3) -> Vec<Packet> {
    let mut random = Pcg64Mcg::new(seed.into());
    let packet = |_| {
        let from = low + in_cube(&mut random).as_vec3() * size;
        let mut packet = Packet::EMPTY;
        for lane in 0..LANES {
            let to =
                Vec3::new(9.0 * unit(&mut random) as f32 - 1.5, 9.0 * unit(&mut random) as f32 - 1.5, 8.9);
            packet.set(lane, from, to, EndRule::new(10.0));
        }
        packet
    };
    (0..count).map(packet).collect()
}

/// Transmittance of each lane with a width relative to an emitter of width `e`.
fn lanes(cut: &DistanceCut, packet: &Packet, e: f32, width: f32) -> ([f32; LANES], BundleSums) {
    let mode = Mode::unmeasured(width, 1.0);
    let tracing = if width > 0.0 { Tracing::Mode(&mode) } else { Tracing::Exact { shells: false } };
    let mut found = ([0.0; LANES], BundleSums::default());
    cut.each_packet(&[Bundle::of_packet(packet, e)], tracing, &mut |_, packet| {
        found = (*packet.lanes, BundleSums::counted(packet.trace, packet.segments));
    });
    found
}

/// Beer's law: segments through a slab of many small squares, averaged as a whole, transmit exp(-κ d) in the mean with κ = A / (2 V). Boxes
/// are larger than what their squares fill by half a square on each side, so that they transmit a little more.
#[test]
fn a_slab_of_small_squares_obeys_beers_law() {
    for (count, edge) in [(20_000, 0.05), (80_000, 0.05)] {
        let cut = DistanceCut::build(&slab(count, edge));
        let kappa = count as f64 * edge * edge / (2.0 * 200.0);
        let mut random = Pcg64Mcg::new(1);
        let (mut sum, mut wanted, mut n) = (0.0, 0.0, 0.0);
        for _ in 0..400 {
            let mut packet = Packet::EMPTY;
            for lane in 0..LANES {
                let along = direction(&mut random) + 2.5 * Vec3::Z;
                let middle = Vec3::new(3.0, 3.0, 1.0)
                    + 4.0 * in_cube(&mut random).as_vec3() * Vec3::new(1.0, 1.0, 0.0);
                let reach = 3.0 / along.z;
                packet.set(lane, middle - reach * along, middle + reach * along, EndRule::new(1.0));
                wanted += (-kappa * 2.0 * f64::from(along.length() / along.z)).exp();
            }
            let (values, sums) = lanes(&cut, &packet, 1e4, 1.0);
            assert!(sums.aggregated > 8 && sums.blocks == 0, "{sums:?}");
            (sum, n) = (sum + values.iter().map(|&v| f64::from(v)).sum::<f64>(), n + 16.0);
        }
        let (mean, wanted) = (sum / n, wanted / n);
        assert!((mean - wanted).abs() < 0.03, "{count} squares: {mean:.4} instead of {wanted:.4}");
    }
}

#[test]
fn nothing_is_averaged_without_a_size_and_answers_are_those_of_brute_force() {
    let scene = yard();
    let (cut, brute) = (DistanceCut::build(&scene), Brute::new(&scene.positions, &scene.triangles));
    let (mut blocked, mut clear) = (0, 0);
    for packet in packets(2, 60, Vec3::new(0.0, 0.0, -0.09), Vec3::new(6.0, 6.0, 2.0)) {
        let (values, sums) = lanes(&cut, &packet, 9.0, 0.0);
        assert_eq!(sums.aggregated, 0);
        for (lane, &value) in values.iter().enumerate() {
            let (from, to) = (packet.point(lane, 0.0), packet.point(lane, 1.0));
            match brute.verdict(from, to - from, packet.near[lane], packet.far[lane], 1e-5) {
                HitResult::Blocked => assert_eq!(value, 0.0, "missed {from} {to}"),
                HitResult::Clear => assert_eq!(value, 1.0, "blocked by nothing {from} {to}"),
                HitResult::Marginal => continue,
            }
            (blocked, clear) = (blocked + usize::from(value == 0.0), clear + 1);
        }
    }
    assert!(blocked > 100 && clear - blocked > 100, "{blocked} of {clear}");
}

/// Whether a segment passes a triangle within the length of its first edges.
fn is_near([a, b, c]: &[Vec3; 3], from: Vec3, to: Vec3) -> bool {
    let along = to - from;
    let part = ((*a - from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    a.distance(from + part * along) <= a.distance(*b).max(a.distance(*c))
}

/// The umbra criterion by brute force over the triangles of the scene, without the tree: a triangle that blocks a segment at a distance d
/// is part of a blocker at least as large as the smaller of its own longest side and the root of the area of its object. With the width w
/// that the segment stands for, relative to its length, that blocker casts an umbra on the receiver if it is not smaller than w d; then
/// the transmittance must be 0.
#[test]
fn the_cut_averages_nothing_that_casts_an_umbra() {
    let scene = yard();
    let cut = DistanceCut::build(&scene);
    let mut areas = vec![0.0f64; scene.triangles.len()];
    for (t, &object) in scene.triangle_component.iter().enumerate() {
        let [a, b, c] = scene.corners(t as u32);
        areas[object as usize] += crate::math::triangle_area(a, b, c);
    }
    let blocker = |t: usize| {
        let [a, b, c] = scene.corners(t as u32);
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        longest.min(areas[scene.triangle_component[t] as usize].sqrt() as f32)
    };
    let (mut tested, mut spared, mut averaged) = (0, 0, 0);
    for (k, packet) in packets(5, 60, Vec3::new(0.0, 0.0, -0.09), Vec3::new(6.0, 6.0, 2.5)).iter().enumerate()
    {
        let (e, width) = ([9.0, 3.0, 0.5][k % 3], [0.125, 0.5, 1.0][k / 3 % 3]);
        let (values, sums) = lanes(&cut, packet, e, width);
        averaged += sums.aggregated;
        for (lane, &value) in values.iter().enumerate() {
            let (from, to) = (packet.point(lane, 0.0), packet.point(lane, 1.0));
            let (near, far) = (packet.near[lane] + 1e-5, packet.far[lane] - 1e-5);
            for t in (0..scene.triangles.len()).filter(|&t| is_near(&scene.corners(t as u32), from, to)) {
                let one = Brute::new(&scene.corners(t as u32), &[[0, 1, 2]]);
                let blocks = |far: f32| one.verdict(from, to - from, near, far, 1e-5) == HitResult::Blocked;
                // The widest umbra that is not forbidden, with a margin for rounding.
                let nearest = (1.0 - 1e-3) * blocker(t) / (width * e);
                if blocks(far.min(nearest)) {
                    tested += 1;
                    assert_eq!(value, 0.0, "e {e}, width {width}: averaged what blocks {from} {to}");
                } else if value > 0.0 && blocks(far) {
                    spared += 1;
                }
            }
        }
    }
    assert!(tested > 100 && spared > 5 && averaged > 40, "{tested} {spared} {averaged}");
}

#[test]
fn threads_and_instruction_sets_change_no_bit() {
    let scene = yard();
    let build = |threads| crate::scene::testing::on_threads(threads, || DistanceCut::build(&scene));
    let all: Vec<DistanceCut> = [1, 2, 3].into_iter().map(build).collect();
    let answers = |cut: &DistanceCut, isa: Isa| -> Vec<[u32; LANES]> {
        let cut = DistanceCut { isa, ..cut.clone() };
        let bits = |packet: &Packet| lanes(&cut, packet, 9.0, 0.25).0.map(f32::to_bits);
        packets(9, 40, Vec3::ZERO, Vec3::new(6.0, 6.0, 2.0)).iter().map(bits).collect()
    };
    let reference = answers(&all[0], Isa::Portable);
    assert!(reference.iter().flatten().any(|&bits| bits != 0 && bits != 1f32.to_bits()));
    for cut in &all {
        assert_eq!(cut.bytes(), all[0].bytes());
        for isa in [Isa::Portable, Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| isa.available()) {
            assert_eq!(answers(cut, isa), reference, "{}", isa.name());
        }
    }
}

#[test]
fn a_triangle_takes_at_most_ninety_bytes() {
    for scene in [slab(20_000, 0.1), yard()] {
        let bytes = DistanceCut::build(&scene).bytes() as f64 / scene.triangles.len() as f64;
        assert!(bytes <= 90.0, "{bytes} bytes a triangle");
    }
}

/// Shells are left out where nothing can meet them, and only there: above and below the floor, through it, and under the light.
#[test]
fn shells_block_what_crosses_them() {
    let scene = yard();
    let cut = DistanceCut::build(&scene);
    assert!(cut.shells.len() >= 2, "floor and light");
    let one = |from: Vec3, to: Vec3| {
        let mut packet = Packet::EMPTY;
        packet.set(0, from, to, EndRule::new(10.0));
        let (values, sums) = lanes(&cut, &packet, 9.0, 0.0);
        (values[0], sums.blocks)
    };
    let beside = |z: f32| Vec3::new(12.0, 12.0, z);
    assert_eq!(one(beside(-1.0), beside(1.0)).0, 0.0, "through the floor");
    assert_eq!(one(beside(0.5), beside(1.0) + Vec3::X), (1.0, 0), "above the floor");
    assert_eq!(one(beside(-0.5), beside(-1.0) + Vec3::X), (1.0, 0), "below the floor");
    assert_eq!(one(Vec3::new(3.0, 3.0, 8.0), Vec3::new(3.1, 3.0, 10.0)).0, 0.0, "through the light");
}

/// Facets of a tessellated lamp lie before each other at grazing angles: they are tested, and shade nothing by an extinction.
#[test]
fn facets_of_lamps_are_never_averaged() {
    let mut pieces = Pieces::new();
    pieces.object("floor").quad(DVec3::new(0.0, 0.0, -0.1), DVec3::X * 30.0, DVec3::Y * 30.0);
    for k in 0..400 {
        let angle = f64::from(k) * 0.3;
        let at = DVec3::new(angle.cos(), angle.sin(), 5.0 + 0.01 * f64::from(k));
        pieces.light(at, DVec3::new(-angle.sin(), angle.cos(), 0.0) * 0.05, DVec3::Z * 0.02);
    }
    let scene = pieces.scene();
    let (cut, brute) = (DistanceCut::build(&scene), Brute::new(&scene.positions, &scene.triangles));
    for packet in packets(4, 40, Vec3::new(-3.0, -3.0, 0.0), Vec3::new(6.0, 6.0, 1.0)) {
        let (values, sums) = lanes(&cut, &packet, 50.0, 1.0);
        assert_eq!(sums.aggregated, 0);
        for (lane, &value) in values.iter().enumerate() {
            let (from, to) = (packet.point(lane, 0.0), packet.point(lane, 1.0));
            let verdict = brute.verdict(from, to - from, packet.near[lane], packet.far[lane], 1e-5);
            assert!(verdict == HitResult::Marginal || (value == 0.0) == (verdict == HitResult::Blocked));
        }
    }
}

/// Triangles whose centres all but coincide, in sizes of many orders: uneven splits end, and the stack holds.
#[test]
fn trees_are_no_deeper_than_the_stack() {
    let mut pieces = Pieces::new();
    pieces.object("nest");
    for k in 0..4000 {
        let size = 2f64.powf(-f64::from(k) / 40.0);
        pieces.quad(DVec3::splat(size), DVec3::X * size, DVec3::Y * size);
    }
    pieces.light(DVec3::new(0.0, 0.0, 9.0), DVec3::X, DVec3::Y * -1.0);
    let cut = DistanceCut::build(&pieces.scene());
    let (mut deepest, mut nodes) = (0, vec![(0u32, 1)]);
    while let Some((node, depth)) = nodes.pop() {
        deepest = deepest.max(depth);
        let node = &cut.nodes[node as usize];
        for lane in (0..LANES).filter(|lane| node.used >> lane & 1 == 1) {
            if node.child[lane] & layout::LEAF == 0 {
                nodes.push((node.child[lane], depth + 1));
            }
        }
    }
    assert!(15 * deepest < STACK, "{deepest} levels");
}

/// The axes around sixteen directions are those of each, and so are their weights.
#[test]
fn sixteen_directions_have_the_axes_of_each() {
    let mut random = Pcg64Mcg::new(11);
    for round in 0..200 {
        let mut packet = Packet::EMPTY;
        let mut directions = Vec::new();
        for lane in 0..LANES {
            let mut d = direction(&mut random);
            // Equal components and zeros too.
            d = if round % 3 == 0 { (2.0 * d).round() } else { d };
            d = if d == Vec3::ZERO { Vec3::X } else { d };
            packet.set(lane, Vec3::ZERO, 8.0 * d, EndRule::new(1.0));
            directions.push(d);
        }
        let kappa = layout::Extinctions(std::array::from_fn(|axis| {
            [crate::simd::half_nearest(
                [1.0, 3.0, 7.0, 0.5, 2.0, 11.0, 5.0, 13.0, 4.0, 6.0, 9.0, 8.0, 10.0][axis],
            ); LANES]
        }));
        for (lane, (found, d)) in traverse::extinctions(&packet, &kappa).iter().zip(directions).enumerate() {
            let value = |axis: usize| f32::from_bits(u32::from(kappa.0[axis][0]) << 16);
            let wanted = crate::optics::AxisMix::around(d).mix(value);
            assert!((found - wanted).abs() < 1e-5 * wanted, "lane {lane}, {d}: {found} instead of {wanted}");
        }
    }
}

/// Bundles of several packets are left to exact rays, after their first packet, in classes where a mode errs too much for their number of
/// segments; where it pays, and for single packets, the answers are those of the mode.
#[test]
fn bundles_are_left_where_a_mode_does_not_pay() {
    let cut = DistanceCut::build(&yard());
    let all = packets(9, 64, Vec3::new(0.0, 0.0, -0.05), Vec3::new(6.0, 6.0, 0.0));
    let of = |model: f32| {
        let fit = modes::Fit {
            factor: 1.0,
            exact: 1.0 / 16.0,
            spread: 1.0 / 32.0,
            single: 0.5,
            model,
            work: [40.0, 20.0],
            power: 1.0,
            part: 1.0,
        };
        Mode { width: 1.0, fits: [fit; modes::CLASSES] }
    };
    // Sixteen segments: 2 (1/16) / (1/32 + m). 64 segments: 2 (1/64) / (1/128 + m). The second is below 1 for m > 3/128.
    for (model, few, many) in [(0.0, true, true), (0.02, true, true), (0.03, true, false)] {
        let mode = of(model);
        assert_eq!([16.0, 64.0].map(|n| mode.fits[0].gain_of(n) > 1.0), [few, many], "{model}");
        for (packets, pays) in [(1, true), (4, many)] {
            let bundle = |packets| Bundle { packets, emitter_size: 9.0, emitter: &[] };
            let bundles: Vec<Bundle> = all.chunks(packets).map(bundle).collect();
            let mut wanted = Vec::new();
            cut.each_sum(&bundles, Tracing::Mode(&mode), |_, sums| wanted.push(sums));
            let mut at = wanted.iter();
            cut.answers_that_pay(&bundles, &mode, |answer, sums| {
                let wanted = at.next().expect("an answer a bundle");
                assert_eq!((answer.is_some(), !sums.left), (pays, pays));
                assert_eq!(sums.segments, if pays { wanted.segments } else { 16 });
                assert!(answer.is_none_or(|answer| answer.transmittance == wanted.answer().transmittance));
            });
            assert!(at.next().is_none());
        }
    }
}
