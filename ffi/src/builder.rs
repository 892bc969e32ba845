//! Scenes from arrays.

use super::arguments::{no_reserved, slice, text, wrong};
use super::entry::entry;
use super::guard::Outcome;
use super::handle::handle;
use super::record::record;
use super::scene::{NamedScene, load_options, mrv_load_options, mrv_scene};
use super::update::rows_of;
use mrvis::{MeshArrays, Positions, SceneBuilder, Strided};
use std::ffi::c_char;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

handle!(mrv_scene_builder(builder): Mutex<SceneBuilder>, mrv_scene_builder_retain, mrv_scene_builder_release);

/// Access to a builder. After a panic the handle is refused already.
fn open(builder: &Mutex<SceneBuilder>) -> MutexGuard<'_, SceneBuilder> {
    builder.lock().unwrap_or_else(PoisonError::into_inner)
}

record!(96: struct mrv_mesh {
    struct_size: usize,
    name: *const c_char,
    positions: *const f32,
    positions_f64: *const f64,
    position_stride: usize,
    vertex_count: usize,
    indices: *const u32,
    index_count: usize,
    polygon_sizes: *const u32,
    polygon_count: usize,
    face_materials: *const u32,
    material: u32,
    reserved: u32,
});

/// The mesh of a caller.
///
/// # Safety
/// The record holds arrays and text as the header states.
unsafe fn mesh_of<'a>(given: &mrv_mesh) -> Outcome<MeshArrays<'a>> {
    no_reserved(given.reserved, "mesh.reserved")?;
    let (stride, count) = (given.position_stride, given.vertex_count);
    let positions = match (given.positions.is_null(), given.positions_f64.is_null()) {
        (false, true) => {
            // SAFETY: as for this function.
            Positions::F32(unsafe { strided(given.positions, stride, count, "mesh.positions") }?)
        }
        (true, false) => {
            // SAFETY: as for this function.
            Positions::F64(unsafe { strided(given.positions_f64, stride, count, "mesh.positions_f64") }?)
        }
        (true, true) => return wrong("`mesh.positions` is NULL: give it or `mesh.positions_f64`".into()),
        (false, false) => {
            return wrong("`mesh.positions` and `mesh.positions_f64` are given: give one".into());
        }
    };
    // SAFETY: as for this function.
    let (name, indices) =
        unsafe { (text(given.name, "mesh.name")?, slice(given.indices, given.index_count, "mesh.indices")?) };
    let mut mesh = MeshArrays::new(name, positions, indices).material(given.material);
    let mut polygons = given.index_count / 3;
    if !given.polygon_sizes.is_null() {
        polygons = given.polygon_count;
        // SAFETY: as for this function.
        mesh = mesh.polygon_sizes(unsafe { slice(given.polygon_sizes, polygons, "mesh.polygon_sizes") }?);
    } else if given.polygon_count != 0 && given.polygon_count != polygons {
        return wrong(format!(
            "`mesh.polygon_count` {}: must be {polygons}, the number of triangles; for polygons give `mesh.polygon_sizes`",
            given.polygon_count
        ));
    }
    if !given.face_materials.is_null() {
        // SAFETY: as for this function.
        mesh = mesh.face_materials(unsafe { slice(given.face_materials, polygons, "mesh.face_materials") }?);
    }
    Ok(mesh)
}

/// Positions of the caller at a stride in bytes.
///
/// # Safety
/// The array holds `count` positions at this stride.
unsafe fn strided<'a, T: Copy>(
    pointer: *const T,
    stride: usize,
    count: usize,
    name: &str,
) -> Outcome<Strided<'a, T>> {
    let size = size_of::<T>();
    let numbers = if stride == 0 { 3 } else { stride / size };
    if !stride.is_multiple_of(size) || numbers < 3 {
        return wrong(format!(
            "`mesh.position_stride` {stride}: must be 0 (packed) or a multiple of {size} bytes, at least {}",
            3 * size
        ));
    }
    let length = count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(numbers)?.checked_add(3));
    let Some(length) = length else {
        return wrong(format!("`mesh.vertex_count` {count} with a stride of {stride} is larger than memory"));
    };
    // SAFETY: as for this function.
    Ok(Strided::new(unsafe { slice(pointer, length, name) }?, numbers, count)?)
}

entry!(mrv_scene_builder_create(call) -> builder: Made<mrv_scene_builder> {
    Mutex::default()
});

entry!(mrv_scene_builder_add_material(
    call, builder: MutHandle<mrv_scene_builder>, name: Text, reflectance: Pointer<f32>, emission: Pointer<f32>,
    index: OptionalPlace<u32>
) {
    let rgb = |pointer: *const f32, name: &str, otherwise: f32| match pointer.is_null() {
        true => Ok([otherwise; 3]),
        // SAFETY: the caller gives three numbers.
        false => unsafe { slice(pointer.cast::<[f32; 3]>(), 1, name) }.map(|rgb| rgb[0]),
    };
    let (reflectance, emission) =
        (rgb(reflectance, "reflectance", 0.5)?, rgb(emission, "emission", 0.0)?);
    index.set(open(&builder).add_material(name, reflectance, emission)?)
});

entry!(mrv_scene_builder_add_object(call, builder: MutHandle<mrv_scene_builder>, mesh: Record<mrv_mesh>) {
    // SAFETY: the record holds arrays and text as the header states.
    let mesh = unsafe { mesh_of(&mesh) }?;
    Ok(open(&builder).add_object(&mesh)?)
});

entry!(mrv_scene_builder_add_shared_mesh(call, builder: MutHandle<mrv_scene_builder>, mesh: Record<mrv_mesh>) -> index: Place<u32> {
    // SAFETY: the record holds arrays and text as the header states.
    let mesh = unsafe { mesh_of(&mesh) }?;
    open(&builder).add_shared_mesh(&mesh)?
});

entry!(mrv_scene_builder_add_instance(
    call, builder: MutHandle<mrv_scene_builder>, mesh: u32, name: Text, transform: Pointer<f64>
) {
    // SAFETY: the caller gives twelve numbers.
    let rows = unsafe { slice(transform.cast::<[f64; 12]>(), 1, "transform") }?;
    Ok(open(&builder).add_instance(mesh, name, rows_of(&rows[0]))?)
});

entry!(mrv_scene_builder_finish(call, builder: MutHandle<mrv_scene_builder>, options: Given<mrv_load_options>) -> scene: Made<mrv_scene> {
    // SAFETY: the record holds arrays and text as the header states.
    let wanted = unsafe { load_options(&options) }?;
    let all = std::mem::take(&mut *open(&builder));
    NamedScene::new(Arc::new(all.finish(&wanted)?))
});
