//! Invariants of all hierarchies.

use super::*;
use crate::scene::generate::{self, KINDS, Spec};
use crate::scene::testing::{Pieces, cloud, forest, generated, in_cube, on_threads, rotation, unit};
use glam::{DMat3, DVec3, Vec3};
use proptest::prelude::*;
use rand_pcg::Pcg64Mcg;

/// Checks the clusters of all builders; returns those of the default one.
fn check(scene: &Scene) -> Hierarchy {
    let [hierarchy, ..] = Builder::ALL.map(|builder| {
        let hierarchy = build(scene, &Options { builder, ..Options::default() });
        if let Err(broken) = hierarchy.check(scene) {
            panic!("{} by {}: {broken}", scene.path.display(), builder.name());
        }
        hierarchy
    });
    hierarchy
}

#[test]
fn every_generated_scene_is_partitioned() {
    for kind in KINDS {
        let mut spec = Spec::new(kind.name);
        (spec.trees, spec.leaves, spec.trunks) = (16, 200, true);
        let scene = generate::build(&spec).expect(kind.name);
        let hierarchy = check(&scene);
        // A fan-out of 16 that is at least an eighth used bounds the depth.
        let levels = hierarchy.micro.levels();
        let log = (scene.triangles.len() as f64).log2().ceil() as usize;
        assert!(levels <= log + 4, "{}: {levels} levels for {} triangles", kind.name, scene.triangles.len());
    }
}

/// Pieces with sizes over four decades, clumped or spread, in several objects.
fn jumble(seed: u64, count: usize, scale: f64, flat: bool, objects: usize) -> Scene {
    let mut random = Pcg64Mcg::new(seed.into());
    let mut pieces = Pieces::new();
    for i in 0..count {
        if i % count.div_ceil(objects) == 0 {
            pieces.object(&format!("object {i}"));
        }
        let clump = if unit(&mut random) < 0.3 { 0.01 } else { 1.0 };
        let mut centre = clump * in_cube(&mut random);
        if flat {
            centre.z = 0.0;
        }
        let edge = 10f64.powf(-4.0 * unit(&mut random));
        let turn = if flat { DMat3::from_rotation_z(6.0 * unit(&mut random)) } else { rotation(&mut random) };
        let (centre, turn) = (centre * scale, turn * edge * scale);
        match i % 3 {
            0 if !flat => pieces.block(centre, turn),
            1 => pieces.quad(centre, turn.x_axis, 1e-3 * turn.y_axis),
            _ => pieces.polygon(&[centre, centre + turn.x_axis, centre + turn.y_axis]),
        };
    }
    pieces.scene()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
    #[test]
    fn random_scenes_are_partitioned(
        seed in any::<u64>(),
        count in 1usize..400,
        magnitude in -6i32..=6,
        flat in any::<bool>(),
        objects in 1usize..40,
    ) {
        check(&jumble(seed, count, 10f64.powi(magnitude), flat, objects));
    }
}

#[test]
fn smallest_scenes_work() {
    let mut one = Pieces::new();
    one.polygon(&[DVec3::ZERO, DVec3::X, DVec3::Y]);
    let hierarchy = check(&one.scene());
    assert_eq!(hierarchy.micro.order.len() + hierarchy.large.order.len(), 1);
    let mut room = Pieces::new();
    room.cuboid(DVec3::ZERO, DVec3::ONE);
    let hierarchy = check(&room.scene());
    assert!(hierarchy.micro.clusters.is_empty() && hierarchy.micro.levels() == 0, "a room's walls are large");
    assert_eq!(hierarchy.large.order.len(), 12);
    // Many more triangles around one point than fit into a leaf or a voxel.
    let mut star = Pieces::new();
    for k in 0..200 {
        let turn = DMat3::from_rotation_z(0.01 * f64::from(k)) * DMat3::from_rotation_x(0.3 * f64::from(k));
        star.block(DVec3::ZERO, turn);
    }
    check(&star.scene());
}

#[test]
fn result_does_not_depend_on_threads() {
    let mut spec = Spec::new("forest");
    (spec.trees, spec.leaves, spec.trunks) = (25, 300, true);
    for scene in [generate::build(&spec).expect("forest"), jumble(5, 3000, 1.0, false, 7)] {
        for builder in Builder::ALL {
            let options = Options { builder, ..Options::default() };
            let with = |threads| format!("{:?}", on_threads(threads, || build(&scene, &options)));
            let name = (scene.path.display(), builder.name());
            assert!(with(1) == with(2), "{name:?}: differs with the number of threads");
        }
    }
}

#[test]
fn large_surfaces_stay_outside_and_detail_inside() {
    let room = generated("desk-room");
    let large = |scene: &Scene| {
        let mut is_large = vec![false; scene.triangles.len()];
        check(scene).large.order.iter().for_each(|&t| is_large[t as usize] = true);
        is_large
    };
    let is_large = large(&room);
    for name in ["floor", "ceiling", "wall back", "wall front", "wall left", "wall right"] {
        assert!(
            room.faces_named(name).expect(name).iter().all(|&t| is_large[t as usize]),
            "{name} is not large"
        );
    }
    for name in ["keyboard", "cup", "pencils", "sheets"] {
        assert!(
            room.faces_named(name).expect(name).iter().all(|&t| !is_large[t as usize]),
            "{name} is large"
        );
    }
    // The top of the desk is large, the legs are not.
    let normal = |t: u32| room.face_normal(t);
    let desk = room.faces_named("desk").expect("desk");
    let span = |t: u32| Aabb::of(room.corners(t)).extent();
    let top: Vec<u32> = desk.iter().copied().filter(|&t| normal(t).z > 0.9 && span(t).x > 1.0).collect();
    assert!(top.len() == 2 && top.iter().all(|&t| is_large[t as usize]), "{top:?}");
    let legs = desk.iter().filter(|&&t| span(t).x < 0.1 && span(t).y < 0.1);
    assert!(legs.clone().count() > 0 && legs.into_iter().all(|&t| !is_large[t as usize]), "a leg is large");

    let forest = forest(16, 200);
    let is_large = large(&forest);
    for (t, &is_large) in is_large.iter().enumerate() {
        let object = &forest.objects[forest.triangle_object[t] as usize].name;
        if object.starts_with("tree") {
            assert!(!is_large, "a leaf of {object} is large");
        } else if object == "ground" {
            assert!(is_large, "the ground is not large");
        }
    }
}

