//! Measurements of a model: exact against multi-resolution visibility, and irradiance by path tracing.

use super::arguments::{Span, c_text, check_apart, count_of, set, slice, slice_mut, texts};
use super::call_progress::{mrv_progress, with_progress};
use super::entry::entry;
use super::guard::Outcome;
use super::handle::handle;
use super::model::mrv_model;
use super::record::record;
use super::solve::points_of;
use mrvis::{BenchOptions, BenchReport};
use std::ffi::{CString, c_char, c_void};

/// A report as C text.
pub struct ReportText {
    json: CString,
    page: CString,
}

handle!(mrv_bench_report(report): ReportText, mrv_bench_report_retain, mrv_bench_report_release);

record!(96: struct mrv_bench_options {
    struct_size: usize,
    points: u64,
    rays: u32,
    reference_rays: u32,
    feature_sizes: *const f64,
    feature_size_count: usize,
    receivers: *const *const c_char,
    receiver_count: usize,
    audit: f64,
    seed: u64,
    threads: u32,
    no_audit: i32,
    progress: mrv_progress,
    user: *mut c_void,
    max_memory: u64,
});

/// The options of a caller.
///
/// # Safety
/// The record holds arrays and text as the header states.
unsafe fn bench_options(given: &mrv_bench_options) -> Outcome<BenchOptions> {
    let mut options = BenchOptions::default();
    set(&mut options.points, count_of(given.points));
    set(&mut options.rays, given.rays as usize);
    set(&mut options.reference_rays, given.reference_rays as usize);
    set(&mut options.threads, given.threads as usize);
    if given.no_audit != 0 || given.audit != 0.0 {
        options.audit = if given.no_audit != 0 { 0.0 } else { given.audit };
    }
    set(&mut options.max_memory, given.max_memory);
    set(&mut options.seed, given.seed);
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

entry!(mrv_model_bench(call, model: Handle<mrv_model>, options: Given<mrv_bench_options>) -> report: Made<mrv_bench_report> {
    // SAFETY: the record holds arrays and text as the header states.
    let wanted = unsafe { bench_options(&options) }?;
    let run = |progress| model.model.with_progress(progress).bench(&wanted);
    let found: BenchReport = with_progress(call, options.progress, options.user, run)??;
    ReportText { json: c_text(&found.json), page: c_text(&found.page) }
});

entry!(mrv_bench_report_get_text(
    call, report: Handle<mrv_bench_report>, json: OptionalPlace<*const c_char>, html: OptionalPlace<*const c_char>
) {
    json.set(report.json.as_ptr())?;
    html.set(report.page.as_ptr())
});

record!(40: struct mrv_reference_options {
    struct_size: usize,
    seed: u64,
    samples: u32,
    direct_only: i32,
    progress: mrv_progress,
    user: *mut c_void,
});

/// Paths for each point by default, as `mrvis oracle` traces.
const SAMPLES: u32 = 1024;

entry!(mrv_model_reference(
    call, model: Handle<mrv_model>, positions: Pointer<f64>, normals: Pointer<f64>, count: usize,
    options: Given<mrv_reference_options>, irradiance: MutPointer<f64>, standard_errors: MutPointer<f64>
) {
    let numbers = count.saturating_mul(3);
    check_apart(
        &[Span::of("positions", positions, numbers), Span::of("normals", normals, numbers)],
        &[Span::of("irradiance", irradiance, numbers), Span::of("standard_errors", standard_errors, numbers)],
    )?;
    // SAFETY: the caller gives arrays of `count` triples.
    let (points, out) = unsafe {
        (
            points_of(positions, normals, count)?,
            slice_mut(irradiance.cast::<[f64; 3]>(), count, "irradiance")?,
        )
    };
    let wanted = if standard_errors.is_null() { 0 } else { count };
    // SAFETY: as above.
    let errors = unsafe { slice_mut(standard_errors.cast::<[f64; 3]>(), wanted, "standard_errors") }?;
    let samples = if options.samples == 0 { SAMPLES } else { options.samples };
    let seed = if options.seed == 0 { 1 } else { options.seed };
    let direct_only = options.direct_only != 0;
    let trace = |progress| {
        model.model.with_progress(progress).reference_of(count, points, samples, direct_only, seed)
    };
    let found = with_progress(call, options.progress, options.user, trace)??;
    out.copy_from_slice(&found.irradiance);
    errors.iter_mut().zip(found.standard_errors).for_each(|(out, error)| *out = error);
    Ok(())
});
