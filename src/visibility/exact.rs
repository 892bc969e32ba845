//! Exact visibility: one Embree occlusion ray per segment.

use super::answer::{Answer, Bundle, Cost, Method, wilson};
use crate::embree::{CommittedScene, Traversal};
use crate::ray::{Occluder, Packet};

/// The exact engine.
#[derive(Clone)]
pub struct Exact {
    /// The scene in Embree.
    pub scene: CommittedScene,
    /// Traversal of the packets.
    pub traversal: Traversal,
}

impl Exact {
    /// Traces all segments of a bundle. `blocked` is scratch memory, kept between calls.
    pub fn answer(&self, bundle: Bundle, blocked: &mut Vec<u32>) -> Answer {
        blocked.clear();
        blocked.resize(bundle.packets.len(), 0);
        self.occluded(bundle.packets, blocked);
        let segments: u64 = bundle.packets.iter().map(|p| p.len() as u64).sum();
        let stopped: u64 = blocked.iter().map(|b| u64::from(b.count_ones())).sum();
        let n = segments.max(1) as f32;
        let transmittance = 1.0 - stopped as f32 / n;
        let (lo, hi) = wilson(transmittance, n);
        let cost = Cost { segments, exact_rays: segments, ..Cost::default() };
        Answer { transmittance, lo, hi, method: Method::Exact, cost }
    }
}

impl Occluder for Exact {
    fn occluded(&self, packets: &[Packet], blocked: &mut [u32]) {
        self.scene.occluded_by(self.traversal, packets, blocked);
    }
}

/// The fastest Embree traversal for packets like `sample`, by timing each (best of two rounds).
///
/// Traversals whose results differ from those of single rays in any segment are excluded, so that the choice affects no
/// result: some compilers break Embree's coherent packets. `native_width` is [`crate::embree::Device::native_width`].
#[cfg(any(test, feature = "reports"))]
pub fn fastest_traversal(scene: &CommittedScene, native_width: usize, sample: &[Packet]) -> Traversal {
    let single = Traversal { width: 1, coherent: false };
    let mut reference = vec![0; sample.len()];
    scene.occluded_by(single, sample, &mut reference);
    let mut found = vec![0; sample.len()];
    let mut best = (f64::INFINITY, single);
    for width in [1, 4, 8, 16].into_iter().filter(|&w| w == 1 || w <= native_width) {
        for coherent in [false, true].into_iter().filter(|&c| width > 1 || !c) {
            let traversal = Traversal { width, coherent };
            let seconds = (0..2)
                .map(|_| {
                    let start = std::time::Instant::now();
                    scene.occluded_by(traversal, sample, &mut found);
                    start.elapsed().as_secs_f64()
                })
                .fold(f64::INFINITY, f64::min);
            let wrong: u32 = reference.iter().zip(&found).map(|(a, b)| (a ^ b).count_ones()).sum();
            if seconds < best.0 && wrong == 0 {
                best = (seconds, traversal);
            }
        }
    }
    best.1
}
