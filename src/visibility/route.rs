//! What may answer bundles.

/// What answers many bundles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Route {
    /// Exact rays.
    Exact,
    /// Walks of the clusters by bundles.
    Walks,
    /// The distance cut in one of its modes, by number, and exact rays for bundles that it does not take.
    Cut(usize),
}
