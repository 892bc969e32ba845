//! Models of few instances: one, none that rays see, and what is told of them.

use super::*;
use crate::bench::workload::surface_points;
use crate::scene::testing::{Pieces, cloud};
use crate::scene::{LoadOptions, Material, Placement};
use std::sync::Arc;

/// A lamp far above, and a mesh that is placed by each of `transforms`.
fn scene_of(mesh: Scene, transforms: &[DAffine3]) -> Scene {
    let mut pieces = Pieces::new();
    pieces.light(DVec3::new(0.5, 0.5, 40.0), DVec3::Y, DVec3::X);
    let mut scene = pieces.scene();
    scene.shared = vec![Arc::new(mesh)];
    let placement = |(i, &transform): (usize, &DAffine3)| Placement {
        mesh: 0,
        transform,
        name: format!("thing {i}"),
        material: None,
        visible: true,
    };
    scene.placements = transforms.iter().enumerate().map(placement).collect();
    scene
}

/// A cloud of small squares around the origin of its frame.
fn mesh() -> Scene {
    cloud(3, 400, 0.08, DVec3::ONE, true).scene()
}

/// Packets through a unit box around `centre`, from one side to the other.
fn through(model: &Model, centre: Vec3) -> Vec<Packet> {
    (0..200)
        .map(|k| {
            let turn = k as f32 * 2.399_963;
            let side = Vec3::new(turn.cos(), turn.sin(), 0.6 * (k as f32 * 0.618).fract() - 0.3);
            let mut packet = Packet::EMPTY;
            for lane in 0..LANES {
                let by = Vec3::new((lane % 4) as f32 - 1.5, 0.0, (lane / 4) as f32 - 1.5) * 0.15;
                packet.set(lane, centre - 2.0 * side, centre + 2.0 * side + by, model.end_rule());
            }
            packet
        })
        .collect()
}

/// An instance that stands alone is averaged with the optics of its own mesh, as if its triangles were the scene's own, and
/// never as a group with the coarser optics of groups.
#[test]
fn an_instance_alone_answers_like_its_mesh() {
    let transform = DAffine3::from_translation(DVec3::new(8.0, -3.0, 1.0));
    let placed = model(&scene_of(mesh(), &[transform]), Detail::Optics);
    let own = model(&mesh(), Detail::Optics);
    // Both scenes are stored relative to their origins.
    let centre = placed.instances()[1].bounds(placed.mesh_of(1)).center();
    let [in_placed, in_own] = [through(&placed, centre), through(&own, own.scene().bounds.center())];
    let mut averaged = 0;
    for s in [0.05, 0.3, 1.0, 4.0] {
        let engine = |model: &Model| model.engine(model.widest_packets(), LeafMode::Average).expect("optics");
        let ask = |model: &Model, packets: &[Packet]| -> Vec<f32> {
            let bundles: Vec<Bundle> = packets.iter().map(|p| Bundle::of_packet(p, 0.3)).collect();
            let mut found = Vec::new();
            engine(model).answers(&bundles, s, &mut Workspace::default(), |a| found.push(a.transmittance));
            found
        };
        for (a, b) in ask(&placed, &in_placed).into_iter().zip(ask(&own, &in_own)) {
            assert!((a - b).abs() < 1e-3, "s = {s}: placed {a}, own {b}");
            averaged += usize::from(b > 0.0 && b < 1.0);
        }
    }
    assert!(averaged > 400, "{averaged} answers are averages");
}

