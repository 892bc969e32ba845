//! The light in a model.

use super::arguments::{Span, check_apart, count_of, set, slice, slice_mut, texts};
use super::call_progress::{mrv_progress, with_progress};
use super::entry::entry;
use super::guard::Outcome;
use super::handle::handle;
use super::model::mrv_model;
use super::record::record;
use super::visibility::{MRV_ENGINE_AUTOMATIC, engine_of};
use mrvis::{Solution, SolveOptions, SurfacePoint};
use std::ffi::{CString, c_char, c_void};
use std::sync::OnceLock;

/// A solution with its notes, record and page as C text, made on first use.
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

handle!(mrv_solution(solution): NotedSolution, mrv_solution_retain, mrv_solution_release);

record!(128: struct mrv_solve_options {
    struct_size: usize,
    engine: i32,
    direct_only: i32,
    error: f64,
    target_error: f64,
    min_area: f64,
    max_seconds: f64,
    max_links: u64,
    seed: u64,
    feature_size: f64,
    feature_size_names: *const *const c_char,
    feature_sizes: *const f32,
    feature_size_count: usize,
    importance: *const *const c_char,
    importance_count: usize,
    progress: mrv_progress,
    user: *mut c_void,
    audit: u32,
    no_audit: i32,
    light_rays: u32,
    gather_rays: u32,
});

/// The options of a caller.
///
/// # Safety
/// The record holds arrays and text as the header states.
unsafe fn solve_options(given: &mrv_solve_options) -> Outcome<SolveOptions> {
    let mut options = SolveOptions::default();
    // 0 stands for the default, as in other members.
    if given.engine != MRV_ENGINE_AUTOMATIC {
        options.engine = engine_of(given.engine, "options.engine")?;
    }
    options.direct_only = given.direct_only != 0;
    set(&mut options.error, given.error);
    set(&mut options.target_error, given.target_error);
    set(&mut options.min_area, given.min_area);
    set(&mut options.max_seconds, given.max_seconds);
    set(&mut options.max_links, count_of(given.max_links));
    set(&mut options.seed, given.seed);
    if given.no_audit != 0 || given.audit != 0 {
        options.audit = if given.no_audit != 0 { 0 } else { given.audit as usize };
    }
    set(&mut options.light_rays, given.light_rays as usize);
    set(&mut options.gather_rays, given.gather_rays as usize);
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

entry!(mrv_model_solve(call, model: Handle<mrv_model>, options: Given<mrv_solve_options>) -> solution: Made<mrv_solution> {
    // SAFETY: the record holds arrays and text as the header states.
    let wanted = unsafe { solve_options(&options) }?;
    let solve = |progress| model.model.with_progress(progress).solve(&wanted);
    NotedSolution::new(with_progress(call, options.progress, options.user, solve)??)
});

record!(64: struct mrv_solution_info {
    struct_size: usize,
    vertices: u64,
    elements: u64,
    mean_irradiance: [f64; 3],
    error_estimate: f64,
    interrupted: i32,
    reserved: u32,
    warnings: u64,
});

entry!(mrv_solution_get_info(call, solution: Handle<mrv_solution>) -> info: RecordPlace<mrv_solution_info> {
    let (solution, report) = (&solution.solution, solution.solution.report());
    mrv_solution_info {
        struct_size: 0,
        vertices: solution.vertices().len() as u64,
        elements: solution.elements().len() as u64,
        mean_irradiance: report.mean_irradiance,
        error_estimate: report.error_estimate.unwrap_or(-1.0),
        interrupted: i32::from(report.interrupted),
        reserved: 0,
        warnings: report.warnings.len() as u64,
    }
});

entry!(mrv_solution_irradiance(
    call, solution: Handle<mrv_solution>, positions: Pointer<f64>, normals: Pointer<f64>, count: usize,
    irradiance: MutPointer<f64>
) {
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
    out.copy_from_slice(&solution.solution.irradiance_of(count, points)?);
    Ok(())
});

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
