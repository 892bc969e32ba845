//! Links: the light that two elements exchange, how it is measured, and how wrong it may be.
//!
//! A link serves both directions. With the coupling `C = ∫∫ K V` over both ends (`K = cos cos' / π r²`), `A_a F(a→b) T =
//! A_b F(b→a) T = C`: reciprocity holds exactly, and the power that goes from b to a is `C B_b`. Unoccluded factor and
//! transmittance are kept apart. Knows where light can go, not how much there is: brightness comes as an argument.

mod between;
mod ends;
mod measure;
mod oracle;
mod sight;
#[cfg(test)]
mod tests;

pub use ends::{cosine_direction, mix, numbers, point_on};
pub use measure::{Care, Inside, Meter};
pub use oracle::{Light, Oracle, Split, judge};
pub use sight::{Question, Scratch, Sight, Tally, across};

/// The exchange of two elements, or of the parts of one cluster with each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// One end.
    pub a: u32,
    /// The other; the same for the inside of a cluster.
    pub b: u32,
    /// `A_a F(a→b) T`, scene units squared.
    pub coupling: f32,
    /// Visible part of the unoccluded exchange, in `[0, 1]`.
    pub transmittance: f32,
    /// How much the coupling varies over each end: the standard deviation that places (and, for clusters, directions)
    /// in it have about the mean; scene units squared.
    pub variation: [f32; 2],
    /// Standard error of the coupling, from sampling; scene units squared.
    pub noise: f32,
    /// Segments traced.
    pub rays: u32,
    /// What is known to stand between the ends, without a ray.
    pub between: Between,
}

/// What stands between two ends, as far as geometry says for certain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Between(u32);

impl Between {
    /// Nothing: all segments get through, those between parts too.
    pub const NOTHING: Between = Between(u32::MAX);
    /// One surface that every segment meets.
    pub const WALL: Between = Between(u32::MAX - 1);
    /// Not known.
    pub const SOMETHING: Between = Between(u32::MAX - 2);

    /// A side of [`crate::radiosity::elements::Elements::sides`] that is in the way of some segments, perhaps.
    fn by(side: u32) -> Between {
        Between(side)
    }

    fn side(self) -> Option<u32> {
        (self.0 < Between::SOMETHING.0).then_some(self.0)
    }
}

impl Link {
    /// Standard deviation that the transmittance of a segment between parts of the ends is expected to have: that of this
    /// link's (at most √(T (1 - T)), method A.9), and what so many segments that all got through, or none, leave possible.
    pub fn mixed(&self) -> f32 {
        if self.between == Between::NOTHING {
            return 0.0;
        }
        // Two more segments, one of each kind (Agresti and Coull 1998).
        let n = self.rays as f32;
        let t = (n * self.transmittance + 1.0) / (n + 2.0);
        (t * (1.0 - t)).sqrt()
    }
}
