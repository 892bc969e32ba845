//! Pictures and lightmaps of a solution.

use super::arguments::{Place, c_text, slice_mut, wrong};
use super::call_progress::{mrv_progress, with_progress};
use super::guard::{guard, quiet};
use super::handle::{Opaque, give, object, release, retain};
use super::record::{RecordPlace, read, read_optional, record};
use super::scene::mrv_scene;
use super::solve::mrv_solution;
use super::status::mrv_status;
use mrvis::{Camera, ImageOptions, Lightmap};
use std::ffi::{CString, c_char, c_void};

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_camera {
    pub struct_size: usize,
    pub eye: [f64; 3],
    pub target: [f64; 3],
    pub up: [f64; 3],
    pub angle: f64,
}
record!(mrv_camera: 88, struct_size, eye, target, up, angle);

fn camera_record(camera: Camera) -> mrv_camera {
    let Camera { eye, target, up, angle } = camera;
    mrv_camera { struct_size: 0, eye, target, up, angle }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_scene_get_camera(
    scene: *const mrv_scene,
    index: u64,
    camera: *mut mrv_camera,
) -> mrv_status {
    guard("mrv_scene_get_camera", |call| {
        let scene = &object(call, scene, "scene")?.scene;
        // SAFETY: the caller gives a record.
        let place = unsafe { RecordPlace::of(camera, "camera") }?;
        let mut cameras = scene.cameras();
        let count = cameras.len();
        let Some((_, camera)) = usize::try_from(index).ok().and_then(|i| cameras.nth(i)) else {
            return wrong(format!("`index` {index}: the scene has {count} cameras"));
        };
        // SAFETY: as above.
        unsafe { place.set(camera_record(camera)) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_solution_get_camera(
    solution: *const mrv_solution,
    camera: *mut mrv_camera,
) -> mrv_status {
    guard("mrv_solution_get_camera", |call| {
        let solution = &object(call, solution, "solution")?.solution;
        // SAFETY: the caller gives a record.
        let place = unsafe { RecordPlace::of(camera, "camera") }?;
        let camera = solution.automatic_camera()?;
        // SAFETY: as above.
        unsafe { place.set(camera_record(camera)) };
        Ok(())
    })
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_image_options {
    pub struct_size: usize,
    pub width: u32,
    pub height: u32,
    pub gather: i32,
    pub look_inside: i32,
    pub progress: mrv_progress,
    pub user: *mut c_void,
}
record!(mrv_image_options: 40, struct_size, width, height, gather, look_inside, progress, user);

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_solution_image(
    solution: *const mrv_solution,
    camera: *const mrv_camera,
    options: *const mrv_image_options,
    radiance: *mut f32,
    size: usize,
) -> mrv_status {
    guard("mrv_solution_image", |call| {
        let solution = &object(call, solution, "solution")?.solution;
        // SAFETY: the caller gives records.
        let (from, given) = unsafe { (read(camera, "camera")?, read_optional(options, "options")?) };
        let mut options = ImageOptions::default();
        (options.gather, options.look_inside) = (given.gather != 0, given.look_inside != 0);
        if (given.width, given.height) != (0, 0) {
            options.size = [given.width as usize, given.height as usize];
        }
        let camera = Camera { eye: from.eye, target: from.target, up: from.up, angle: from.angle };
        // SAFETY: the caller gives room for `size` numbers.
        let radiance = unsafe { slice_mut(radiance, size, "radiance") }?;
        let draw = |progress| solution.with_progress(progress).image(&camera, &options, radiance);
        Ok(with_progress(call, given.progress, given.user, draw)??)
    })
}

/// A lightmap.
#[repr(C)]
pub struct mrv_lightmap {
    _opaque: [u8; 0],
}

/// A lightmap and its note as C text.
pub struct NotedLightmap {
    map: Lightmap,
    note: Option<CString>,
}

impl Opaque for mrv_lightmap {
    const NAME: &'static str = "mrv_lightmap";
    type Value = NotedLightmap;
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_lightmap_options {
    pub struct_size: usize,
    pub texels: u64,
    pub progress: mrv_progress,
    pub user: *mut c_void,
}
record!(mrv_lightmap_options: 32, struct_size, texels, progress, user);

/// Texels by default: an image of 1,024 by 1,024.
const TEXELS: usize = 1 << 20;

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_solution_lightmap(
    solution: *const mrv_solution,
    options: *const mrv_lightmap_options,
    lightmap: *mut *mut mrv_lightmap,
) -> mrv_status {
    guard("mrv_solution_lightmap", |call| {
        let solution = &object(call, solution, "solution")?.solution;
        // SAFETY: the caller gives a record.
        let given = unsafe { read_optional(options, "options") }?;
        let place = Place::of(lightmap, "lightmap")?;
        let texels =
            if given.texels == 0 { TEXELS } else { usize::try_from(given.texels).unwrap_or(usize::MAX) };
        let draw = |progress| solution.with_progress(progress).lightmap(texels);
        let map = with_progress(call, given.progress, given.user, draw)??;
        let note = map.note.as_deref().map(c_text);
        // SAFETY: the caller gives a place.
        unsafe { place.set(give(NotedLightmap { map, note })) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_lightmap_retain(lightmap: *const mrv_lightmap) -> mrv_status {
    guard("mrv_lightmap_retain", |call| retain(call, lightmap, "lightmap"))
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_lightmap_release(lightmap: *const mrv_lightmap) {
    quiet((), || release(lightmap));
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_lightmap_arrays {
    pub struct_size: usize,
    pub width: u64,
    pub height: u64,
    pub irradiance: *const f32,
    pub vertices: u64,
    pub positions: *const f64,
    pub triangles: u64,
    pub corners: *const u32,
    pub texcoords: *const f32,
    pub note: *const c_char,
}
record!(
    mrv_lightmap_arrays: 80,
    struct_size, width, height, irradiance, vertices, positions, triangles, corners, texcoords, note
);

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_lightmap_get_arrays(
    lightmap: *const mrv_lightmap,
    arrays: *mut mrv_lightmap_arrays,
) -> mrv_status {
    guard("mrv_lightmap_get_arrays", |call| {
        let lightmap = object(call, lightmap, "lightmap")?;
        // SAFETY: the caller gives a record.
        let place = unsafe { RecordPlace::of(arrays, "arrays") }?;
        let map = &lightmap.map;
        let arrays = mrv_lightmap_arrays {
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
        };
        // SAFETY: as above.
        unsafe { place.set(arrays) };
        Ok(())
    })
}
