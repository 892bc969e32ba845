//! Single visibility queries.

use super::arguments::wrong;
use super::guard::guard;
use super::handle::object;
use super::model::mrv_model;
use super::record::{RecordPlace, read, record};
use super::status::mrv_status;
use super::visibility::{cost_record, engine_of, mrv_cost};

pub const MRV_TARGET_SOURCE: i32 = 0;
pub const MRV_TARGET_POINT: i32 = 1;

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_query {
    pub struct_size: usize,
    pub position: [f64; 3],
    pub normal: [f64; 3],
    pub point: [f64; 3],
    pub source: u64,
    pub target: i32,
    pub feature_size: f32,
    pub rays: u32,
    pub seed: u32,
}
record!(mrv_query: 104, struct_size, position, normal, point, source, target, feature_size, rays, seed);

#[repr(C)]
#[derive(Clone, Copy)]
pub struct mrv_answer {
    pub struct_size: usize,
    pub transmittance: f32,
    pub lo: f32,
    pub hi: f32,
    pub method: i32,
}
record!(mrv_answer: 24, struct_size, transmittance, lo, hi, method);

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
        query = match given.target {
            MRV_TARGET_SOURCE => query.to_source(usize::try_from(given.source).unwrap_or(usize::MAX)),
            MRV_TARGET_POINT => query.to_point(given.point),
            other => {
                return wrong(format!("`query.target` {other}: give MRV_TARGET_SOURCE or MRV_TARGET_POINT"));
            }
        };
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
        // SAFETY: as above.
        unsafe {
            places.0.set(answer);
            if let Some(place) = places.1 {
                place.set(cost_record(found.cost));
            }
        }
        Ok(())
    })
}
