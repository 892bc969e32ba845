//! The elements of a solution in arrays of the caller, and its record as text.

use super::arguments::{Span, c_text, check_apart, check_array, nth, slice_mut, wrong};
use super::call_progress::{mrv_progress, with_progress};
use super::entry::entry;
use super::guard::Outcome;
use super::member_names::{add_record, c_name};
use super::record::{Record, record};
use super::solve::{mrv_solution, mrv_solve_options};
use mrvis::Element;
use mrvis::internals::error::worded;
use std::ffi::{c_char, c_void};

record!(112: struct mrv_elements {
    struct_size: usize,
    vertex_capacity: u64,
    element_capacity: u64,
    positions: *mut f64,
    corners: *mut u32,
    irradiance: *mut f32,
    radiosity: *mut f32,
    error: *mut f32,
    reflectance: *mut f32,
    area: *mut f64,
    triangle: *mut u32,
    object: *mut u32,
    material: *mut u32,
    front: *mut u8,
    exitance: *mut f32,
});

/// Memory of an array of the caller, refused before anything is written if it is neither NULL nor room for `count` entries.
fn room<T>(out: *mut T, name: &'static str, count: usize) -> Outcome<Span> {
    if !out.is_null() {
        check_array(out, count, name)?;
    }
    Ok(Span::of(name, out, count))
}

/// Writes `of(item)` for each item into an array of the caller, unless that is NULL.
///
/// # Safety
/// `out` is NULL or has room for as many entries as there are items.
unsafe fn put<I, T>(
    out: *mut T,
    name: &str,
    items: impl ExactSizeIterator<Item = I>,
    of: impl Fn(I) -> T,
) -> Outcome {
    if out.is_null() {
        return Ok(());
    }
    // SAFETY: as for this function.
    let out = unsafe { slice_mut(out, items.len(), name) }?;
    out.iter_mut().zip(items).for_each(|(out, item)| *out = of(item));
    Ok(())
}

entry!(mrv_solution_get_elements(call, solution: Handle<mrv_solution>, elements: Record<mrv_elements>) {
    let (solution, to) = (&solution.solution, elements);
    let all = solution.elements();
    for (name, have, need) in [
        ("vertex_capacity", to.vertex_capacity, solution.vertices().len() as u64),
        ("element_capacity", to.element_capacity, all.len() as u64),
    ] {
        if have < need {
            return wrong(format!("`elements.{name}` {have}: there are {need}; see mrv_solution_info"));
        }
    }
    let rgb = |c: [f64; 3]| c.map(|c| c as f32);
    let each = || all.iter();
    let (vertices, elements) = (solution.vertices().len(), all.len());
    check_apart(
        &[],
        &[
            room(to.positions, "elements.positions", 3 * vertices)?,
            room(to.corners, "elements.corners", 4 * elements)?,
            room(to.irradiance, "elements.irradiance", 3 * elements)?,
            room(to.radiosity, "elements.radiosity", 3 * elements)?,
            room(to.error, "elements.error", 3 * elements)?,
            room(to.reflectance, "elements.reflectance", 3 * elements)?,
            room(to.area, "elements.area", elements)?,
            room(to.triangle, "elements.triangle", elements)?,
            room(to.object, "elements.object", elements)?,
            room(to.material, "elements.material", elements)?,
            room(to.front, "elements.front", elements)?,
            room(to.exitance, "elements.exitance", 3 * elements)?,
        ],
    )?;
    // SAFETY: the caller gives arrays with the stated numbers of entries. They are aligned like their numbers.
    unsafe {
        put(to.positions.cast::<[f64; 3]>(), "elements.positions", solution.vertices(), |p| p)?;
        put(to.corners.cast::<[u32; 4]>(), "elements.corners", each(), |e: &Element| e.corners)?;
        put(to.irradiance.cast(), "elements.irradiance", each(), |e| rgb(e.irradiance))?;
        put(to.radiosity.cast(), "elements.radiosity", each(), |e| rgb(e.radiosity))?;
        put(to.error.cast(), "elements.error", each(), |e| rgb(e.error))?;
        put(to.reflectance.cast::<[f32; 3]>(), "elements.reflectance", each(), |e| e.albedo)?;
        put(to.exitance.cast(), "elements.exitance", each(), |e| rgb(e.exitance))?;
        put(to.area, "elements.area", each(), |e| e.area)?;
        put(to.triangle, "elements.triangle", each(), |e| e.triangle)?;
        put(to.object, "elements.object", each(), |e| e.object)?;
        put(to.material, "elements.material", each(), |e| e.material)?;
        put(to.front, "elements.front", each(), |e| u8::from(e.front))
    }
});

entry!(mrv_solution_get_json(call, solution: Handle<mrv_solution>) -> json: Place<*const c_char> {
    solution.json.get_or_init(|| c_text(&solution.solution.json())).as_ptr()
});

entry!(mrv_solution_get_warning(call, solution: Handle<mrv_solution>, index: u64) -> text: Place<*const c_char> {
    let all = solution.warnings.get_or_init(|| {
        add_record("options", mrv_solve_options::MEMBERS);
        solution.solution.notes().iter().map(|note| c_text(&worded(note, c_name))).collect()
    });
    nth(all, index, "the solution", "warnings")?.as_ptr()
});

entry!(mrv_solution_write(
    call, solution: Handle<mrv_solution>, path: Text, progress: mrv_progress, user: MutPointer<c_void>
) {
    let write = |progress| solution.solution.with_progress(progress).write(path);
    Ok(with_progress(call, progress, user, write)??)
});

entry!(mrv_solution_get_page(call, solution: Handle<mrv_solution>) -> html: Place<*const c_char> {
    if solution.page.get().is_none() {
        // Another thread may have set it meanwhile; either page serves.
        let _ = solution.page.set(c_text(&solution.solution.page()?));
    }
    solution.page.get().map_or(c"".as_ptr(), |page| page.as_ptr())
});
