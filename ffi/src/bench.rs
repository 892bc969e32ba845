//! Measurements of a model: exact against multi-resolution visibility, and irradiance by path tracing.

use super::arguments::{Place, c_text, slice, slice_mut, texts};
use super::call_progress::{mrv_progress, with_progress};
use super::guard::{Outcome, guard, quiet};
use super::handle::{Opaque, give, object, release, retain};
use super::model::mrv_model;
use super::overlap::{Span, check_apart};
use super::record::{read_optional, record};
use super::solve::points_of;
use super::status::mrv_status;
use mrvis::internals::ModelParts;
use mrvis::{BenchOptions, BenchReport};
use std::ffi::{CString, c_char, c_void};

/// A report of a benchmark.
#[repr(C)]
pub struct mrv_bench_report {
    _opaque: [u8; 0],
}

/// A report as C text.
pub struct ReportText {
    json: CString,
    page: CString,
}

impl Opaque for mrv_bench_report {
    const NAME: &'static str = "mrv_bench_report";
    type Value = ReportText;
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_bench_options {
    pub struct_size: usize,
    pub points: u64,
    pub rays: u32,
    pub reference_rays: u32,
    pub feature_sizes: *const f64,
    pub feature_size_count: usize,
    pub receivers: *const *const c_char,
    pub receiver_count: usize,
    pub audit: f64,
    pub seed: u64,
    pub threads: u32,
    pub no_audit: i32,
    pub progress: mrv_progress,
    pub user: *mut c_void,
    pub max_memory: u64,
}
record!(
    mrv_bench_options: 96,
    struct_size, points, rays, reference_rays, feature_sizes, feature_size_count, receivers,
    receiver_count, audit, seed, threads, no_audit,
    progress, user, max_memory
);

/// The options of a caller.
///
/// # Safety
/// The record holds arrays and text as the header says.
unsafe fn bench_options(given: &mrv_bench_options) -> Outcome<BenchOptions> {
    let mut options = BenchOptions::default();
    if given.points != 0 {
        options.points = usize::try_from(given.points).unwrap_or(usize::MAX);
    }
    if given.rays != 0 {
        options.rays = given.rays as usize;
    }
    if given.reference_rays != 0 {
        options.reference_rays = given.reference_rays as usize;
    }
    if given.threads != 0 {
        options.threads = given.threads as usize;
    }
    if given.no_audit != 0 || given.audit != 0.0 {
        options.audit = if given.no_audit != 0 { 0.0 } else { given.audit };
    }
    if given.max_memory != 0 {
        options.max_memory = Some(given.max_memory);
    }
    if given.seed != 0 {
        options.seed = given.seed;
    }
    // SAFETY: as for this function.
    let (sizes, receivers) = unsafe {
        (
            slice(given.feature_sizes, given.feature_size_count, "options.feature_sizes")?,
            texts(given.receivers, given.receiver_count, "options.receivers")?,
        )
    };
    options.feature_sizes = sizes.to_vec();
    options.receivers = receivers.into_iter().map(String::from).collect();
    Ok(options)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_model_bench(
    model: *const mrv_model,
    options: *const mrv_bench_options,
    report: *mut *mut mrv_bench_report,
) -> mrv_status {
    guard("mrv_model_bench", |call| {
        let model = object(call, model, "model")?;
        // SAFETY: the caller gives a record.
        let given = unsafe { read_optional(options, "options") }?;
        // SAFETY: as above.
        let options = unsafe { bench_options(&given) }?;
        let place = Place::of(report, "report")?;
        let run = |progress| model.model.with_progress(progress).bench(&options);
        let found: BenchReport = with_progress(call, given.progress, given.user, run)??;
        let (json, page) = (c_text(&found.json), c_text(&found.page));
        // SAFETY: the caller gives a place.
        unsafe { place.set(give(ReportText { json, page })) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_bench_report_retain(report: *const mrv_bench_report) -> mrv_status {
    guard("mrv_bench_report_retain", |call| retain(call, report, "report"))
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_bench_report_release(report: *const mrv_bench_report) {
    quiet((), || release(report));
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_bench_report_get_text(
    report: *const mrv_bench_report,
    json: *mut *const c_char,
    html: *mut *const c_char,
) -> mrv_status {
    guard("mrv_bench_report_get_text", |call| {
        let report = object(call, report, "report")?;
        let json = (!json.is_null()).then(|| Place::of(json, "json")).transpose()?;
        let html = (!html.is_null()).then(|| Place::of(html, "html")).transpose()?;
        // SAFETY: the caller gives places.
        unsafe {
            json.into_iter().for_each(|place| place.set(report.json.as_ptr()));
            html.into_iter().for_each(|place| place.set(report.page.as_ptr()));
        }
        Ok(())
    })
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_reference_options {
    pub struct_size: usize,
    pub seed: u64,
    pub samples: u32,
    pub direct_only: i32,
    pub progress: mrv_progress,
    pub user: *mut c_void,
}
record!(mrv_reference_options: 40, struct_size, seed, samples, direct_only, progress, user);

/// Paths for each point by default, as `mrvis oracle` traces.
const SAMPLES: u32 = 1024;

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_model_reference(
    model: *const mrv_model,
    positions: *const f64,
    normals: *const f64,
    count: usize,
    options: *const mrv_reference_options,
    irradiance: *mut f64,
    standard_errors: *mut f64,
) -> mrv_status {
    guard("mrv_model_reference", |call| {
        let model = object(call, model, "model")?;
        check_apart(
            &[
                Span::of("positions", positions, count.saturating_mul(3)),
                Span::of("normals", normals, count.saturating_mul(3)),
            ],
            &[
                Span::of("irradiance", irradiance, count.saturating_mul(3)),
                Span::of("standard_errors", standard_errors, count.saturating_mul(3)),
            ],
        )?;
        // SAFETY: the caller gives a record, and arrays of `count` triples.
        let (given, points, out) = unsafe {
            (
                read_optional(options, "options")?,
                points_of(positions, normals, count)?,
                slice_mut(irradiance.cast::<[f64; 3]>(), count, "irradiance")?,
            )
        };
        let wanted = if standard_errors.is_null() { 0 } else { count };
        // SAFETY: as above.
        let errors = unsafe { slice_mut(standard_errors.cast::<[f64; 3]>(), wanted, "standard_errors") }?;
        let samples = if given.samples == 0 { SAMPLES } else { given.samples };
        let seed = if given.seed == 0 { 1 } else { given.seed };
        let direct_only = given.direct_only != 0;
        let trace = |progress| {
            model.model.with_progress(progress).reference_of(count, points, (samples, direct_only, seed))
        };
        let found = with_progress(call, given.progress, given.user, trace)??;
        out.copy_from_slice(&found.irradiance);
        errors.iter_mut().zip(found.standard_errors).for_each(|(out, error)| *out = error);
        Ok(())
    })
}