/// Models whose instances are all removed or hidden are as good as models without.
#[test]
fn models_without_present_instances_are_single() {
    let away = |x: f64| DAffine3::from_translation(DVec3::new(x, 0.0, 0.0));
    let scene = scene_of(mesh(), &[away(3.0), away(6.0)]);
    let both = model(&scene, Detail::Optics);
    let refused = both.check_single("the test").expect_err("two placed meshes").to_string();
    assert!(refused.contains("`model` has 2"), "{refused}");
    let gone = both
        .update(&[
            InstanceChange::Remove { instance: 1 },
            InstanceChange::Show { instance: 2, visible: false },
        ])
        .expect("updated");
    gone.check_single("the test").expect("single");
    let never = model(&Scene { shared: vec![], placements: vec![], ..scene }, Detail::Optics);
    assert_eq!((gone.bounds(), gone.visible_triangles()), (never.bounds(), never.visible_triangles()));
    let packets = through(&gone, gone.bounds().center());
    assert_eq!(blocked(&gone, &packets), blocked(&never, &packets));
    assert_eq!(transmittances(&gone, &packets, 0.3), transmittances(&never, &packets, 0.3));
    let again = gone.update(&[InstanceChange::Show { instance: 2, visible: true }]).expect("updated");
    assert!(again.check_single("the test").is_err() && again.visible_triangles() > gone.visible_triangles());
}

/// Receiver points lie on the instances that are there, where they are now.
#[test]
fn points_follow_instances() {
    let away = |x: f64| DAffine3::from_translation(DVec3::new(x, 0.0, 0.0));
    let scene = scene_of(mesh(), &[away(3.0), away(6.0), away(9.0)]);
    let before = model(&scene, Detail::Rays);
    let after = before
        .update(&[
            InstanceChange::Move { instance: 1, transform: rows(&away(50.0)) },
            InstanceChange::Remove { instance: 2 },
        ])
        .expect("updated");
    let boxes: Vec<_> =
        [1, 3].iter().map(|&i| after.instances()[i].bounds(after.mesh_of(i as u32))).collect();
    let mut counts = [0; 2];
    for point in surface_points(&after, 1000, 1).expect("points") {
        let inside = |b: &crate::math::Aabb| {
            let off = (point.position - b.center()).abs() - 0.5 * b.extent();
            off.max_element() < 1e-3
        };
        let k = boxes.iter().position(inside).expect("on an instance that is there");
        counts[k] += 1;
    }
    assert!(counts.iter().all(|&n| n > 450), "{counts:?}");
}

/// Emitters are triangles of the scene's own: a placement that emits is refused when the scene is made, and when it is prepared.
#[test]
fn instances_do_not_emit() {
    let mut scene = scene_of(mesh(), &[DAffine3::IDENTITY, DAffine3::from_translation(DVec3::X)]);
    let lamp = |m: &Material| m.emission != [0.0; 3];
    scene.placements[1].material = scene.materials.iter().position(lamp).map(|m| m as u32);
    let options = super::super::PrepareOptions { detail: Detail::Rays, ..Default::default() };
    let refused = Model::prepare(scene, &options).err().expect("an instance emits").to_string();
    assert!(refused.contains("`instance` 2") && refused.contains("must not emit"), "{refused}");
    let spec = Spec { trees: 3, leaves: 20, instances: true, ..Spec::new("forest") };
    let mut placed = generate::placed(&spec).expect("a forest");
    placed.placements[1].material = Some(99);
    let refused =
        crate::scene::resolve_placed(placed, &LoadOptions::default()).expect_err("no such material");
    assert!(
        refused.to_string().contains("`tree 2` emits or has a material that does not exist"),
        "{refused}"
    );
}

/// The figures of memory include all meshes, each once, and the groups above their instances.
#[test]
fn memory_counts_all_meshes_once() {
    let away = |x: f64| DAffine3::from_translation(DVec3::new(x, 0.0, 0.0));
    let place = |n: i32| (0..n).map(|x| away(3.0 * f64::from(x))).collect::<Vec<_>>();
    let bytes = |n: i32| {
        let model = model(&scene_of(mesh(), &place(n)), Detail::Optics);
        let trees: usize =
            model.meshes().iter().map(|mesh| mesh.measured().expect("optics").tree.bytes()).sum();
        let all = model.engine(model.widest_packets(), LeafMode::Exact).expect("optics").bytes();
        assert!(all > trees, "{all} bytes in all, {trees} of the meshes");
        (all - trees, model.group_bytes())
    };
    let (few, many) = (bytes(2), bytes(200));
    assert!(many.0 > 5 * few.0 && many.1 == few.1 && few.1 > 0, "{few:?} and {many:?}");
}
