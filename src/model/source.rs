//! Light sources of a model.

/// A source of light.
///
/// Sky and sun will be variants of their own: they have no area and lie at infinity, so that code which matches must not
/// assume a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Source {
    /// An emissive surface of the scene's own triangles.
    Surface {
        /// Index into [`Scene::emitter_names`](crate::Scene::emitter_names).
        emitter: u32,
    },
}
