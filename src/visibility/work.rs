//! Units of work: about one test of a box or triangle against a packet. Walks count their work in them.

/// Work of a node's shaft test, and of rejecting the triangles of a block. Chosen.
pub(super) const NODE: u64 = 6;
pub(super) const BLOCK: u64 = 12;
/// Work that accounts for the cache miss of a node, in trees larger than the caches near a core. Chosen.
pub(super) const FETCH: u64 = 10;
