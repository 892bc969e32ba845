//! Embree against brute force, and the guarantees of the wrapper.

use super::*;
use crate::ray::{Brute, EndRule, HitResult, LANES, Occluder, Packet};
use glam::Vec3;
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

fn unit(rng: &mut Pcg64Mcg) -> f32 {
    (rng.next_u32() >> 8) as f32 / (1 << 24) as f32
}

fn point(rng: &mut Pcg64Mcg) -> Vec3 {
    Vec3::new(unit(rng), unit(rng), unit(rng))
}

/// Random triangles: pairs with a shared edge, axis-aligned coplanar ones, slivers, and others.
fn random_scene(rng: &mut Pcg64Mcg, count: usize) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions: Vec<Vec3> = Vec::new();
    let mut triangles = Vec::new();
    for k in 0..count as u32 {
        let base = positions.len() as u32;
        let centre = point(rng);
        let size = 0.02 + 0.3 * unit(rng);
        match k % 4 {
            // Two triangles of a quad: a shared edge.
            0 => {
                let (a, b) = (size * (point(rng) - 0.5), size * (point(rng) - 0.5));
                positions.extend([centre, centre + a, centre + a + b, centre + b]);
                triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
            }
            // In the plane z = 1/4 or 3/4: many coplanar neighbours.
            1 => {
                let z = if unit(rng) < 0.5 { 0.25 } else { 0.75 };
                for _ in 0..3 {
                    let p = centre + size * (point(rng) - 0.5);
                    positions.push(Vec3::new(p.x, p.y, z));
                }
                triangles.push([base, base + 1, base + 2]);
            }
            // A sliver.
            2 => {
                let a = 0.3 * (point(rng) - 0.5);
                positions.extend([centre, centre + a, centre + 0.5 * a + 1e-3 * (point(rng) - 0.5)]);
                triangles.push([base, base + 1, base + 2]);
            }
            _ => {
                positions.extend((0..3).map(|_| centre + size * (point(rng) - 0.5)));
                triangles.push([base, base + 1, base + 2]);
            }
        }
    }
    (positions, triangles)
}

/// Segments between random points: in space, on triangles (touching), in planes of triangles (coplanar), grazing.
fn random_segment(
    rng: &mut Pcg64Mcg,
    kind: usize,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
) -> (Vec3, Vec3) {
    let on = |rng: &mut Pcg64Mcg| {
        let t = triangles[rng.next_u32() as usize % triangles.len()].map(|v| positions[v as usize]);
        let (mut u, mut v) = (unit(rng), unit(rng));
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        t[0] + u * (t[1] - t[0]) + v * (t[2] - t[0])
    };
    match kind {
        0 => (point(rng), point(rng)),
        1 => (on(rng), on(rng)),
        2 => {
            let a = point(rng).with_z(0.25);
            (a, point(rng).with_z(0.25))
        }
        3 => {
            let a = point(rng).with_z(0.25);
            (a, point(rng).with_z(0.25 + 1e-4))
        }
        _ => {
            // Through a vertex: touches all triangles that share the vertex.
            let v = positions[rng.next_u32() as usize % positions.len()];
            let d = point(rng) - 0.5;
            (v - d, v + d)
        }
    }
}

