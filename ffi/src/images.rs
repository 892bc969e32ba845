//! Pictures and lightmaps of a solution.

use super::arguments::{c_text, count_of, nth, slice_mut};
use super::call_progress::{mrv_progress, with_progress};
use super::entry::entry;
use super::handle::handle;
use super::record::record;
use super::scene::mrv_scene;
use super::solve::mrv_solution;
use mrvis::{Camera, ImageOptions, Lightmap};
use std::ffi::{CString, c_char, c_void};

record!(88: struct mrv_camera {
    struct_size: usize,
    eye: [f64; 3],
    target: [f64; 3],
    up: [f64; 3],
    angle: f64,
});

fn camera_record(camera: Camera) -> mrv_camera {
    let Camera { eye, target, up, angle } = camera;
    mrv_camera { struct_size: 0, eye, target, up, angle }
}

entry!(mrv_scene_get_camera(call, scene: Handle<mrv_scene>, index: u64) -> camera: RecordPlace<mrv_camera> {
    let all: Vec<Camera> = scene.scene.cameras().map(|(_, camera)| camera).collect();
    camera_record(*nth(&all, index, "the scene", "cameras")?)
});

entry!(mrv_solution_get_camera(call, solution: Handle<mrv_solution>) -> camera: RecordPlace<mrv_camera> {
    camera_record(solution.solution.automatic_camera()?)
});

record!(40: struct mrv_image_options {
    struct_size: usize,
    width: u32,
    height: u32,
    gather: i32,
    look_inside: i32,
    progress: mrv_progress,
    user: *mut c_void,
});

entry!(mrv_solution_image(
    call, solution: Handle<mrv_solution>, camera: Record<mrv_camera>, options: Given<mrv_image_options>,
    radiance: MutPointer<f32>, size: usize
) {
    let mut wanted = ImageOptions::default();
    (wanted.gather, wanted.look_inside) = (options.gather != 0, options.look_inside != 0);
    if (options.width, options.height) != (0, 0) {
        wanted.size = [options.width as usize, options.height as usize];
    }
    let from = Camera { eye: camera.eye, target: camera.target, up: camera.up, angle: camera.angle };
    // SAFETY: the caller gives room for `size` numbers.
    let radiance = unsafe { slice_mut(radiance, size, "radiance") }?;
    let draw = |progress| solution.solution.with_progress(progress).image(&from, &wanted, radiance);
    Ok(with_progress(call, options.progress, options.user, draw)??)
});

/// A lightmap and its note as C text.
pub struct NotedLightmap {
    map: Lightmap,
    note: Option<CString>,
}

handle!(mrv_lightmap(lightmap): NotedLightmap, mrv_lightmap_retain, mrv_lightmap_release);

record!(32: struct mrv_lightmap_options {
    struct_size: usize,
    texels: u64,
    progress: mrv_progress,
    user: *mut c_void,
});

/// Texels by default: an image of 1,024 by 1,024.
const TEXELS: usize = 1 << 20;

entry!(mrv_solution_lightmap(call, solution: Handle<mrv_solution>, options: Given<mrv_lightmap_options>) -> lightmap: Made<mrv_lightmap> {
    let texels = if options.texels == 0 { TEXELS } else { count_of(options.texels) };
    let draw = |progress| solution.solution.with_progress(progress).lightmap(texels);
    let map = with_progress(call, options.progress, options.user, draw)??;
    let note = map.note.as_deref().map(c_text);
    NotedLightmap { map, note }
});

record!(80: struct mrv_lightmap_arrays {
    struct_size: usize,
    width: u64,
    height: u64,
    irradiance: *const f32,
    vertices: u64,
    positions: *const f64,
    triangles: u64,
    corners: *const u32,
    texcoords: *const f32,
    note: *const c_char,
});

entry!(mrv_lightmap_get_arrays(call, lightmap: Handle<mrv_lightmap>) -> arrays: RecordPlace<mrv_lightmap_arrays> {
    let map = &lightmap.map;
    mrv_lightmap_arrays {
        struct_size: 0,
        width: map.width as u64,
        height: map.height as u64,
        irradiance: map.irradiance.as_ptr().cast(),
        vertices: map.positions.len() as u64,
        positions: map.positions.as_ptr().cast(),
        triangles: map.triangles.len() as u64,
        corners: map.triangles.as_ptr().cast(),
        texcoords: map.texcoords.as_ptr().cast(),
        note: lightmap.note.as_ref().map_or(std::ptr::null(), |note| note.as_ptr()),
    }
});
