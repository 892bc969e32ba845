//! Disjoint sets.

/// Disjoint sets of `0..n` (union by smaller root: the root is the first member).
pub struct Sets(Vec<u32>);

impl Sets {
    /// A set for each number.
    pub fn new(n: usize) -> Self {
        Sets((0..n as u32).collect())
    }

    /// The first member of the set of `i`.
    pub fn root(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            let up = self.0[self.0[i as usize] as usize];
            self.0[i as usize] = up;
            i = up;
        }
        i
    }

    /// Joins the sets of `a` and `b`.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
