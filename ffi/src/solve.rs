//! The light in a model.

use super::arguments::{Place, slice, slice_mut, texts};
use super::call_progress::{mrv_progress, with_progress};
use super::guard::{Outcome, guard, quiet};
use super::handle::{Opaque, give, object, release, retain};
use super::model::mrv_model;
use super::overlap::{Span, check_apart};
use super::record::{RecordPlace, read_optional, record};
use super::status::mrv_status;
use super::visibility::engine_of;
use mrvis::internals::SolutionParts;
use mrvis::{Solution, SolveOptions, SurfacePoint};
use std::ffi::{CString, c_char, c_void};
use std::sync::OnceLock;

/// A solution.
#[repr(C)]
pub struct mrv_solution {
    _opaque: [u8; 0],
}

/// A solution and what it says as C text, made when it is first needed.
pub struct NotedSolution {
    pub solution: Solution,
    pub json: OnceLock<CString>,
    pub page: OnceLock<CString>,
    pub warnings: OnceLock<Vec<CString>>,
}

impl NotedSolution {
    fn new(solution: Solution) -> NotedSolution {
        let (json, page, warnings) = Default::default();
        NotedSolution { solution, json, page, warnings }
    }
}

impl Opaque for mrv_solution {
    const NAME: &'static str = "mrv_solution";
    type Value = NotedSolution;
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_solve_options {
    pub struct_size: usize,
    pub engine: i32,
    pub direct_only: i32,
    pub error: f64,
    pub target_error: f64,
    pub min_area: f64,
    pub max_seconds: f64,
    pub max_links: u64,
    pub seed: u64,
    pub feature_size: f64,
    pub feature_size_names: *const *const c_char,
    pub feature_sizes: *const f32,
    pub feature_size_count: usize,
    pub importance: *const *const c_char,
    pub importance_count: usize,
    pub progress: mrv_progress,
    pub user: *mut c_void,
    pub audit: u32,
    pub no_audit: i32,
    pub light_rays: u32,
    pub gather_rays: u32,
}
record!(
    mrv_solve_options: 128,
    struct_size, engine, direct_only, error, target_error, min_area, max_seconds, max_links, seed,
    feature_size, feature_size_names, feature_sizes, feature_size_count, importance, importance_count,
    progress, user, audit, no_audit, light_rays, gather_rays
);

/// The options of a caller.
///
/// # Safety
/// The record holds arrays and text as the header says.
unsafe fn solve_options(given: &mrv_solve_options) -> Outcome<SolveOptions> {
    let mut options = SolveOptions::default();
    options.engine = engine_of(given.engine, "options.engine")?;
    options.direct_only = given.direct_only != 0;
    if given.error != 0.0 {
        options.error = given.error;
    }
    if given.target_error != 0.0 {
        options.target_error = Some(given.target_error);
    }
    if given.min_area != 0.0 {
        options.min_area = given.min_area;
    }
    if given.max_seconds != 0.0 {
        options.max_seconds = Some(given.max_seconds);
    }
    if given.max_links != 0 {
        options.max_links = usize::try_from(given.max_links).unwrap_or(usize::MAX);
    }
    if given.seed != 0 {
        options.seed = given.seed;
    }
    if given.no_audit != 0 || given.audit != 0 {
        options.audit = if given.no_audit != 0 { 0 } else { given.audit as usize };
    }
    if given.light_rays != 0 {
        options.light_rays = Some(given.light_rays as usize);
    }
    if given.gather_rays != 0 {
        options.gather_rays = Some(given.gather_rays as usize);
    }
    if given.feature_size != 0.0 {
        options.feature_size = Some(given.feature_size as f32);
    }
    // SAFETY: as for this function.
    let (names, sizes, important) = unsafe {
        let count = given.feature_size_count;
        (
            texts(given.feature_size_names, count, "options.feature_size_names")?,
            slice(given.feature_sizes, count, "options.feature_sizes")?,
            texts(given.importance, given.importance_count, "options.importance")?,
        )
    };
    options.feature_sizes = names.into_iter().map(String::from).zip(sizes.iter().copied()).collect();
    options.importance = important.into_iter().map(String::from).collect();
    Ok(options)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_model_solve(
    model: *const mrv_model,
    options: *const mrv_solve_options,
    solution: *mut *mut mrv_solution,
) -> mrv_status {
    guard("mrv_model_solve", |call| {
        let model = object(call, model, "model")?;
        // SAFETY: the caller gives a record.
        let given = unsafe { read_optional(options, "options") }?;
        // SAFETY: as above.
        let options = unsafe { solve_options(&given) }?;
        let place = Place::of(solution, "solution")?;
        let solve = |progress| model.model.with_progress(progress).solve(&options);
        let solution = with_progress(call, given.progress, given.user, solve)??;
        // SAFETY: the caller gives a place.
        unsafe { place.set(give(NotedSolution::new(solution))) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_solution_retain(solution: *const mrv_solution) -> mrv_status {
    guard("mrv_solution_retain", |call| retain(call, solution, "solution"))
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_solution_release(solution: *const mrv_solution) {
    quiet((), || release(solution));
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_solution_info {
    pub struct_size: usize,
    pub vertices: u64,
    pub elements: u64,
    pub mean_irradiance: [f64; 3],
    pub error_estimate: f64,
    pub interrupted: i32,
    pub reserved: u32,
    pub warnings: u64,
}
record!(
    mrv_solution_info: 64,
    struct_size, vertices, elements, mean_irradiance, error_estimate, interrupted, reserved,
    warnings
);

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_solution_get_info(
    solution: *const mrv_solution,
    info: *mut mrv_solution_info,
) -> mrv_status {
    guard("mrv_solution_get_info", |call| {
        let solution = &object(call, solution, "solution")?.solution;
        // SAFETY: the caller gives a record.
        let place = unsafe { RecordPlace::of(info, "info") }?;
        let report = solution.report();
        let info = mrv_solution_info {
            struct_size: 0,
            vertices: solution.vertices().len() as u64,
            elements: solution.elements().len() as u64,
            mean_irradiance: report.mean_irradiance,
            error_estimate: report.error_estimate.unwrap_or(-1.0),
            interrupted: i32::from(report.interrupted),
            reserved: 0,
            warnings: report.warnings.len() as u64,
        };
        // SAFETY: as above.
        unsafe { place.set(info) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_solution_irradiance(
    solution: *const mrv_solution,
    positions: *const f64,
    normals: *const f64,
    count: usize,
    irradiance: *mut f64,
) -> mrv_status {
    guard("mrv_solution_irradiance", |call| {
        let solution = &object(call, solution, "solution")?.solution;
        let numbers = count.saturating_mul(3);
        check_apart(
            &[Span::of("positions", positions, numbers), Span::of("normals", normals, numbers)],
            &[Span::of("irradiance", irradiance, numbers)],
        )?;
        // SAFETY: the caller gives arrays of `count` triples.
        let (points, out) = unsafe {
            (
                points_of(positions, normals, count)?,
                slice_mut(irradiance.cast::<[f64; 3]>(), count, "irradiance")?,
            )
        };
        out.copy_from_slice(&solution.irradiance_of(count, points)?);
        Ok(())
    })
}

/// Points of the caller by their index, where they are.
///
/// # Safety
/// The arrays hold `count` triples.
pub unsafe fn points_of<'a>(
    positions: *const f64,
    normals: *const f64,
    count: usize,
) -> Outcome<impl Fn(usize) -> SurfacePoint + Sync + 'a> {
    // SAFETY: as for this function.
    let (positions, normals) = unsafe {
        (
            slice(positions.cast::<[f64; 3]>(), count, "positions")?,
            slice(normals.cast::<[f64; 3]>(), count, "normals")?,
        )
    };
    Ok(move |i: usize| SurfacePoint { position: positions[i], normal: normals[i] })
}
