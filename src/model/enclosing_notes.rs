//! Notes of emitters that an object encloses, and of those that enclose all else.

use super::Model;
use crate::embree::Hits;
use crate::error::quote;
use crate::math::Aabb;
use crate::ray::LANES;
use crate::scene::Emitter;
use glam::Vec3;
use rayon::prelude::*;

/// Distance by which surfaces may lie outside the bounds of a dome, as ground at its foot, relative to their diagonal.
const DOME_MARGIN: f32 = 0.01;

/// Distance up to which an object encloses an emitter as a bulb does, relative to the scene's diagonal: that of rooms is more.
const ENCLOSED: f32 = 0.02;

impl Model {
    /// A note if all light of emitters ends on one small object around them, as that of a lamp inside of an opaque bulb does.
    pub(super) fn note_of_enclosed_emitters(&self) -> Option<String> {
        let scene = self.scene();
        let small = ENCLOSED * self.bounds().diagonal();
        let enclosed = |emitter: &&Emitter| {
            let (packets, hits) = self.rays_of_emitter(emitter, 1.0);
            let mut around = None;
            for (packet, hits) in packets.iter().zip(&hits) {
                for lane in 0..LANES {
                    let triangle = hits.triangle[lane];
                    let way = hits.t[lane] * (packet.point(lane, 1.0) - packet.point(lane, 0.0)).length();
                    if triangle == Hits::NOTHING || hits.instance[lane] != 0 || way > small {
                        return None;
                    }
                    let object = scene.triangle_object[triangle as usize];
                    if emitter.triangles.binary_search(&triangle).is_ok()
                        || *around.get_or_insert(object) != object
                    {
                        return None;
                    }
                }
            }
            around
        };
        let found = |emitter| enclosed(&emitter).map(|around| (emitter, around));
        let found: Vec<(&Emitter, u32)> = self.tested_emitters().into_par_iter().filter_map(found).collect();
        if found.is_empty() {
            return None;
        }
        let mut bounds = vec![Aabb::EMPTY; scene.objects.len()];
        for (t, &object) in (0..).zip(&scene.triangle_object) {
            let own = &mut bounds[object as usize];
            *own = own.union(Aabb::of(scene.corners(t)));
        }
        // A floor below a lamp is larger than what is that near all around it, and so is one below a luminous ceiling.
        let is_around = |&&(emitter, around): &&(&Emitter, u32)| {
            let lamp = Aabb::of(emitter.triangles.iter().flat_map(|&t| scene.corners(t)));
            lamp.diagonal() <= 2.0 * small
                && bounds[around as usize].diagonal() <= lamp.diagonal() + 2.0 * small
        };
        let found: Vec<&(&Emitter, u32)> = found.iter().filter(is_around).collect();
        let &&(first, around) = found.first()?;
        let object = scene.object_names().nth(around as usize).unwrap_or_default();
        let more = if found.len() > 1 { format!(" (and {} more)", found.len() - 1) } else { String::new() };
        Some(format!(
            "the emitter `{}`{more} is enclosed by `{}`, which is opaque: its light does not get out; remove that object, make it \
             transparent, or move the emitter",
            quote(&first.name),
            quote(object)
        ))
    }

    /// A note if an emitter stands around all else under a sky: a dome of faces that stood for a sky before, which hides it.
    pub(super) fn note_of_dome(&self) -> Option<String> {
        let scene = self.scene();
        scene.environment.as_ref()?;
        let bounds = |triangles: &[u32]| Aabb::of(triangles.iter().flat_map(|&t| scene.corners(t)));
        let mut emits = vec![false; scene.triangles.len()];
        scene.emitters.iter().flat_map(|e| &e.triangles).for_each(|&t| emits[t as usize] = true);
        let others: Vec<u32> = (0..emits.len() as u32).filter(|&t| !emits[t as usize]).collect();
        let others = bounds(&others);
        let margin = Vec3::splat(DOME_MARGIN * others.diagonal());
        let encloses = |emitter: &&&Emitter| {
            let Aabb { min, max } = bounds(&emitter.triangles);
            min.cmple(others.min + margin).all() && max.cmpge(others.max - margin).all()
        };
        let flat = others.extent().min_element() <= margin.x;
        let dome = self.tested_emitters();
        let dome = dome.iter().filter(|_| !flat).find(encloses)?;
        Some(format!(
            "the emitter `{}` encloses all other surfaces, as a dome that stands for a sky does: the light of the sky and the sun ends on its \
             outside; remove it, or do without `sky` and `sun`",
            quote(&dome.name)
        ))
    }
}
