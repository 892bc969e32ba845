//! Single visibility queries.

use super::arguments::{count_of, one_of};
use super::guard::guard;
use super::handle::object;
use super::model::mrv_model;
use super::record::{RecordPlace, read, record};
use super::status::mrv_status;
use super::visibility::{cost_record, engine_of, mrv_cost};

pub const MRV_TARGET_SOURCE: i32 = 0;
pub const MRV_TARGET_POINT: i32 = 1;

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

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_visibility_query(
    model: *const mrv_model,
    engine: i32,
    query: *const mrv_query,
    answer: *mut mrv_answer,
    cost: *mut mrv_cost,
) -> mrv_status {
    guard("mrv_visibility_query", |call| {
        let model = object(call, model, "model")?;
        let visibility = model.model.visibility().with_engine(engine_of(engine, "engine")?);
        // SAFETY: the caller gives records.
        let given = unsafe { read(query, "query") }?;
        // SAFETY: as above.
        let places = unsafe { (RecordPlace::of(answer, "answer")?, RecordPlace::optional(cost, "cost")?) };
        let mut query = visibility.from_point(given.position, given.normal);
        query = one_of!(
            "query.target",
            given.target,
            MRV_TARGET_SOURCE => query.to_source(count_of(given.source)),
            MRV_TARGET_POINT => query.to_point(given.point),
        );
        if given.feature_size != 0.0 {
            query = query.feature_size(given.feature_size);
        }
        if given.rays != 0 {
            query = query.rays(given.rays as usize);
        }
        if given.seed != 0 {
            query = query.seed(given.seed);
        }
        let found = query.answer()?;
        let answer = mrv_answer {
            struct_size: 0,
            transmittance: found.transmittance,
            lo: found.lo,
            hi: found.hi,
            method: i32::from(found.method as u8),
        };
        places.0.set(answer)?;
        places.1.set(cost_record(found.cost))
    })
}
