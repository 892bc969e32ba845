//! Visibility, singly and in batches.

use super::arguments::{Span, check_apart, check_pointer, count_of, one_of, slice, slice_mut, wrong};
use super::entry::entry;
use super::guard::Outcome;
use super::model::mrv_model;
use super::record::record;
use mrvis::{Answers, Cost, Engine, Method, Segments, Strided};

pub const MRV_ENGINE_AUTOMATIC: i32 = 0;
pub const MRV_ENGINE_EXACT: i32 = 1;
pub const MRV_ENGINE_MULTI_RESOLUTION: i32 = 2;
pub const MRV_ENGINE_AVERAGE: i32 = 3;

pub const MRV_METHOD_CLEAR: u8 = 0;
pub const MRV_METHOD_COVERED: u8 = 1;
pub const MRV_METHOD_EXACT: u8 = 2;
pub const MRV_METHOD_AGGREGATED: u8 = 3;
pub const MRV_METHOD_MIXED: u8 = 4;

const _: () = assert!(
    Method::Clear as u8 == MRV_METHOD_CLEAR
        && Method::Covered as u8 == MRV_METHOD_COVERED
        && Method::Exact as u8 == MRV_METHOD_EXACT
        && Method::Aggregated as u8 == MRV_METHOD_AGGREGATED
        && Method::Mixed as u8 == MRV_METHOD_MIXED
);

pub const MRV_SAME_POSITION: usize = usize::MAX;

