//! Scenes: read, generated, and what they say about themselves.

use super::arguments::{Place, c_text, no_reserved, optional_text, put_text, slice, text, texts, wrong};
use super::guard::{Outcome, guard, quiet};
use super::handle::{Opaque, give, object, release, retain};
use super::record::{RecordPlace, read_optional, record};
use super::status::mrv_status;
use mrvis::{Channels, GenerateOptions, LoadOptions, Scene, Strength, UpAxis};
use std::ffi::{CString, c_char, c_void};
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// A scene.
#[repr(C)]
pub struct mrv_scene {
    _opaque: [u8; 0],
}

/// A scene and its names as C text.
pub struct NamedScene {
    pub scene: Arc<Scene>,
    names: OnceLock<[Vec<CString>; 5]>,
}

impl NamedScene {
    pub fn new(scene: Arc<Scene>) -> NamedScene {
        NamedScene { scene, names: OnceLock::new() }
    }
}

impl Opaque for mrv_scene {
    const NAME: &'static str = "mrv_scene";
    type Value = NamedScene;
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
    pub emitter_units: *const i32,
    pub luminaires: *const c_char,
    pub up: i32,
    pub channels: i32,
    pub max_memory: u64,
}
record!(
    mrv_load_options: 56,
    struct_size, unit, emitters, emitter_watts, emitter_count, two_sided_emission, sides, threads,
    reserved, emitter_units, luminaires, up, channels, max_memory
);

pub const MRV_UP_AUTOMATIC: i32 = 0;
pub const MRV_UP_Y: i32 = 1;
pub const MRV_UP_Z: i32 = 2;

pub const MRV_CHANNELS_RGB: i32 = 0;
pub const MRV_CHANNELS_RED: i32 = 1;
pub const MRV_CHANNELS_GREEN: i32 = 2;
pub const MRV_CHANNELS_BLUE: i32 = 3;

pub const MRV_POWER_WATTS: i32 = 0;
pub const MRV_POWER_LUMENS: i32 = 1;
pub const MRV_POWER_LUMINANCE: i32 = 2;

/// An option that is one of a few numbers.
fn one_of<T: Copy>(name: &str, number: i32, all: &[(i32, &str, T)]) -> Outcome<T> {
    match all.iter().find(|(known, ..)| *known == number) {
        Some((.., value)) => Ok(*value),
        None => {
            let names: Vec<&str> = all.iter().map(|(_, name, _)| *name).collect();
            wrong(format!("`{name}` {number}: give one of {}", names.join(", ")))
        }
    }
}

/// What an emitter sends out, in this unit.
fn strength_of(value: f64, unit: i32) -> Outcome<Strength> {
    let in_unit: fn(f64) -> Strength = one_of(
        "options.emitter_units",
        unit,
        &[
            (MRV_POWER_WATTS, "MRV_POWER_WATTS", Strength::Watts as fn(f64) -> Strength),
            (MRV_POWER_LUMENS, "MRV_POWER_LUMENS", Strength::Lumens),
            (MRV_POWER_LUMINANCE, "MRV_POWER_LUMINANCE", Strength::Luminance),
        ],
    )?;
    Ok(in_unit(value))
}