#[test]
fn brute_force_and_every_packet_mode_agree_on_100_000_segments() {
    let mut rng = Pcg64Mcg::new(7);
    let ends = EndRule::new(1.0);
    let (mut clear, mut blocked_count, mut marginal, mut compared) = (0, 0, [0; 5], 0);
    for _ in 0..50 {
        let (positions, triangles) = random_scene(&mut rng, 120);
        let brute = Brute::new(&positions, &triangles);
        let scene = committed(&positions, &triangles);
        let packets: Vec<Packet> = (0..125)
            .map(|_| {
                let mut packet = Packet::EMPTY;
                for lane in 0..LANES {
                    let (a, b) = random_segment(&mut rng, lane % 5, &positions, &triangles);
                    packet.set(lane, a, b, ends);
                    // Distances to slivers err by more than the margins of the rule: compared are longer ones.
                    packet.near[lane] = packet.near[lane].max(1e-4);
                    packet.far[lane] = packet.far[lane].min(1.0 - 1e-4);
                }
                packet
            })
            .collect();
        let modes: Vec<(Traversal, Vec<u32>)> =
            [(1, false), (4, false), (4, true), (8, true), (16, false), (16, true)]
                .into_iter()
                .map(|(width, coherent)| {
                    let traversal = Traversal { width, coherent };
                    let mut blocked = vec![0; packets.len()];
                    scene.occluded_by(traversal, &packets, &mut blocked);
                    (traversal, blocked)
                })
                .collect();
        for (k, packet) in packets.iter().enumerate() {
            for lane in packet.lanes() {
                let [a, d] =
                    [&packet.origin, &packet.direction].map(|v| Vec3::from(v.map(|axis| axis[lane])));
                compared += 1;
                // f32 and f64, single rays and packets may differ only where brute force is within 1e-6 (eight rounding
                // errors) of an edge, an end or the plane.
                let verdict = brute.verdict(a, d, packet.near[lane], packet.far[lane], 1e-6);
                match verdict {
                    HitResult::Clear => clear += 1,
                    HitResult::Blocked => blocked_count += 1,
                    HitResult::Marginal => {
                        marginal[lane % 5] += 1;
                        continue;
                    }
                }
                for (traversal, blocked) in &modes {
                    let is = blocked[k] >> lane & 1 == 1;
                    assert_eq!(is, verdict == HitResult::Blocked, "{traversal:?}: {a} + {d}");
                }
            }
        }
    }
    assert_eq!(compared, 100_000);
    // All kinds occur, and few segments are marginal outside the deliberately degenerate kinds.
    assert!(clear > 10_000 && blocked_count > 10_000, "{clear} clear, {blocked_count} blocked");
    assert!(marginal[0] + marginal[1] < compared / 100, "{marginal:?} marginal");
}

#[test]
fn inactive_lanes_are_clear() {
    let positions = [Vec3::new(-9.0, -9.0, 0.5), Vec3::new(9.0, -9.0, 0.5), Vec3::new(0.0, 9.0, 0.5)];
    let scene = committed(&positions, &[[0, 1, 2]]);
    let mut packet = Packet::EMPTY;
    for lane in [1, 5, 15] {
        packet.set(lane, Vec3::ZERO, Vec3::Z, EndRule::new(1.0));
    }
    for width in [1, 4, 8, 16] {
        let mut blocked = [0];
        let traversal = Traversal { width, coherent: false };
        scene.occluded_by(traversal, std::slice::from_ref(&packet), &mut blocked);
        assert_eq!(blocked[0], packet.active);
    }
}

#[test]
fn bad_buffers_are_refused() {
    let device = Device::new(1).unwrap();
    let mut builder = SceneBuilder::new(&device).unwrap();
    let fine = [Vec3::ZERO, Vec3::X, Vec3::Y];
    assert!(builder.add_triangles(&fine, &[[0, 1, 3]]).is_err());
    assert!(builder.add_triangles(&[Vec3::ZERO, Vec3::NAN, Vec3::Y], &[[0, 1, 2]]).is_err());
    assert!(builder.add_triangles(&[Vec3::ZERO, Vec3::X * 1e30, Vec3::Y], &[[0, 1, 2]]).is_err());
    builder.add_triangles(&fine, &[[0, 1, 2]]).unwrap();
    let (scene, mut packet, mut blocked) = (builder.commit().unwrap(), Packet::EMPTY, [0]);
    packet.set(0, Vec3::new(0.2, 0.2, 1.0), Vec3::new(0.2, 0.2, -1.0), EndRule::new(1.0));
    scene.occluded(&[packet], &mut blocked);
    assert_eq!(blocked, [1], "the good triangle blocks");
}

