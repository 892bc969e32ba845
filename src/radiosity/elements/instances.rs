//! Instances of a scene in its elements, and ids of surfaces that do not change with other instances.
//!
//! The arena of elements follows the clusters, which hold surfaces of several instances: its indices belong to one solution. Ids
//! belong to the model. The id of a surface is made of the number of its triangle among those of all instances, hidden ones
//! included, of its side, and of its place in the quadtree. It is the same whether other instances move, hide or are removed;
//! instances that are added get numbers after all others. So light can be carried from one solution to the next.

use super::build::MAX_PLACED_LEVEL;
use super::{Elements, Shape};
use crate::scene::InstanceTriangles;
use std::ops::Range;

/// Bits of the place in the quadtree: a leading 1, then two for each subdivision. 35 bits are left for sides.
const PATH_BITS: u32 = 2 * MAX_PLACED_LEVEL + 1;

impl Elements {
    /// Number of instances, hidden ones included; 1 in scenes without placed meshes.
    pub fn instance_count(&self) -> u32 {
        self.instances.len() as u32
    }

    /// The root elements of an instance, which cover whole sides, in the order of their ids. None for hidden instances.
    pub fn of_instance(&self, instance: u32) -> impl Iterator<Item = u32> + '_ {
        let Range { start, end } = self.instances[instance as usize].triangles;
        (start..end).flat_map(move |t| {
            let sides = self.sides_of_triangle[t as usize].into_iter();
            // A quad is counted at its first triangle.
            let own =
                sides.filter_map(|s| self.sides.get(s as usize)).filter(move |side| side.triangles[0] == t);
            own.map(|side| side.element)
        })
    }

    /// The id of a surface of this instance, in scenes with placed meshes; `None` for clusters.
    pub fn surface_id(&self, instance: u32, element: u32) -> Option<u64> {
        let Shape::Surface { side, .. } = self.elements[element as usize].shape else { return None };
        let side = &self.sides[side as usize];
        let InstanceTriangles { triangles, first_number } = &self.instances[instance as usize];
        let number = first_number + u64::from(side.triangles[0] - triangles.start);
        let (mut e, mut path, mut level) = (element, 0, 0);
        while e != side.element {
            let parent = self.elements[e as usize].parent;
            path |= u64::from(e - self.elements[parent as usize].first_child) << (2 * level);
            (e, level) = (parent, level + 1);
        }
        Some((2 * number + u64::from(!side.front)) << PATH_BITS | 1 << (2 * level) | path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clusters;
    use crate::math::rows;
    use crate::model::{Detail, InstanceChange, Model, testing::model};
    use crate::scene::generate::{self, Spec};
    use crate::scene::{Placement, Scene};
    use glam::{DAffine3, DVec3, Vec3};
    use std::collections::BTreeMap;

    /// The scene of a model with its instances as they stand now; removed ones are hidden.
    fn copied(model: &Model) -> Scene {
        let mut scene = model.scene().clone();
        let placed = model.instances().iter().skip(1).map(|i| Placement {
            mesh: i.mesh - 1,
            transform: i.affine(),
            name: i.name.to_string(),
            material: i.material,
            visible: i.is_present(),
        });
        scene.placements = placed.collect();
        scene.flattened(u64::MAX).expect("copied")
    }

    /// Centres of all surfaces by id, for each instance. Large sides are split twice.
    fn surfaces(model: &Model) -> Vec<BTreeMap<u64, Vec3>> {
        let scene = copied(model);
        let mut elements = Elements::build(&scene, &clusters::build(&scene, &Default::default()), 1e-3, &[]);
        for e in 0..elements.len() as u32 {
            if !elements.elements[e as usize].is_cluster() && elements.can_open(e) {
                let first = elements.len() as u32;
                elements.split(e);
                elements.split(first + 2);
            }
        }
        let mut left = elements.sides.len();
        let found = (0..elements.instance_count()).map(|i| {
            let mut parts: Vec<u32> = elements.of_instance(i).collect();
            left -= parts.len();
            let mut by_id = BTreeMap::new();
            while let Some(e) = parts.pop() {
                let element = &elements.elements[e as usize];
                parts.extend(element.child_range().map(|c| c as u32));
                let id = elements.surface_id(i, e).expect("a surface");
                assert!(by_id.insert(id, element.centre).is_none(), "id {id} of instance {i} is not unique");
            }
            by_id
        });
        let found: Vec<BTreeMap<u64, Vec3>> = found.collect();
        assert_eq!(left, 0, "every side belongs to one instance");
        found
    }

    #[test]
    fn ids_stay_when_other_instances_change() {
        let spec = Spec { trees: 5, leaves: 40, instances: true, species: 2, ..Spec::new("forest") };
        let scene = generate::build(&spec).expect("a forest");
        let before = model(&scene, Detail::Rays);
        let away = DAffine3::from_translation(DVec3::new(0.7, 0.2, 0.1)) * before.instances()[2].affine();
        let away = rows(&away);
        let reference = surfaces(&before);
        assert_eq!(reference.len(), 6);
        assert!(reference.iter().all(|instance| instance.len() > 4));
        for change in [
            InstanceChange::Move { instance: 2, transform: away },
            InstanceChange::Show { instance: 2, visible: false },
            InstanceChange::Remove { instance: 2 },
            InstanceChange::Add(before.instances()[2].clone()),
        ] {
            let after = surfaces(&before.update(std::slice::from_ref(&change)).expect("an update"));
            for (i, (old, new)) in reference.iter().zip(&after).enumerate() {
                match (&change, i) {
                    (InstanceChange::Add(_), _) | (_, 0 | 1 | 3..) => assert_eq!(old, new, "{change:?}: {i}"),
                    (InstanceChange::Move { .. }, 2) => {
                        assert!(old.keys().eq(new.keys()), "the moved instance keeps its ids");
                        assert_ne!(old, new);
                    }
                    _ => assert!(new.is_empty(), "{change:?}"),
                }
            }
            assert_eq!(after.len(), 6 + usize::from(matches!(change, InstanceChange::Add(_))));
        }
    }
}
