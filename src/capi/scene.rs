//! Scenes: read, generated, and what they say about themselves.

use super::arguments::{Place, no_reserved, optional_text, slice, text, texts};
use super::guard::{Outcome, guard, quiet};
use super::handle::{Opaque, give, release, retain};
use super::record::{read_optional, record};
use super::status::mrv_status;
use crate::scene::{LoadOptions, Scene};
use std::ffi::c_char;
use std::sync::Arc;

/// A scene.
#[repr(C)]
pub struct mrv_scene {
    _opaque: [u8; 0],
}

impl Opaque for mrv_scene {
    const NAME: &'static str = "mrv_scene";
    type Value = Arc<Scene>;
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_load_options {
    pub struct_size: usize,
    pub unit: *const c_char,
    pub emitters: *const *const c_char,
    pub emitter_watts: *const f64,
    pub emitter_count: usize,
    pub two_sided_emission: i32,
    pub sides: i32,
    pub threads: u32,
    pub reserved: u32,
}
record!(mrv_load_options: 56, struct_size, unit, emitters, emitter_watts, emitter_count, two_sided_emission, sides, threads, reserved);

/// The options of a caller.
///
/// # Safety
/// `options` is NULL or a record, with arrays and text as the header says.
unsafe fn load_options(options: *const mrv_load_options) -> Outcome<LoadOptions> {
    // SAFETY: as for this function.
    let given = unsafe { read_optional(options, "options") }?;
    no_reserved(given.reserved)?;
    let mut options = LoadOptions::default()
        .with_two_sided_emission(given.two_sided_emission != 0)
        .with_threads(given.threads as usize);
    // SAFETY: as for this function.
    if let Some(unit) = unsafe { optional_text(given.unit, "options.unit") }? {
        options = options.with_unit(unit);
    }
    // SAFETY: as for this function.
    let names = unsafe { texts(given.emitters, given.emitter_count, "options.emitters") }?;
    // SAFETY: as for this function.
    let watts = unsafe { slice(given.emitter_watts, given.emitter_count, "options.emitter_watts") }?;
    for (name, &watts) in names.into_iter().zip(watts) {
        options = options.with_emitter(name, watts);
    }
    match given.sides {
        0 => Ok(options),
        // The crate refuses numbers other than 1 and 2 by name and value.
        sides => Ok(options.with_sides(u8::try_from(sides).unwrap_or(u8::MAX))),
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_scene_load(
    path: *const c_char,
    options: *const mrv_load_options,
    scene: *mut *mut mrv_scene,
) -> mrv_status {
    guard("mrv_scene_load", |_| {
        // SAFETY: the caller gives text, a record and a place, as the header says.
        let (path, options) = unsafe { (text(path, "path")?, load_options(options)?) };
        let place = Place::of(scene, "scene")?;
        let scene = Scene::load_with(path, &options)?;
        // SAFETY: as above.
        unsafe { place.set(give(Arc::new(scene))) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_scene_generate(name: *const c_char, scene: *mut *mut mrv_scene) -> mrv_status {
    guard("mrv_scene_generate", |_| {
        // SAFETY: the caller gives text and a place.
        let name = unsafe { text(name, "name") }?;
        let place = Place::of(scene, "scene")?;
        let scene = Scene::generate(name)?;
        // SAFETY: as above.
        unsafe { place.set(give(Arc::new(scene))) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_scene_retain(scene: *const mrv_scene) -> mrv_status {
    guard("mrv_scene_retain", |call| retain(call, scene, "scene"))
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_scene_release(scene: *const mrv_scene) {
    quiet((), || release(scene));
}