/// The options of a caller.
///
/// # Safety
/// `options` is NULL or a record, with arrays and text as the header says.
pub unsafe fn load_options(options: *const mrv_load_options) -> Outcome<LoadOptions> {
    // SAFETY: as for this function.
    let given = unsafe { read_optional(options, "options") }?;
    no_reserved(given.reserved, "options.reserved")?;
    let mut options = LoadOptions::default();
    options.two_sided_emission = given.two_sided_emission != 0;
    options.threads = given.threads as usize;
    // SAFETY: as for this function.
    if let Some(unit) = unsafe { optional_text(given.unit, "options.unit") }? {
        options.unit = unit.into();
    }
    // SAFETY: as for this function.
    let names = unsafe { texts(given.emitters, given.emitter_count, "options.emitters") }?;
    // SAFETY: as for this function.
    let watts = unsafe { slice(given.emitter_watts, given.emitter_count, "options.emitter_watts") }?;
    let counted = if given.emitter_units.is_null() { 0 } else { given.emitter_count };
    // SAFETY: as for this function.
    let units = unsafe { slice(given.emitter_units, counted, "options.emitter_units") }?;
    for (i, (name, &strength)) in names.into_iter().zip(watts).enumerate() {
        let unit = units.get(i).copied().unwrap_or(MRV_POWER_WATTS);
        options.emitters.push((name.into(), strength_of(strength, unit)?));
    }
    let up = [
        (MRV_UP_AUTOMATIC, "MRV_UP_AUTOMATIC", None),
        (MRV_UP_Y, "MRV_UP_Y", Some(UpAxis::Y)),
        (MRV_UP_Z, "MRV_UP_Z", Some(UpAxis::Z)),
    ];
    if let Some(up) = one_of("options.up", given.up, &up)? {
        options.up = Some(up);
    }
    options.channels = one_of(
        "options.channels",
        given.channels,
        &[
            (MRV_CHANNELS_RGB, "MRV_CHANNELS_RGB", Channels::Rgb),
            (MRV_CHANNELS_RED, "MRV_CHANNELS_RED", Channels::Red),
            (MRV_CHANNELS_GREEN, "MRV_CHANNELS_GREEN", Channels::Green),
            (MRV_CHANNELS_BLUE, "MRV_CHANNELS_BLUE", Channels::Blue),
        ],
    )?;
    if given.max_memory != 0 {
        options.max_memory = Some(given.max_memory);
    }
    // SAFETY: as for this function.
    if let Some(placements) = unsafe { optional_text(given.luminaires, "options.luminaires") }? {
        options = options.with_luminaires(placements)?;
    }
    options.sides = match u8::try_from(given.sides) {
        Ok(0) => None,
        Ok(sides @ 1..=2) => Some(sides),
        _ => return wrong(format!("`options.sides` {}: give 0, 1 or 2", given.sides)),
    };
    Ok(options)
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
        unsafe { place.set(give(NamedScene::new(Arc::new(scene)))) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_scene_from_memory(
    data: *const c_void,
    size: usize,
    format: *const c_char,
    folder: *const c_char,
    options: *const mrv_load_options,
    scene: *mut *mut mrv_scene,
) -> mrv_status {
    guard("mrv_scene_from_memory", |_| {
        // SAFETY: the caller gives `size` bytes, texts and a record.
        let (data, format, folder, options) = unsafe {
            (
                slice(data.cast::<u8>(), size, "data")?,
                text(format, "format")?,
                optional_text(folder, "folder")?,
                load_options(options)?,
            )
        };
        let place = Place::of(scene, "scene")?;
        let scene = Scene::from_memory(data, format, folder.map(Path::new), &options)?;
        // SAFETY: the caller gives a place.
        unsafe { place.set(give(NamedScene::new(Arc::new(scene)))) };
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
        unsafe { place.set(give(NamedScene::new(Arc::new(scene)))) };
        Ok(())
    })
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_generate_options {
    pub struct_size: usize,
    pub seed: u64,
    pub count: u64,
    pub trees: u64,
    pub leaves: u64,
    pub light_size: f64,
    pub trunks: i32,
    pub reserved: u32,
}
record!(mrv_generate_options: 56, struct_size, seed, count, trees, leaves, light_size, trunks, reserved);

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_scene_generate_with(
    name: *const c_char,
    options: *const mrv_generate_options,
    scene: *mut *mut mrv_scene,
) -> mrv_status {
    guard("mrv_scene_generate_with", |_| {
        // SAFETY: the caller gives text and a record.
        let (name, given) = unsafe { (text(name, "name")?, read_optional(options, "options")?) };
        no_reserved(given.reserved, "options.reserved")?;
        let place = Place::of(scene, "scene")?;
        let number = |n: u64| (n != 0).then(|| usize::try_from(n).unwrap_or(usize::MAX));
        let mut options = GenerateOptions::default();
        if given.seed != 0 {
            options.seed = given.seed;
        }
        options.count = number(given.count);
        options.trees = number(given.trees);
        options.leaves = number(given.leaves);
        options.light_size = (given.light_size != 0.0).then_some(given.light_size);
        options.trunks = given.trunks != 0;
        let scene = Scene::generate_with(name, &options)?;
        // SAFETY: the caller gives a place.
        unsafe { place.set(give(NamedScene::new(Arc::new(scene)))) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_scene_flatten(
    scene: *const mrv_scene,
    max_triangles: u64,
    flat: *mut *mut mrv_scene,
) -> mrv_status {
    guard("mrv_scene_flatten", |call| {
        let scene = object(call, scene, "scene")?;
        let place = Place::of(flat, "flat")?;
        let made = scene.scene.flattened(if max_triangles == 0 { u64::MAX } else { max_triangles })?;
        // SAFETY: the caller gives a place.
        unsafe { place.set(give(NamedScene::new(Arc::new(made)))) };
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

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_scene_info {
    pub struct_size: usize,
    pub triangles: u64,
    pub visible: u64,
    pub objects: u64,
    pub materials: u64,
    pub emitters: u64,
    pub repairs: u64,
    pub cameras: u64,
    pub low: [f64; 3],
    pub high: [f64; 3],
    pub origin: [f64; 3],
}
record!(
    mrv_scene_info: 136,
    struct_size, triangles, visible, objects, materials, emitters, repairs, cameras, low, high, origin
);

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_scene_get_info(
    scene: *const mrv_scene,
    info: *mut mrv_scene_info,
) -> mrv_status {
    guard("mrv_scene_get_info", |call| {
        let scene = &object(call, scene, "scene")?.scene;
        // SAFETY: the caller gives a record.
        let place = unsafe { RecordPlace::of(info, "info") }?;
        let [low, high] = scene.bounds();
        let info = mrv_scene_info {
            struct_size: 0,
            triangles: scene.triangle_count() as u64,
            visible: scene.visible_triangle_count(),
            objects: scene.object_names().len() as u64,
            materials: scene.material_names().len() as u64,
            emitters: scene.emitter_names().len() as u64,
            repairs: scene.repairs().len() as u64,
            cameras: scene.cameras().len() as u64,
            low,
            high,
            origin: scene.origin(),
        };
        // SAFETY: as above.
        unsafe { place.set(info) };
        Ok(())
    })
}

pub const MRV_NAME_OBJECT: i32 = 0;
pub const MRV_NAME_MATERIAL: i32 = 1;
pub const MRV_NAME_EMITTER: i32 = 2;
pub const MRV_NAME_REPAIR: i32 = 3;
pub const MRV_NAME_CAMERA: i32 = 4;

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_scene_get_name(
    scene: *const mrv_scene,
    kind: i32,
    index: u64,
    name: *mut *const c_char,
) -> mrv_status {
    guard("mrv_scene_get_name", |call| {
        let scene = object(call, scene, "scene")?;
        let place = Place::of(name, "name")?;
        let all = scene.names.get_or_init(|| {
            let scene = &scene.scene;
            [
                scene.object_names().map(c_text).collect(),
                scene.material_names().map(c_text).collect(),
                scene.emitter_names().map(c_text).collect(),
                scene.repairs().iter().map(|text| c_text(text)).collect(),
                scene.cameras().map(|(name, _)| c_text(name)).collect(),
            ]
        });
        let list = match kind {
            MRV_NAME_OBJECT => &all[0],
            MRV_NAME_MATERIAL => &all[1],
            MRV_NAME_EMITTER => &all[2],
            MRV_NAME_REPAIR => &all[3],
            MRV_NAME_CAMERA => &all[4],
            _ => return wrong(format!("`kind` {kind}: give one of MRV_NAME_OBJECT to MRV_NAME_CAMERA")),
        };
        let Some(text) = usize::try_from(index).ok().and_then(|i| list.get(i)) else {
            return wrong(format!("`index` {index}: the scene has {} names of this kind", list.len()));
        };
        // SAFETY: the caller gives a place.
        unsafe { place.set(text.as_ptr()) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_scene_get_unit(
    scene: *const mrv_scene,
    text: *mut c_char,
    size: usize,
) -> mrv_status {
    guard("mrv_scene_get_unit", |call| {
        let scene = object(call, scene, "scene")?;
        // SAFETY: the caller gives room for `size` bytes.
        unsafe { put_text(scene.scene.unit(), text, size, "text") }
    })
}