/// The engine with this number.
pub fn engine_of(number: i32, name: &str) -> Outcome<Engine> {
    Ok(one_of!(
        name,
        number,
        MRV_ENGINE_AUTOMATIC => Engine::Automatic,
        MRV_ENGINE_EXACT => Engine::Exact,
        MRV_ENGINE_MULTI_RESOLUTION => Engine::MultiResolution,
        MRV_ENGINE_AVERAGE => Engine::Average,
    ))
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_positions {
    pub x: *const f32,
    pub y: *const f32,
    pub z: *const f32,
    pub stride: usize,
}

record!(144: struct mrv_segments {
    struct_size: usize,
    origins: mrv_positions,
    targets: mrv_positions,
    segment_count: u64,
    offsets: *const u64,
    bundle_count: u64,
    feature_sizes: *const f32,
    emitter_sizes: *const f32,
    feature_size: f32,
    emitter_size: f32,
    relative_to: [f64; 3],
});

record!(48: struct mrv_answers {
    struct_size: usize,
    transmittance: *mut f32,
    lo: *mut f32,
    hi: *mut f32,
    methods: *mut u8,
    segment_transmittance: *mut f32,
});

record!(56: struct mrv_cost {
    struct_size: usize,
    segments: u64,
    nodes: u64,
    exact_rays: u64,
    handed_over: u64,
    aggregated: u64,
    certified: u64,
});

/// Cost of answers as a C record.
pub fn cost_record(cost: Cost) -> mrv_cost {
    let Cost { segments, nodes, exact_rays, handed_over, aggregated, certified, .. } = cost;
    mrv_cost { struct_size: 0, segments, nodes, exact_rays, handed_over, aggregated, certified }
}

/// Names of positions and of their arrays x, y and z, for messages: whole, so that no call needs memory for them.
type PositionNames = [&'static str; 4];
const ORIGINS: PositionNames =
    ["segments.origins", "segments.origins.x", "segments.origins.y", "segments.origins.z"];
const TARGETS: PositionNames =
    ["segments.targets", "segments.targets.x", "segments.targets.y", "segments.targets.z"];

/// Positions of the caller.
///
/// # Safety
/// The arrays hold `count` positions at the stated stride.
unsafe fn positions<'a>(given: &mrv_positions, count: usize, names: PositionNames) -> Outcome<Strided<'a>> {
    let name = names[0];
    let mrv_positions { x, y, z, stride } = *given;
    if count == 0 {
        return Ok(Strided::from(&[][..]));
    }
    check_pointer(x, names[1])?;
    let is_interleaved = y.is_null() && z.is_null();
    if stride == MRV_SAME_POSITION && is_interleaved {
        // SAFETY: there is one position.
        return Ok(Strided::repeated(unsafe { &*x.cast::<[f32; 3]>() }, count));
    }
    if stride == MRV_SAME_POSITION {
        // SAFETY: there is one number in each array.
        let axis = |pointer, axis: usize| unsafe { slice(pointer, 1, names[axis]) };
        return Ok(Strided::repeated_axes(axis(x, 1)?, axis(y, 2)?, axis(z, 3)?, count));
    }
    let size = if is_interleaved { 3 } else { 1 };
    let numbers = if stride == 0 { size } else { stride / size_of::<f32>() };
    if !stride.is_multiple_of(size_of::<f32>()) || numbers < size {
        return wrong(format!(
            "`{name}.stride` {stride}: must be 0 (packed) or a multiple of 4 bytes, at least {}",
            size * size_of::<f32>()
        ));
    }
    let Some(length) = (count - 1).checked_mul(numbers).and_then(|n| n.checked_add(size)) else {
        return wrong(format!("`{name}.stride` {stride} with {count} positions is larger than memory"));
    };
    if is_interleaved {
        // SAFETY: as for this function.
        return Ok(Strided::new(unsafe { slice(x, length, name) }?, numbers, count)?);
    }
    // SAFETY: as for this function.
    let axis = |pointer, axis: usize| unsafe { slice(pointer, length, names[axis]) };
    Ok(Strided::of_axes(axis(x, 1)?, axis(y, 2)?, axis(z, 3)?, numbers, count)?)
}

/// A number of entries as a length.
fn length(count: u64, name: &str) -> Outcome<usize> {
    usize::try_from(count).or_else(|_| wrong(format!("`{name}` {count}: larger than memory")))
}

entry!(mrv_visibility_answer(
    call, model: Handle<mrv_model>, engine: i32, segments: Record<mrv_segments>, answers: Record<mrv_answers>,
    cost: OptionalRecordPlace<mrv_cost>
) {
    let engine = engine_of(engine, "engine")?;
    let count = length(segments.segment_count, "segments.segment_count")?;
    let one = [0, segments.segment_count];
    // SAFETY: the caller gives arrays with the stated numbers of entries.
    let (batch, bundles) = unsafe { segments_of(&segments, count, &one) }?;
    // SAFETY: as above.
    let mut found = unsafe { answers_of(&answers, bundles, count) }?;
    check_batch_apart(&segments, &answers, bundles, count)?;
    let spent = model.model.visibility().with_engine(engine).answer_into(&batch, &mut found)?;
    cost.set(cost_record(spent))
});

/// The batch of a caller and the number of its bundles. `one`: offsets of a single bundle.
///
/// # Safety
/// The arrays have as many entries as the header states.
unsafe fn segments_of<'a>(
    given: &mrv_segments,
    count: usize,
    one: &'a [u64; 2],
) -> Outcome<(Segments<'a>, usize)> {
    let mut bundles = length(given.bundle_count, "segments.bundle_count")?;
    let offsets = if given.offsets.is_null() {
        if bundles > 1 {
            return wrong(format!(
                "`segments.offsets` is NULL with `segments.bundle_count` {bundles}: give offsets"
            ));
        }
        bundles = 1;
        &one[..]
    } else {
        // SAFETY: as for this function.
        unsafe { slice(given.offsets, bundles.saturating_add(1), "segments.offsets") }?
    };
    // SAFETY: as for this function.
    let (origins, targets) =
        unsafe { (positions(&given.origins, count, ORIGINS)?, positions(&given.targets, count, TARGETS)?) };
    let mut segments = Segments::new(origins, targets, offsets).relative_to(given.relative_to);
    if !given.feature_sizes.is_null() {
        // SAFETY: as for this function.
        let sizes = unsafe { slice(given.feature_sizes, bundles, "segments.feature_sizes") }?;
        segments = segments.feature_sizes(sizes);
    } else if given.feature_size != 0.0 {
        segments = segments.feature_size(given.feature_size);
    }
    if !given.emitter_sizes.is_null() {
        // SAFETY: as for this function.
        let sizes = unsafe { slice(given.emitter_sizes, bundles, "segments.emitter_sizes") }?;
        segments = segments.emitter_sizes(sizes);
    } else {
        segments = segments.emitter_size(given.emitter_size);
    }
    Ok((segments, bundles))
}

/// Output arrays of a caller for answers.
///
/// # Safety
/// The arrays have room for as many entries as the header states.
unsafe fn answers_of<'a>(wanted: &mrv_answers, bundles: usize, segments: usize) -> Outcome<Answers<'a>> {
    if wanted.lo.is_null() != wanted.hi.is_null() {
        let missing = if wanted.lo.is_null() { "lo" } else { "hi" };
        return wrong(format!(
            "`answers.{missing}` is NULL: give both `answers.lo` and `answers.hi` or none"
        ));
    }
    // SAFETY: as for this function.
    let mut answers =
        Answers::new(unsafe { slice_mut(wanted.transmittance, bundles, "answers.transmittance") }?);
    if !wanted.lo.is_null() {
        // SAFETY: as for this function.
        let (lo, hi) = unsafe {
            (slice_mut(wanted.lo, bundles, "answers.lo")?, slice_mut(wanted.hi, bundles, "answers.hi")?)
        };
        answers = answers.intervals(lo, hi);
    }
    if !wanted.methods.is_null() {
        // SAFETY: as for this function.
        answers = answers.method_codes(unsafe { slice_mut(wanted.methods, bundles, "answers.methods") }?);
    }
    if !wanted.segment_transmittance.is_null() {
        // SAFETY: as for this function.
        let each =
            unsafe { slice_mut(wanted.segment_transmittance, segments, "answers.segment_transmittance") }?;
        answers = answers.segments(each);
    }
    Ok(answers)
}

/// Refuses outputs that overlap each other or an input.
fn check_batch_apart(given: &mrv_segments, wanted: &mrv_answers, bundles: usize, segments: usize) -> Outcome {
    let axis = |name: &'static str, p: &mrv_positions, axis: *const f32| {
        let one = if p.y.is_null() { 3 * size_of::<f32>() } else { size_of::<f32>() };
        let bytes = match p.stride {
            MRV_SAME_POSITION => one,
            0 => one.saturating_mul(segments),
            stride => stride.saturating_mul(segments.saturating_sub(1)).saturating_add(one),
        };
        Span::new(name, axis, bytes)
    };
    let (origins, targets) = (&given.origins, &given.targets);
    check_apart(
        &[
            axis(ORIGINS[1], origins, origins.x),
            axis(ORIGINS[2], origins, origins.y),
            axis(ORIGINS[3], origins, origins.z),
            axis(TARGETS[1], targets, targets.x),
            axis(TARGETS[2], targets, targets.y),
            axis(TARGETS[3], targets, targets.z),
            Span::of("segments.offsets", given.offsets, bundles + 1),
            Span::of("segments.feature_sizes", given.feature_sizes, bundles),
            Span::of("segments.emitter_sizes", given.emitter_sizes, bundles),
        ],
        &[
            Span::of("answers.transmittance", wanted.transmittance, bundles),
            Span::of("answers.lo", wanted.lo, bundles),
            Span::of("answers.hi", wanted.hi, bundles),
            Span::of("answers.methods", wanted.methods, bundles),
            Span::of("answers.segment_transmittance", wanted.segment_transmittance, segments),
        ],
    )
}

