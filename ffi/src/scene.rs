//! Scenes: reading, generating, adding a sky, and queries of their properties.

use super::arguments::{
    c_text, count_of, no_reserved, nth, one_of, optional_text, put_text, set, slice, texts, wrong,
};
use super::entry::entry;
use super::guard::Outcome;
use super::handle::handle;
use super::member_names::c_name;
use super::record::record;
use mrvis::internals::error::worded;
use mrvis::{Channels, GenerateOptions, LoadOptions, Scene, SkyOptions, Strength, UpAxis};
use std::ffi::{CString, c_char, c_void};
use std::path::Path;
use std::sync::{Arc, OnceLock};

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

handle!(mrv_scene(scene): NamedScene, mrv_scene_retain, mrv_scene_release);

record!(56: struct mrv_load_options {
    struct_size: usize,
    unit: *const c_char,
    emitters: *const *const c_char,
    emitter_watts: *const f64,
    emitter_count: usize,
    two_sided_emission: i32,
    sides: i32,
    threads: u32,
    reserved: u32,
    emitter_units: *const i32,
    luminaires: *const c_char,
    up: i32,
    channels: i32,
    max_memory: u64,
});

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

/// Strength of an emitter in this unit.
fn strength_of(value: f64, unit: i32) -> Outcome<Strength> {
    Ok(one_of!(
        "options.emitter_units",
        unit,
        MRV_POWER_WATTS => Strength::Watts(value),
        MRV_POWER_LUMENS => Strength::Lumens(value),
        MRV_POWER_LUMINANCE => Strength::Luminance(value),
    ))
}

/// The options of a caller.
///
/// # Safety
/// The record holds arrays and text as the header states.
pub unsafe fn load_options(given: &mrv_load_options) -> Outcome<LoadOptions> {
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
    options.up = one_of!(
        "options.up",
        given.up,
        MRV_UP_AUTOMATIC => None,
        MRV_UP_Y => Some(UpAxis::Y),
        MRV_UP_Z => Some(UpAxis::Z),
    );
    options.channels = one_of!(
        "options.channels",
        given.channels,
        MRV_CHANNELS_RGB => Channels::Rgb,
        MRV_CHANNELS_RED => Channels::Red,
        MRV_CHANNELS_GREEN => Channels::Green,
        MRV_CHANNELS_BLUE => Channels::Blue,
    );
    set(&mut options.max_memory, given.max_memory);
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

entry!(mrv_scene_load(call, path: Text, options: Given<mrv_load_options>) -> scene: Made<mrv_scene> {
    // SAFETY: the record holds arrays and text as the header states.
    let wanted = unsafe { load_options(&options) }?;
    NamedScene::new(Arc::new(Scene::load_with(path, &wanted)?))
});

entry!(mrv_scene_from_memory(
    call, data: Pointer<c_void>, size: usize, format: Text, folder: OptionalText, options: Given<mrv_load_options>
) -> scene: Made<mrv_scene> {
    // SAFETY: the caller gives `size` bytes, and a record of arrays and text.
    let (data, wanted) = unsafe { (slice(data.cast::<u8>(), size, "data")?, load_options(&options)?) };
    NamedScene::new(Arc::new(Scene::from_memory(data, format, folder.map(Path::new), &wanted)?))
});

entry!(mrv_scene_generate(call, name: Text) -> scene: Made<mrv_scene> {
    NamedScene::new(Arc::new(Scene::generate(name)?))
});

record!(56: struct mrv_generate_options {
    struct_size: usize,
    seed: u64,
    count: u64,
    trees: u64,
    leaves: u64,
    light_size: f64,
    trunks: i32,
    reserved: u32,
});

entry!(mrv_scene_generate_with(call, name: Text, options: Given<mrv_generate_options>) -> scene: Made<mrv_scene> {
    no_reserved(options.reserved, "options.reserved")?;
    let number = |n: u64| (n != 0).then(|| count_of(n));
    let mut wanted = GenerateOptions::default();
    set(&mut wanted.seed, options.seed);
    wanted.count = number(options.count);
    wanted.trees = number(options.trees);
    wanted.leaves = number(options.leaves);
    wanted.light_size = (options.light_size != 0.0).then_some(options.light_size);
    wanted.trunks = options.trunks != 0;
    NamedScene::new(Arc::new(Scene::generate_with(name, &wanted)?))
});

entry!(mrv_scene_flatten(call, scene: Handle<mrv_scene>, max_triangles: u64) -> flat: Made<mrv_scene> {
    let most = if max_triangles == 0 { u64::MAX } else { max_triangles };
    NamedScene::new(Arc::new(scene.scene.flattened(most)?))
});

record!(136: struct mrv_scene_info {
    struct_size: usize,
    triangles: u64,
    visible: u64,
    objects: u64,
    materials: u64,
    emitters: u64,
    repairs: u64,
    cameras: u64,
    low: [f64; 3],
    high: [f64; 3],
    origin: [f64; 3],
});

entry!(mrv_scene_get_info(call, scene: Handle<mrv_scene>) -> info: RecordPlace<mrv_scene_info> {
    let scene = &scene.scene;
    let [low, high] = scene.bounds();
    mrv_scene_info {
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
    }
});

pub const MRV_NAME_OBJECT: i32 = 0;
pub const MRV_NAME_MATERIAL: i32 = 1;
pub const MRV_NAME_EMITTER: i32 = 2;
pub const MRV_NAME_REPAIR: i32 = 3;
pub const MRV_NAME_CAMERA: i32 = 4;

entry!(mrv_scene_get_name(call, scene: Handle<mrv_scene>, kind: i32, index: u64) -> name: Place<*const c_char> {
    let all = scene.names.get_or_init(|| {
        let scene = &scene.scene;
        [
            scene.object_names().map(c_text).collect(),
            scene.material_names().map(c_text).collect(),
            scene.emitter_names().map(c_text).collect(),
            scene.parts().repairs.messages.iter().map(|note| c_text(&worded(note, c_name))).collect(),
            scene.cameras().map(|(name, _)| c_text(name)).collect(),
        ]
    });
    let list = one_of!(
        "kind",
        kind,
        MRV_NAME_OBJECT => &all[0],
        MRV_NAME_MATERIAL => &all[1],
        MRV_NAME_EMITTER => &all[2],
        MRV_NAME_REPAIR => &all[3],
        MRV_NAME_CAMERA => &all[4],
    );
    nth(list, index, "the scene", "names of this kind")?.as_ptr()
});

entry!(mrv_scene_get_unit(call, scene: Handle<mrv_scene>, text: MutPointer<c_char>, size: usize) {
    // SAFETY: the caller gives room for `size` bytes.
    unsafe { put_text(scene.scene.unit(), text, size, "text") }
});

entry!(mrv_scene_with_sky(
    call, scene: Handle<mrv_scene>, sky: OptionalText, sun: OptionalText, place: OptionalText, time: OptionalText
) -> lit: Made<mrv_scene> {
    let mut made = Scene::clone(&scene.scene);
    made.set_sky(&SkyOptions::of_texts(sky, sun, place, time)?)?;
    NamedScene::new(Arc::new(made))
});