#[test]
fn scenes_outlive_the_device_handle_and_count_bytes() {
    let device = Device::new(1).unwrap();
    assert!(device.version().starts_with("4."));
    let scene = {
        let mut builder = SceneBuilder::new(&device).unwrap();
        builder.add_triangles(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]]).unwrap();
        builder.commit().unwrap()
    };
    assert!(device.bytes() > 0);
    drop(device);
    let mut packet = Packet::EMPTY;
    packet.set(0, Vec3::new(0.2, 0.2, -1.0), Vec3::new(0.2, 0.2, 1.0), EndRule::new(1.0));
    let mut blocked = [0];
    scene.occluded(&[packet], &mut blocked);
    assert_eq!(blocked, [1]);
    drop(scene);
    // The next device is that one again, without its scenes.
    assert_eq!(Device::new(1).unwrap().bytes(), 0);
}

#[test]
fn first_hits_are_the_nearest() {
    // Squares at z = 1, 2, 3: from below the first is hit, from above the last; a short segment hits none.
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for z in [1.0f32, 2.0, 3.0] {
        let base = positions.len() as u32;
        positions.extend([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Vec3::new(x, y, z)));
        triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    }
    let scene = committed(&positions, &triangles);
    let ends = EndRule::new(3.0);
    let mut packet = Packet::EMPTY;
    packet.set(0, Vec3::new(0.7, 0.2, 0.0), Vec3::new(0.7, 0.2, 4.0), ends);
    packet.set(3, Vec3::new(0.2, 0.7, 4.0), Vec3::new(0.2, 0.7, 0.0), ends);
    packet.set(15, Vec3::new(0.2, 0.7, 0.0), Vec3::new(0.2, 0.7, 0.5), ends);
    for width in [1, 4, 8, 16] {
        for coherent in [false, true] {
            let mut hits = [Hits::NONE];
            scene.first_hits(Traversal { width, coherent }, std::slice::from_ref(&packet), &mut hits);
            let mut want = [Hits::NO_HIT; LANES];
            (want[0], want[3]) = (0, 5);
            assert_eq!(hits[0].triangle, want, "{width} {coherent}");
            assert!((hits[0].t[0] - 0.25).abs() < 1e-6 && (hits[0].t[3] - 0.25).abs() < 1e-6);
        }
    }
}

/// `shim.c` compares with Embree's headers what it states itself; this compares it with what Rust states.
#[test]
fn the_shim_checks_every_constant_and_function() {
    let name_of =
        |text: &str| text.split(|c: char| !c.is_alphanumeric() && c != '_').next().map(str::to_owned);
    let (mut constants, mut functions) = (Vec::new(), Vec::new());
    for line in include_str!("sys.rs").lines().map(str::trim) {
        if let Some((name, value)) = line.split_once(" = ").filter(|_| line.starts_with("RTC_")) {
            constants.push((name.to_owned(), value.trim_end_matches(',').to_owned()));
        }
        functions.extend(line.strip_prefix("pub fn rtc").and_then(name_of));
    }
    let (mut checked_constants, mut checked_functions) = (Vec::new(), Vec::new());
    for line in include_str!("shim.c").lines() {
        if let Some((name, value)) = line.strip_prefix("CONSTANT(").and_then(|l| l.split_once(", ")) {
            checked_constants.push((name.to_owned(), value.trim_end_matches(");").to_owned()));
        }
        checked_functions.extend(line.strip_prefix("FUNCTION(rtc").and_then(name_of));
    }
    assert!(constants.len() > 15 && functions.len() > 15, "both are found");
    assert_eq!(constants, checked_constants);
    assert_eq!(functions, checked_functions);
}

