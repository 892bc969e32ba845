//! Sky and sun.

use super::arguments::{Place, optional_text};
use super::guard::guard;
use super::handle::{give, object};
use super::scene::{NamedScene, mrv_scene};
use super::status::mrv_status;
use mrvis::{Scene, SkyOptions};
use std::ffi::c_char;
use std::sync::Arc;

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_scene_with_sky(
    scene: *const mrv_scene,
    sky: *const c_char,
    sun: *const c_char,
    place: *const c_char,
    time: *const c_char,
    lit: *mut *mut mrv_scene,
) -> mrv_status {
    guard("mrv_scene_with_sky", |call| {
        let scene = object(call, scene, "scene")?;
        // SAFETY: the caller gives texts that end with a zero, or NULL.
        let [sky, sun, place, time] = unsafe {
            [
                optional_text(sky, "sky")?,
                optional_text(sun, "sun")?,
                optional_text(place, "place")?,
                optional_text(time, "time")?,
            ]
        };
        // SAFETY: the caller gives a place.
        let into = unsafe { Place::of(lit, "lit") }?;
        let mut made = Scene::clone(&scene.scene);
        made.set_sky(&SkyOptions::of_texts(sky, sun, place, time)?)?;
        into.set(give(NamedScene::new(Arc::new(made))))
    })
}
