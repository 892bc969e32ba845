//! The objects of a scene that segments between receivers and emitters can meet.

use mrvis::Scene;
use mrvis::internals::SceneParts;
use mrvis::internals::bench::receivers::ReceiverGrid;
use mrvis::internals::math::Aabb;
use std::sync::Arc;

/// Part of the scene's size by which objects may miss a shaft: above rounding errors.
const SLACK: f32 = 1e-4;

/// The scene without the objects that block no segment between these texels and the emitters: its answers are the same. Its bounds are
/// those of the whole, so that lengths relative to them do not change. Scenes with placements stay whole.
pub fn part_between(scene: &Arc<Scene>, receivers: &[ReceiverGrid]) -> Arc<Scene> {
    if !scene.parts().placements.is_empty() {
        return scene.clone();
    }
    let box_of = |faces: &mut dyn Iterator<Item = u32>| Aabb::of(faces.flat_map(|t| scene.corners(t)));
    let mut objects = vec![Aabb::EMPTY; scene.parts().objects.len()];
    for (t, &object) in (0u32..).zip(scene.parts().triangle_object) {
        objects[object as usize] = objects[object as usize].union(box_of(&mut std::iter::once(t)));
    }
    let emitters: Vec<Aabb> =
        scene.parts().emitters.iter().map(|emitter| box_of(&mut emitter.triangles.iter().copied())).collect();
    let points = |r: &ReceiverGrid| Aabb::of(r.points.iter().map(|point| point.position));
    let from: Vec<Aabb> = receivers.iter().map(points).collect();
    let slack = SLACK * scene.size();
    let is_met =
        |object: &Aabb| from.iter().any(|a| emitters.iter().any(|b| meets([*a, *b], *object, slack)));
    let met: Vec<bool> = objects.iter().map(is_met).collect();
    Arc::new(scene.with_objects(&met))
}

/// Whether the convex hull of two boxes, which is all boxes between them, meets a third one.
fn meets([a, b]: [Aabb; 2], other: Aabb, slack: f32) -> bool {
    let (mut first, mut last) = (0.0f32, 1.0f32);
    // Where p + (q − p) t ≤ limit.
    let mut at_most = |p: f32, q: f32, limit: f32| {
        let t = (limit - p) / (q - p);
        match q - p {
            slope if slope > 0.0 => last = last.min(t),
            slope if slope < 0.0 => first = first.max(t),
            _ if p > limit => last = -1.0,
            _ => {}
        }
    };
    for axis in 0..3 {
        at_most(a.min[axis], b.min[axis], other.max[axis] + slack);
        at_most(-a.max[axis], -b.max[axis], slack - other.min[axis]);
    }
    first <= last
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reproduce::shadow::Grid;
    use glam::Vec3;
    use mrvis::internals::ModelParts;
    use mrvis::internals::scene::generate::{self, Spec};
    use mrvis::{Detail, Model, PrepareOptions};

    fn cube(centre: Vec3, half: f32) -> Aabb {
        Aabb { min: centre - half, max: centre + half }
    }

    #[test]
    fn a_shaft_meets_what_lies_between_its_ends() {
        let ends = [cube(Vec3::ZERO, 1.0), cube(10.0 * Vec3::X, 2.0)];
        for (centre, is_met) in [
            (Vec3::new(5.0, 1.9, 0.0), true),
            (Vec3::new(5.0, 2.3, 0.0), false),
            (Vec3::new(-2.0, 0.0, 0.0), false),
            (Vec3::new(12.4, 0.0, 0.0), true),
            (Vec3::new(12.6, 0.0, 0.0), false),
        ] {
            assert_eq!(meets(ends, cube(centre, 0.5), 0.0), is_met, "{centre}");
        }
    }

    /// In the corner of an office most objects are left out, and the shadows are those of all.
    #[test]
    fn objects_that_are_left_out_do_not_block() {
        let scene = Arc::new(generate::build(&Spec::new("office")).expect("an office"));
        let options = PrepareOptions::default().with_detail(Detail::Rays);
        let whole = Model::prepare(scene.clone(), &options, &()).expect("a model");
        let surfaces = mrvis::internals::bench::receivers::choose(&whole, &whole.exact(), &["floor".into()])
            .expect("a floor");
        let receivers = surfaces.maps((&whole, &whole.exact()), 12, 0.1);
        let part = part_between(&scene, &receivers);
        assert!(
            4 * part.parts().triangles.len() < 3 * scene.parts().triangles.len(),
            "{}",
            part.parts().triangles.len()
        );
        let image = |model: &Model| {
            let r = &receivers[0];
            let grid = Grid::new(model, r.points.clone(), [r.width, r.height], r.texel);
            grid.by_rays(16, 0, 1).expect("an image").image.data().to_vec()
        };
        let part = Model::prepare(part, &options, &()).expect("a model");
        assert_eq!(image(&whole), image(&part));
    }
}
