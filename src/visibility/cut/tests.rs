//! The cut against closed forms, brute force, and the umbra criterion.

use super::layout::{LEAF, NEVER};
use super::*;
use crate::math::Aabb;
use crate::ray::{Brute, EndRule, Verdict};
use crate::scene::testing::{Pieces, cloud, direction, in_cube, unit};
use crate::visibility::reference::umbra;
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

/// Transmittance of each lane.
fn lanes(cut: &Cut, packet: &Packet, e: f32, s: Option<f32>) -> ([f32; LANES], Sums) {
    let bundle = Bundle::of_packet(packet, e);
    let mut found = ([0.0; LANES], Sums::default());
    cut.each_packet(&[bundle], s, |sums, depths, open| {
        let lane = |lane: usize| if open >> lane & 1 == 1 { (-cut.factor * depths[lane]).exp() } else { 0.0 };
        found = (std::array::from_fn(lane), sums);
    });
    found
}

/// Beer's law: segments through a slab of many small squares, averaged as a whole, transmit exp(-κ d) in the mean with κ = A / (2 V). Boxes
/// are larger than what their squares fill by half a square on each side, so that they transmit a little more.
#[test]
fn a_slab_of_small_squares_obeys_beers_law() {
    for (count, edge) in [(20_000, 0.05), (40_000, 0.05), (80_000, 0.05)] {
        let cut = Cut::build(&slab(count, edge));
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
            let (values, sums) = lanes(&cut, &packet, 100.0, Some(100.0));
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
    let (cut, brute) = (Cut::build(&scene), Brute::new(&scene.positions, &scene.triangles));
    let (mut blocked, mut clear) = (0, 0);
    for packet in packets(2, 60, Vec3::new(0.0, 0.0, -0.09), Vec3::new(6.0, 6.0, 2.0)) {
        let (values, sums) = lanes(&cut, &packet, 9.0, None);
        assert_eq!(sums.aggregated, 0);
        for lane in 0..LANES {
            let (from, to) = (packet.point(lane, 0.0), packet.point(lane, 1.0));
            match brute.verdict(from, to - from, packet.near[lane], packet.far[lane], 1e-5) {
                Verdict::Blocked => assert_eq!(values[lane], 0.0, "missed {from} {to}"),
                Verdict::Clear => assert_eq!(values[lane], 1.0, "blocked by nothing {from} {to}"),
                Verdict::Marginal => continue,
            }
            (blocked, clear) = (blocked + usize::from(values[lane] == 0.0), clear + 1);
        }
    }
    assert!(blocked > 100 && clear - blocked > 100, "{blocked} of {clear}");
}

/// A child of the tree, as the umbra criterion sees it: its box, blocker size, and triangles by block.
struct Child {
    bounds: Aabb,
    blocker: f32,
    always_opened: bool,
    reference: u32,
}

fn children(cut: &Cut, node: u32) -> Vec<Child> {
    let node = &cut.nodes[node as usize];
    let lanes = (0..LANES).filter(|lane| node.used >> lane & 1 == 1);
    lanes
        .map(|lane| Child {
            bounds: node.bounds(lane),
            // The stop size is never below the mean size of the pieces, nor below half of the child's diameter.
            blocker: f32::from_bits(u32::from(node.stop[lane]) << 16),
            always_opened: node.stop[lane] == NEVER,
            reference: node.child[lane],
        })
        .collect()
}

/// Whether the reference rule forbids to average a child for a segment: an end lies inside, or a blocker of its size has an umbra of the
/// feature size or more, by a margin for rounding, at the less favourable end of the overlap.
fn is_forbidden(child: &Child, (from, to): (DVec3, DVec3), (e, s): (f64, f64)) -> Option<bool> {
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for k in 0..3 {
        let inverse = 1.0 / (to[k] - from[k]);
        let a = (f64::from(child.bounds.min[k]) - from[k]) * inverse;
        let b = (f64::from(child.bounds.max[k]) - from[k]) * inverse;
        (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
    }
    if enter > leave {
        return None;
    }
    let length = from.distance(to);
    let umbra_at = |t: f64| umbra(e, f64::from(child.blocker), (1.0 - t) * length, t * length);
    let inside = enter <= 0.0 || leave >= 1.0;
    Some(child.always_opened || inside || umbra_at(enter).max(umbra_at(leave)) >= s * 1.01)
}

/// Blocks that the reference rule opens.
fn opened(cut: &Cut, segment: (DVec3, DVec3), sizes: (f64, f64)) -> Vec<u32> {
    let (mut stack, mut blocks) = (vec![0], vec![]);
    while let Some(node) = stack.pop() {
        for child in children(cut, node) {
            if is_forbidden(&child, segment, sizes) == Some(true) {
                if child.reference & LEAF == 0 {
                    stack.push(child.reference)
                } else {
                    blocks.push(child.reference & !LEAF)
                }
            }
        }
    }
    blocks
}

/// What the umbra criterion forbids to average is tested: a triangle of it that blocks a segment makes its transmittance 0.
#[test]
fn the_cut_averages_nothing_that_the_umbra_criterion_forbids() {
    let scene = yard();
    let cut = Cut::build(&scene);
    let (mut tested, mut averaged) = (0, 0);
    for (k, packet) in packets(5, 60, Vec3::new(0.0, 0.0, -0.09), Vec3::new(6.0, 6.0, 2.5)).iter().enumerate()
    {
        let (e, s) = ([9.0, 3.0, 0.5][k % 3], [1e-6, 0.05, 0.3][k / 3 % 3]);
        let (values, sums) = lanes(&cut, packet, e, Some(s));
        averaged += sums.aggregated;
        let width = cut.width(&Bundle::of_packet(packet, e));
        assert!(width <= e);
        for lane in 0..LANES {
            let (from, to) = (packet.point(lane, 0.0), packet.point(lane, 1.0));
            for block in opened(&cut, (from.as_dvec3(), to.as_dvec3()), (width.into(), s.into())) {
                let block = &cut.blocks[block as usize];
                let corner = |v: &[[f32; LANES]; 3], i: usize| Vec3::new(v[0][i], v[1][i], v[2][i]);
                for i in 0..LANES {
                    let a = corner(&block.corner, i);
                    let points = [a, a + corner(&block.edge1, i), a + corner(&block.edge2, i)];
                    let one = Brute::new(&points, &[[0, 1, 2]]);
                    let (near, far) = (packet.near[lane] + 1e-5, packet.far[lane] - 1e-5);
                    if one.verdict(from, to - from, near, far, 1e-5) == Verdict::Blocked {
                        tested += 1;
                        assert_eq!(values[lane], 0.0, "e {e}, s {s}: averaged what blocks {from} {to}");
                    }
                }
            }
        }
    }
    assert!(tested > 50 && averaged > 40, "{tested} {averaged}");
}

#[test]
fn threads_and_instruction_sets_change_no_bit() {
    let scene = yard();
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| Cut::build(&scene))
    };
    let all: Vec<Cut> = [1, 2, 3].into_iter().map(build).collect();
    let answers = |cut: &Cut, isa: Isa| -> Vec<[u32; LANES]> {
        let cut = Cut { isa, ..cut.clone() };
        let bits = |packet: &Packet| lanes(&cut, packet, 9.0, Some(0.02)).0.map(f32::to_bits);
        packets(9, 40, Vec3::ZERO, Vec3::new(6.0, 6.0, 2.0)).iter().map(bits).collect()
    };
    let truth = answers(&all[0], Isa::Portable);
    assert!(truth.iter().flatten().any(|&bits| bits != 0 && bits != 1f32.to_bits()));
    for cut in &all {
        assert_eq!(cut.bytes(), all[0].bytes());
        for isa in [Isa::Portable, Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| isa.available()) {
            assert_eq!(answers(cut, isa), truth, "{}", isa.name());
        }
    }
}

