//! Sequences of updates against models that are prepared afresh.

use super::{blocked, bundles, transmittances};
use crate::math::rows;
use crate::model::testing::model;
use crate::model::{Detail, Instance, InstanceChange, Model};
use crate::scene::generate::{self, Spec};
use crate::scene::testing::unit;
use crate::scene::{Placement, Scene};
use crate::visibility::InstanceTree;
use glam::{DAffine3, DVec3};
use proptest::prelude::*;
use rand_pcg::Pcg64Mcg;

fn forest(trees: usize, leaves: usize) -> Scene {
    let spec = Spec { trees, leaves, instances: true, species: 2, ..Spec::new("forest") };
    generate::build(&spec).expect("a forest")
}

fn groups(model: &Model) -> Option<&InstanceTree> {
    model.inner.top.as_ref()?.groups.as_deref()
}

/// The scene as it stands after the updates of a model.
fn scene_of(model: &Model) -> Scene {
    let placements = model.instances()[1..].iter().map(|instance| Placement {
        mesh: instance.mesh - 1,
        transform: instance.affine(),
        name: instance.name.to_string(),
        material: instance.material,
        visible: instance.is_present(),
    });
    Scene { placements: placements.collect(), ..model.scene().clone() }
}

/// A change that is allowed, of an instance that exists.
fn some_change(random: &mut Pcg64Mcg, instances: &[Instance]) -> InstanceChange {
    let there: Vec<u32> = (1..instances.len() as u32).filter(|&i| !instances[i as usize].removed).collect();
    let instance = there[(unit(random) * there.len() as f64) as usize];
    let away = DVec3::new(30.0 * unit(random) - 15.0, 30.0 * unit(random) - 15.0, unit(random));
    let of = &instances[instance as usize];
    let transform = rows(&(DAffine3::from_translation(away) * of.affine()));
    match (5.0 * unit(random)) as u32 {
        0 | 1 => InstanceChange::Move { instance, transform },
        2 => InstanceChange::Add(Instance { transform, ..of.clone() }),
        3 if there.len() > 1 => InstanceChange::Remove { instance },
        _ => InstanceChange::Show { instance, visible: unit(random) < 0.5 },
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    /// Whatever moved, came and went: groups, their optics and all answers are those of a model that is prepared afresh.
    #[test]
    fn histories_leave_no_trace(seed in 0u64..1 << 40, trees in 2usize..60) {
        let mut random = Pcg64Mcg::new(u128::from(seed));
        let first = model(&forest(trees, 60), Detail::Optics);
        let mut updated = first.clone();
        for step in 0..4 {
            let mut changes: Vec<InstanceChange> = Vec::new();
            for _ in 0..1 + step * step {
                // Only the last change of an instance may remove it.
                let change = some_change(&mut random, updated.instances());
                let last = matches!(change, InstanceChange::Remove { .. });
                changes.push(change);
                if last {
                    break;
                }
            }
            updated = updated.update(&changes).expect("updated");
            prop_assert_eq!(updated.revision(), step as u64 + 1);
        }
        let shared = first.meshes().iter().zip(updated.meshes());
        prop_assert!(shared.clone().all(|(a, b)| std::sync::Arc::ptr_eq(a, b)), "a mesh was made again");
        let fresh = model(&scene_of(&updated), Detail::Optics);
        match (groups(&updated), groups(&fresh)) {
            (Some(updated), Some(fresh)) => prop_assert!(updated.equals(fresh)),
            (updated, fresh) => prop_assert_eq!(updated.is_some(), fresh.is_some()),
        }
        let packets = &bundles(&fresh)[..100];
        prop_assert_eq!(blocked(&updated, packets), blocked(&fresh, packets));
        for s in [0.05, 1.0, 4.0] {
            prop_assert_eq!(transmittances(&updated, packets, s), transmittances(&fresh, packets, s));
        }
    }
}

/// An update measures the groups above the instance that it moves, and shares the others.
#[test]
fn updates_measure_the_groups_above_changed_instances() {
    let before = model(&forest(1000, 20), Detail::Optics);
    let away = DAffine3::from_translation(DVec3::new(7.0, -5.0, 0.0)) * before.instances()[400].affine();
    let moved = InstanceChange::Move { instance: 400, transform: rows(&away) };
    let after = before.update(&[moved]).expect("updated");
    let [old, new] = [&before, &after].map(|model| groups(model).expect("groups"));
    let [all, made] = new.counts(old);
    assert!(made > 0 && made < all / 10, "{made} of {all} groups");
    assert_eq!(old.counts(old)[1], 0);
}