const MRV_TARGET_SOURCE: i32 = 0;
const MRV_TARGET_POINT: i32 = 1;

record!(104: struct mrv_query {
    struct_size: usize,
    position: [f64; 3],
    normal: [f64; 3],
    point: [f64; 3],
    source: u64,
    target: i32,
    feature_size: f32,
    rays: u32,
    seed: u32,
});

record!(24: struct mrv_answer {
    struct_size: usize,
    transmittance: f32,
    lo: f32,
    hi: f32,
    method: i32,
});

entry!(mrv_visibility_query(
    call, model: Handle<mrv_model>, engine: i32, query: Record<mrv_query>, answer: RecordPlace<mrv_answer>,
    cost: OptionalRecordPlace<mrv_cost>
) {
    let visibility = model.model.visibility().with_engine(engine_of(engine, "engine")?);
    let asked = visibility.from_point(query.position, query.normal);
    let mut asked = one_of!(
        "query.target",
        query.target,
        MRV_TARGET_SOURCE => asked.to_source(count_of(query.source)),
        MRV_TARGET_POINT => asked.to_point(query.point),
    );
    if query.feature_size != 0.0 {
        asked = asked.feature_size(query.feature_size);
    }
    if query.rays != 0 {
        asked = asked.rays(query.rays as usize);
    }
    if query.seed != 0 {
        asked = asked.seed(query.seed);
    }
    let found = asked.answer()?;
    answer.set(mrv_answer {
        struct_size: 0,
        transmittance: found.transmittance,
        lo: found.lo,
        hi: found.hi,
        method: i32::from(found.method as u8),
    })?;
    cost.set(cost_record(found.cost))
});
