//! Feature sizes of receivers: which shadows on them may be averaged (`docs/method.md`, Links and refinement).

use crate::radiosity::elements::{Elements, Shape};

/// Smallest importance relative to the most important element: bounds the growth of feature sizes to √50 = 7, as the
/// help of option `feature_size` states.
pub const MIN_IMPORTANCE: f64 = 0.02;

/// Sizes that determine feature sizes together with importance, scene units.
pub struct FeatureSizes {
    /// The size given for all receivers.
    pub given: Option<f32>,
    /// The size of each side: given by name, or a few pixels of the nearest camera; infinite if there is neither.
    pub by_side: Vec<f32>,
    /// For each side, whether it is important by itself; empty if every side is.
    pub important: Vec<bool>,
}

impl FeatureSizes {
    /// The feature size of a surface element: the size of its side, or else the size given for all; `None` if its diameter is to be used.
    ///
    /// Where the importance I is only indirect, the size grows by √(I_max / I): an error there has the same visible effect as a
    /// shadow of the given size where I is largest, because I s² is equal. I is at least [`MIN_IMPORTANCE`] of I_max, so that
    /// sizes grow by at most 7. Diameters do not grow: elements of small importance are large already.
    pub fn of_surface(&self, elements: &Elements, element: usize) -> Option<f32> {
        let Shape::Surface { side, .. } = elements.elements[element].shape else { return None };
        let own = self.by_side[side as usize];
        if own.is_finite() {
            return Some(own);
        }
        let direct = self.important.get(side as usize).copied().unwrap_or(true);
        let importance = if direct { 1.0 } else { elements.states[element].importance };
        self.given.map(|size| size / importance.sqrt())
    }

    /// Assigns feature sizes to all elements. The size of a cluster is the smallest of its parts, as one query serves all of them.
    pub fn assign(&self, elements: &mut Elements) {
        let rows = &elements.elements;
        let mut sizes = vec![f32::INFINITY; rows.len()];
        for e in (1..rows.len()).rev() {
            if !rows[e].is_cluster() {
                sizes[e] = self.of_surface(elements, e).unwrap_or(f32::INFINITY);
            }
            let parent = rows[e].parent as usize;
            if rows[parent].is_cluster() {
                sizes[parent] = sizes[parent].min(sizes[e]);
            }
        }
        let Elements { elements, states, .. } = elements;
        for ((state, size), element) in states.iter_mut().zip(sizes).zip(elements.iter()) {
            state.feature_size = if size.is_finite() { size } else { 2.0 * element.radius };
        }
    }
}
