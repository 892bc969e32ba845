//! What may answer bundles.

/// What answers many bundles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Route {
    /// Exact rays.
    Exact,
    /// Exact rays, and none for bundles whose answer is certain: those that nothing or a single triangle stands in the way of.
    Certified,
    /// Walks of the clusters by bundles.
    Walks {
        /// Factor of all extinctions: clusters that a segment meets one after the other are not independent, so that products of their
        /// transmittances are wrong in the mean.
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
