//! Methods by which bundles are answered.

/// How a batch of bundles is answered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Route {
    /// Exact rays.
    Exact,
    /// Exact rays, and no rays for bundles whose answer is certain: their shaft is empty, or a single triangle covers it.
    Certified,
    /// Walks of the clusters by bundles.
    Walks {
        /// Factor of all extinctions: clusters along a segment are not independent, so that products of their transmittances have a
        /// biased mean.
        factor: f32,
    },
    /// The distance cut in one of its modes, by number, and exact rays for bundles that it does not take.
    Cut(usize),
}

impl Route {
    /// Walks with the extinctions of the clusters.
    pub const WALKS: Route = Route::Walks { factor: 1.0 };

    /// Factor of all extinctions of walks.
    pub(super) fn factor(self) -> f32 {
        match self {
            Route::Walks { factor } => factor,
            Route::Exact | Route::Certified | Route::Cut(_) => 1.0,
        }
    }
}
