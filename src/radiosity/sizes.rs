//! Feature sizes of receivers: which shadows on them may be averaged (method A.13).

use super::Solver;
use crate::radiosity::elements::Shape;

/// What is known of feature sizes beside importance, scene units.
pub(super) struct Sizes {
    /// Given for all.
    pub all: Option<f32>,
    /// By side, where it has one of its own: painted by name, or pixels of the camera that sees it best; infinite elsewhere.
    pub own: Vec<f32>,
}

impl Solver {
    /// Works out the feature sizes of all elements; those of clusters serve all that is asked of their parts.
    pub(super) fn size(&mut self) {
        let elements = &self.elements.elements;
        let mut sizes = vec![f32::INFINITY; elements.len()];
        for e in (1..elements.len()).rev() {
            if !elements[e].is_cluster() {
                sizes[e] = self.given_size(e).unwrap_or(f32::INFINITY);
            }
            let parent = elements[e].parent as usize;
            if elements[parent].is_cluster() {
                sizes[parent] = sizes[parent].min(sizes[e]);
            }
        }
        let known = |e: usize| if sizes[e].is_finite() { sizes[e] } else { 2.0 * elements[e].radius };
        self.feature_sizes = (0..elements.len()).map(known).collect();
    }

    /// The feature size of a surface element: its own, or its diameter.
    pub(super) fn size_of(&self, element: usize) -> f32 {
        self.given_size(element).unwrap_or(2.0 * self.elements.elements[element].radius)
    }

    /// The feature size of a surface element that is not just its diameter: what its side has for itself, else what is given
    /// for all, grown by √(I_max / I) where the importance I is but indirect. An error there shows as a shadow of the size
    /// given would where it matters most: I s² is the same. I is at least [`super::importance::LEAST`] of I_max, so sizes
    /// grow by 7 at most. Diameters need no such rule: elements that matter little are large.
    pub(super) fn given_size(&self, element: usize) -> Option<f32> {
        let Shape::Surface { side, .. } = self.elements.elements[element].shape else { return None };
        let own = self.sizes.own[side as usize];
        if own.is_finite() {
            return Some(own);
        }
        let direct = self.important.get(side as usize).copied().unwrap_or(true);
        let importance = self.importance.get(element).copied().filter(|_| !direct).unwrap_or(1.0);
        self.sizes.all.map(|size| size / importance.sqrt())
    }
}
