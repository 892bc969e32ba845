//! Which engine answers visibility.

/// How visibility is answered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Engine {
    /// Multi-resolution where a feature size is given and the model holds optics, else exact: in queries and in solutions. Where
    /// multi-resolution is expected to take longer, queries to a source trace exact rays for that bundle, and batches of segments, if a
    /// sample of their bundles says so, for all.
    #[default]
    Automatic,
    /// One Embree ray a segment, 0 or 1.
    Exact,
    /// Clusters whose shadows have no features of the feature size or larger are averaged by their extinction; the rest is tested
    /// exactly. Queries need a feature size, and the model optics.
    #[serde(rename = "mr")]
    MultiResolution,
    /// Extinction only: an estimate without any ray. Queries need a feature size, and the model optics.
    Average,
}