/// A finely tessellated column is not planar, however small the angle between neighbouring faces.
#[test]
fn finely_tessellated_columns_are_not_planar() {
    let mut column = Pieces::new();
    let n = 720;
    let at = |k: usize, z: f64| {
        let turn = std::f64::consts::TAU * (k % n) as f64 / n as f64;
        DVec3::new(turn.cos(), turn.sin(), z)
    };
    for k in 0..n {
        column.polygon(&[at(k, 0.0), at(k + 1, 0.0), at(k + 1, 2.0), at(k, 2.0)]);
    }
    let scene = column.scene();
    let hierarchy = check(&scene);
    // Facets turn by half a degree each: a planar patch may span a few degrees, not the whole column.
    let mut normals = hierarchy.large.order.iter().map(|&t| scene.face_normal(t));
    if let Some(first) = normals.next() {
        assert!(normals.all(|n| n.dot(first) > 0.0), "one `planar` surface goes all around a column");
    }
}

#[test]
fn validator_finds_every_kind_of_damage() {
    let scene = jumble(11, 500, 1.0, false, 3);
    let good = build(&scene, &Options::default());
    good.check(&scene).expect("undamaged");
    let leaf = good.micro.clusters.iter().position(|c| c.is_leaf() && c.triangles > 1).expect("leaf");
    let inner = good.micro.clusters.iter().position(|c| !c.is_leaf()).expect("inner");
    let child = good.micro.clusters[inner].first_child as usize;
    type Damage<'a> = Box<dyn Fn(&mut Tree) + 'a>;
    let damages: [(&str, Damage); 12] = [
        ("a triangle twice", Box::new(|t| t.order[0] = t.order[1])),
        ("a triangle lost", Box::new(|t| _ = t.order.pop())),
        ("leaf box too small", Box::new(|t| t.clusters[leaf].bounds.max -= Vec3::splat(1e-3))),
        ("leaf box too large", Box::new(|t| t.clusters[leaf].bounds.max.x += 1.0)),
        ("inner box too small", Box::new(|t| t.clusters[inner].bounds.min += Vec3::splat(1e-3))),
        ("wrong parent", Box::new(|t| t.clusters[child].parent += 1)),
        ("a cycle", Box::new(|t| t.clusters[inner].first_child = inner as u32)),
        ("a child outside the array", Box::new(|t| t.clusters[inner].first_child = t.clusters.len() as u32)),
        ("an orphan", Box::new(|t| t.clusters[inner].children -= 1)),
        ("a child twice", Box::new(|t| t.clusters[inner].first_child += 1)),
        ("a leaf without triangles", Box::new(|t| t.clusters[leaf].triangles = 0)),
        ("triangles counted wrongly", Box::new(|t| t.clusters[child].triangles += 1)),
    ];
    for (name, damage) in damages {
        let mut bad = good.clone();
        damage(&mut bad.micro);
        assert!(bad.check(&scene).is_err(), "{name}: not found");
    }
    let mut bad = good.clone();
    bad.large = bad.micro.clone();
    assert!(bad.check(&scene).is_err(), "a triangle in both trees: not found");
    bad = good.clone();
    bad.micro.clusters.clear();
    assert!(bad.check(&scene).is_err(), "triangles without a root: not found");
}

/// Triangles of all clusters, those of inner ones included: what a builder looks at.
fn work(scene: &Scene) -> f64 {
    let Hierarchy { micro, large } = build(scene, &Options::default());
    micro.clusters.iter().chain(&large.clusters).map(|c| f64::from(c.triangles)).sum()
}

/// O(n log n), as counted by the triangles that the builder looks at: four times as many in all are less than five times as many to look
/// at. In the largest thicket a step for each pair would take longer than a test may.
#[test]
fn build_work_grows_as_n_log_n() {
    let forest = |trees| forest(trees, 200);
    // One object of pieces that all overlap: every voxel holds many items.
    let thicket = |n| cloud(3, n, 0.2, DVec3::ONE, true).scene();
    let bricks = |courses| {
        let mut spec = Spec::new("brick-wall");
        spec.count = Some(courses);
        generate::build(&spec).expect("bricks")
    };
    let cases = [
        ("forest", forest(25), forest(100)),
        ("thicket", thicket(4_000), thicket(64_000)),
        ("bricks", bricks(40), bricks(80)),
    ];
    for (name, small, big) in cases {
        let triangles = [&small, &big].map(|scene| scene.triangles.len() as f64);
        let expected = triangles[1] * triangles[1].ln() / (triangles[0] * triangles[0].ln());
        let found = work(&big) / work(&small);
        assert!(found < 1.2 * expected, "{name}: {found:.2} times the work, expected {expected:.2}");
    }
}