/// Pieces of a grid of samples with a hole are hit where their triangles are, on the diagonal that the interface states.
#[test]
fn pieces_of_grids_are_hit_as_their_triangles() {
    const COLUMNS: usize = 9;
    let mut rng = Pcg64Mcg::new(5);
    let mut samples: Vec<[f32; 3]> = Vec::new();
    for k in 0..COLUMNS * 7 {
        samples.push([(k % COLUMNS) as f32, -((k / COLUMNS) as f32), 2.0 * unit(&mut rng)]);
    }
    samples[COLUMNS * 7 - 1] = [f32::NAN; 3];
    let first = [0, 4, 3 * COLUMNS as u32, 3 * COLUMNS as u32 + 5];
    let size = [[5, 4], [5, 4], [6, 4], [3, 3]];
    let pieces: Vec<GridPiece> =
        (0..4).map(|k| GridPiece { first: first[k], stride: COLUMNS as u32, size: size[k] }).collect();
    let (mut triangles, mut of_piece) = (Vec::new(), Vec::new());
    for piece in &pieces {
        of_piece.push(triangles.len() as u32);
        for cell in 0..u32::from(piece.size[0] - 1) * u32::from(piece.size[1] - 1) {
            let (c, r) = (cell % u32::from(piece.size[0] - 1), cell / u32::from(piece.size[0] - 1));
            let nw = piece.first + r * piece.stride + c;
            let [ne, sw, se] = [nw + 1, nw + piece.stride, nw + piece.stride + 1];
            triangles.extend([[sw, ne, nw], [sw, se, ne]]);
        }
    }
    let device = Device::new(1).unwrap();
    let mut builder = SceneBuilder::new(&device).unwrap();
    let lonely = [Vec3::new(0.0, 0.0, -9.0), Vec3::new(1.0, 0.0, -9.0), Vec3::new(0.0, -1.0, -9.0)];
    builder.add_triangles(&lonely, &[[0, 1, 2]]).unwrap();
    let sizes: Vec<[f32; 2]> = size.iter().map(|s| s.map(|n| f32::from(n - 1_u16))).collect();
    let face = move |piece: u32, [u, v]: [f32; 2]| {
        let [columns, rows] = sizes[piece as usize];
        let (x, y) = ((u * columns).min(columns - 0.001), (v * rows).min(rows - 0.001));
        let cell = (y as u32) * columns as u32 + x as u32;
        of_piece[piece as usize] + 2 * cell + u32::from(x.fract() + y.fract() > 1.0)
    };
    let outside = GridPiece { first: 40, stride: 9, size: [9, 4] };
    assert!(builder.add_grid(&samples, &[outside], std::sync::Arc::new(|_, _| 0)).is_err());
    builder.add_grid(&samples, &pieces, std::sync::Arc::new(face)).unwrap();
    let scene = builder.commit().unwrap();
    let place = |k: u32| Vec3::from(samples[k as usize]);
    let (mut met, mut missed) = (0, 0);
    for _ in 0..2000 {
        let from = Vec3::new(8.0 * unit(&mut rng), -6.0 * unit(&mut rng), 5.0);
        let to = Vec3::new(8.0 * unit(&mut rng), -6.0 * unit(&mut rng), -5.0);
        let d = to - from;
        let mut nearest: Option<(u32, f32, f32)> = None;
        for (t, corners) in (0u32..).zip(&triangles) {
            let [a, b, c] = corners.map(place);
            let normal = (b - a).cross(c - a);
            let at = (a - from).dot(normal) / d.dot(normal);
            let p = from + at * d;
            let parts = [(a, b), (b, c), (c, a)].map(|(a, b)| (b - a).cross(p - a).dot(normal));
            let inside = parts.into_iter().fold(f32::INFINITY, f32::min) / normal.length_squared();
            if inside > 0.0 && nearest.is_none_or(|(_, near, _)| at < near) {
                nearest = Some((t, at, inside));
            }
        }
        let mut packet = Packet::EMPTY;
        packet.set_between(3, from, to, [0.0, 1.0]);
        let packet = [packet];
        for width in [1, 4, 8, 16] {
            let mut hits = [Hits::NONE];
            scene.first_hits(Traversal { width, coherent: false }, &packet, &mut hits);
            let (triangle, t) = (hits[0].triangle[3], hits[0].t[3]);
            match nearest {
                // Away from edges.
                Some((wanted, at, inside)) if inside > 0.01 => {
                    assert_eq!(triangle, wanted, "width {width}");
                    assert!((t - at).abs() < 1e-4);
                    met += 1;
                }
                None => missed += usize::from(triangle == Hits::NO_HIT),
                _ => {}
            }
        }
    }
    assert!(met > 4000 && missed > 10, "{met} and {missed}");
}
