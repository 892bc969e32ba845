//! Form factors.

use super::arguments::{c_text, one_of, set, wrong};
use super::call_progress::{mrv_progress, with_progress};
use super::entry::entry;
use super::guard::Outcome;
use super::handle::handle;
use super::model::mrv_model;
use super::record::record;
use mrvis::{FormFactorOptions, FormFactors, Grouping};
use std::ffi::{CString, c_char, c_void};

/// Form factors and the names of rows as C text.
pub struct NamedFactors {
    factors: FormFactors,
    names: Vec<CString>,
}

handle!(mrv_form_factors(factors): NamedFactors, mrv_form_factors_retain, mrv_form_factors_release);

pub const MRV_GROUPING_POLYGON: i32 = 0;
pub const MRV_GROUPING_OBJECT: i32 = 1;
pub const MRV_GROUPING_MATERIAL: i32 = 2;

record!(56: struct mrv_form_factor_options {
    struct_size: usize,
    grouping: i32,
    no_closure: i32,
    rays: u32,
    pair_rays: u32,
    max_bytes: u64,
    seed: u64,
    progress: mrv_progress,
    user: *mut c_void,
});

fn form_factor_options(given: &mrv_form_factor_options) -> Outcome<FormFactorOptions> {
    let grouping = one_of!(
        "options.grouping",
        given.grouping,
        MRV_GROUPING_POLYGON => Grouping::Polygon,
        MRV_GROUPING_OBJECT => Grouping::Object,
        MRV_GROUPING_MATERIAL => Grouping::Material,
    );
    let mut options = FormFactorOptions::default();
    (options.grouping, options.closure) = (grouping, given.no_closure == 0);
    set(&mut options.rays, given.rays);
    set(&mut options.pair_rays, given.pair_rays);
    set(&mut options.max_bytes, given.max_bytes);
    set(&mut options.seed, given.seed);
    Ok(options)
}

entry!(mrv_model_form_factors(call, model: Handle<mrv_model>, options: Given<mrv_form_factor_options>) -> factors: Made<mrv_form_factors> {
    let wanted = form_factor_options(&options)?;
    let compute = |progress| model.model.with_progress(progress).form_factors(&wanted);
    let factors = with_progress(call, options.progress, options.user, compute)??;
    let names = factors.names.iter().map(|name| c_text(name)).collect();
    NamedFactors { factors, names }
});

record!(88: struct mrv_form_factor_arrays {
    struct_size: usize,
    rows: u64,
    entries: u64,
    offsets: *const u64,
    columns: *const u32,
    values: *const f32,
    areas: *const f64,
    escaped: *const f32,
    lost: *const f32,
    rays: u64,
    row_sum_error: f64,
    closed_row_sum_error: f64,
});

entry!(mrv_form_factors_get_arrays(call, factors: Handle<mrv_form_factors>) -> arrays: RecordPlace<mrv_form_factor_arrays> {
    let factors = &factors.factors;
    mrv_form_factor_arrays {
        struct_size: 0,
        rows: factors.areas.len() as u64,
        entries: factors.columns.len() as u64,
        offsets: factors.offsets.as_ptr(),
        columns: factors.columns.as_ptr(),
        values: factors.factors.as_ptr(),
        areas: factors.areas.as_ptr(),
        escaped: factors.escaped.as_ptr(),
        lost: factors.lost.as_ptr(),
        rays: factors.rays,
        row_sum_error: factors.row_sum_error,
        closed_row_sum_error: factors.closed_row_sum_error,
    }
});

entry!(mrv_form_factors_get_row(
    call, factors: Handle<mrv_form_factors>, row: u64, columns: Place<*const u32>, values: Place<*const f32>, count: Place<usize>
) {
    let factors = &factors.factors;
    let (of_row, factors_of_row) = factors.row(index(row, factors.areas.len())?);
    columns.set(of_row.as_ptr())?;
    values.set(factors_of_row.as_ptr())?;
    count.set(of_row.len())
});

entry!(mrv_form_factors_get_name(call, factors: Handle<mrv_form_factors>, row: u64) -> name: Place<*const c_char> {
    let row = index(row, factors.factors.areas.len())?;
    factors.names.get(row).map_or(c"".as_ptr(), |name| name.as_ptr())
});

entry!(mrv_form_factors_write(call, factors: Handle<mrv_form_factors>, path: Text) {
    Ok(factors.factors.write(path)?)
});

/// A row that exists.
fn index(row: u64, rows: usize) -> Outcome<usize> {
    match usize::try_from(row).ok().filter(|&row| row < rows) {
        Some(row) => Ok(row),
        None => wrong(format!("`row` {row}: there are {rows} rows")),
    }
}