#[test]
fn a_triangle_takes_at_most_ninety_bytes() {
    for scene in [slab(20_000, 0.1), yard()] {
        let bytes = Cut::build(&scene).bytes() as f64 / scene.triangles.len() as f64;
        assert!(bytes <= 90.0, "{bytes} bytes a triangle");
    }
}

/// Shells are left out where nothing can meet them, and only there: above and below the floor, through it, and under the light.
#[test]
fn shells_block_what_crosses_them() {
    let scene = yard();
    let cut = Cut::build(&scene);
    assert!(cut.shells.len() >= 2, "floor and light");
    let one = |from: Vec3, to: Vec3| {
        let mut packet = Packet::EMPTY;
        packet.set(0, from, to, EndRule::new(10.0));
        let (values, sums) = lanes(&cut, &packet, 0.0, None);
        (values[0], sums.blocks)
    };
    let beside = |z: f32| Vec3::new(12.0, 12.0, z);
    assert_eq!(one(beside(-1.0), beside(1.0)).0, 0.0, "through the floor");
    assert_eq!(one(beside(0.5), beside(1.0) + Vec3::X), (1.0, 0), "above the floor");
    assert_eq!(one(beside(-0.5), beside(-1.0) + Vec3::X), (1.0, 0), "below the floor");
    assert_eq!(one(Vec3::new(3.0, 3.0, 8.0), Vec3::new(3.1, 3.0, 10.0)).0, 0.0, "through the light");
}
