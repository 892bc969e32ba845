//! Units of work: about one test of a box or triangle against a packet. Walks count their work in them. The three numbers are
//! estimates that select between engines and change no answer of either.

/// Work of the shaft test of a node of sixteen boxes: one for each of the six rows of bounds.
pub(super) const NODE: u64 = 6;
/// Work of rejecting the triangles of a block by its shaft. Twice that of a node: nine rows of corners and edges, and
/// their cross products.
pub(super) const BLOCK: u64 = 12;
/// Work that accounts for the cache miss of a node, in trees larger than the caches near a core: nearly two nodes.
pub(super) const FETCH: u64 = 10;
