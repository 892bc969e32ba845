//! Models: scenes prepared for queries.

use super::arguments::{no_reserved, one_of, optional_text};
use super::call_progress::{mrv_progress, with_progress};
use super::entry::entry;
use super::guard::Outcome;
use super::handle::handle;
use super::record::record;
use super::scene::{NamedScene, mrv_scene};
use mrvis::{Builder, Detail, Model, PrepareOptions};
use std::ffi::{CString, c_char, c_void};
use std::sync::OnceLock;

/// A model and the names of its instances as C text.
pub struct NamedModel {
    pub model: Model,
    pub names: OnceLock<Vec<CString>>,
}

impl NamedModel {
    pub fn new(model: Model) -> NamedModel {
        NamedModel { model, names: OnceLock::new() }
    }
}

handle!(mrv_model(model): NamedModel, mrv_model_retain, mrv_model_release);

pub const MRV_DETAIL_DEFAULT: i32 = 0;
pub const MRV_DETAIL_RAYS: i32 = 1;
pub const MRV_DETAIL_CLUSTERS: i32 = 2;
pub const MRV_DETAIL_OPTICS: i32 = 3;

pub const MRV_BUILDER_DEFAULT: i32 = 0;
pub const MRV_BUILDER_GRIDS: i32 = 1;
pub const MRV_BUILDER_KDTREE: i32 = 2;
pub const MRV_BUILDER_GOLDSMITH_SALMON: i32 = 3;
pub const MRV_BUILDER_SAH: i32 = 4;

record!(40: struct mrv_prepare_options {
    struct_size: usize,
    detail: i32,
    threads: u32,
    cache: *const c_char,
    progress: mrv_progress,
    user: *mut c_void,
    builder: i32,
    reserved: u32,
});

/// The options of a caller.
///
/// # Safety
/// The record holds text as the header states.
unsafe fn prepare_options(given: &mrv_prepare_options) -> Outcome<PrepareOptions> {
    let detail = one_of!(
        "options.detail",
        given.detail,
        MRV_DETAIL_DEFAULT | MRV_DETAIL_OPTICS => Detail::Optics,
        MRV_DETAIL_RAYS => Detail::Rays,
        MRV_DETAIL_CLUSTERS => Detail::Clusters,
    );
    let builder = one_of!(
        "options.builder",
        given.builder,
        MRV_BUILDER_DEFAULT | MRV_BUILDER_GRIDS => Builder::Grids,
        MRV_BUILDER_KDTREE => Builder::KdTree,
        MRV_BUILDER_GOLDSMITH_SALMON => Builder::GoldsmithSalmon,
        MRV_BUILDER_SAH => Builder::Sah,
    );
    no_reserved(given.reserved, "options.reserved")?;
    let mut options = PrepareOptions::default();
    (options.detail, options.builder, options.threads) = (detail, builder, given.threads as usize);
    // SAFETY: as for this function.
    options.cache = unsafe { optional_text(given.cache, "options.cache") }?.map(Into::into);
    Ok(options)
}

entry!(mrv_model_prepare(call, scene: Handle<mrv_scene>, options: Given<mrv_prepare_options>) -> model: Made<mrv_model> {
    // SAFETY: the record holds text as the header states.
    let wanted = unsafe { prepare_options(&options) }?;
    let prepare = |progress| Model::prepare(scene.scene.clone(), &wanted.with_progress(progress));
    NamedModel::new(with_progress(call, options.progress, options.user, prepare)??)
});

entry!(mrv_model_get_scene(call, model: Handle<mrv_model>) -> scene: Made<mrv_scene> {
    NamedScene::new(model.model.shared_scene())
});

record!(80: struct mrv_model_info {
    struct_size: usize,
    sources: u64,
    instances: u64,
    revision: u64,
    embree_bytes: u64,
    embree_seconds: f64,
    cluster_seconds: f64,
    optics_seconds: f64,
    cache_seconds: f64,
    detail: i32,
    from_cache: i32,
});

entry!(mrv_model_get_info(call, model: Handle<mrv_model>) -> info: RecordPlace<mrv_model_info> {
    let (model, report) = (&model.model, model.model.report());
    mrv_model_info {
        struct_size: 0,
        sources: model.sources().len() as u64,
        instances: model.instances().len() as u64,
        revision: model.revision(),
        embree_bytes: report.embree_bytes,
        embree_seconds: report.embree_s,
        cluster_seconds: report.clusters_s,
        optics_seconds: report.optics_s,
        cache_seconds: report.cache_s,
        detail: match model.detail() {
            Detail::Rays => MRV_DETAIL_RAYS,
            Detail::Clusters => MRV_DETAIL_CLUSTERS,
            Detail::Optics => MRV_DETAIL_OPTICS,
        },
        from_cache: i32::from(report.from_cache),
    }
});
