//! Times of whole traversals and of Embree's ray calls on a forest: `cargo bench --bench visibility`.

use divan::{Bencher, counter::ItemsCount};
use mrvis::Model;
use mrvis::internals::bench::{Workload, surface_points};
use mrvis::internals::embree::Traversal;
use mrvis::internals::ray::{Occluder, Packet};
use mrvis::internals::scene::generate;
use mrvis::internals::visibility::{Bundle, Exact, LeafMode, MultiResolution, Workspace};
use mrvis::internals::{multi_resolution, native_width, traced};
use std::sync::OnceLock;

fn main() {
    divan::main();
}

/// Feature sizes: below all clusters, in between, above most clusters.
const SIZES: [f32; 3] = [0.05, 0.3, 1.0];
const RAYS: usize = 16;
const BUNDLES: usize = 256;

/// 16 trees of 600 leaves, and bundles of neighbouring points.
struct Forest {
    model: Model,
    packets: Vec<Packet>,
    emitter_size: f32,
}

fn forest() -> &'static Forest {
    static FOREST: OnceLock<Forest> = OnceLock::new();
    FOREST.get_or_init(Forest::new)
}

impl Forest {
    fn new() -> Forest {
        let spec = generate::Spec { trees: 16, leaves: 600, ..generate::Spec::new("forest") };
        let scene = generate::build(&spec).expect("a forest");
        let model = Model::prepare(scene, &Default::default()).expect("a model");
        let scene = model.scene();
        let points = surface_points(&model, 20_000, 1).expect("points");
        let workload = Workload::new(&model, points, 1);
        let first = workload.pairs.len() / 2;
        let mut packets = Vec::new();
        (first..first + BUNDLES).for_each(|pair| workload.add_bundle(scene, pair, RAYS, 0, &mut packets));
        let emitter_size = workload.pairs[first].emitter_size;
        Forest { model: model.clone(), packets, emitter_size }
    }

    fn engine(&self) -> MultiResolution {
        let traversal = Traversal { width: 1, coherent: false };
        multi_resolution(&self.model, traversal, LeafMode::Exact)
    }

    fn bundles(&self) -> Vec<Bundle<'_>> {
        let packets = self.packets.chunks(self.packets.len() / BUNDLES);
        packets.map(|packets| Bundle { packets, emitter_size: self.emitter_size, emitter: &[] }).collect()
    }
}

/// Bundles one by one, each from the root.
#[divan::bench(args = SIZES)]
fn walks_alone(bencher: Bencher, s: f32) {
    let forest = forest();
    let (engine, bundles) = (forest.engine(), forest.bundles());
    let mut workspace = Workspace::default();
    bencher.counter(ItemsCount::new(BUNDLES * RAYS)).bench_local(|| {
        bundles.iter().map(|&bundle| engine.answer(bundle, s, &mut workspace).transmittance).sum::<f32>()
    });
}

/// Neighbouring bundles together.
#[divan::bench(args = SIZES)]
fn walks_in_groups(bencher: Bencher, s: f32) {
    let forest = forest();
    let (engine, bundles) = (forest.engine(), forest.bundles());
    let mut workspace = Workspace::default();
    bencher.counter(ItemsCount::new(BUNDLES * RAYS)).bench_local(|| {
        let mut sum = 0.0;
        engine.answers(&bundles, s, &mut workspace, |answer| sum += answer.transmittance);
        sum
    });
}

/// The same segments by Embree, `width` rays per call.
#[divan::bench(args = [1, 4, 8, 16])]
fn exact_packets(bencher: Bencher, width: usize) {
    let forest = forest();
    if width > native_width(&forest.model) {
        return;
    }
    let traversal = Traversal { width, coherent: false };
    let exact = Exact { scene: traced(&forest.model).clone(), traversal };
    let mut blocked = vec![0; forest.packets.len()];
    bencher.counter(ItemsCount::new(BUNDLES * RAYS)).bench_local(|| {
        exact.occluded(&forest.packets, &mut blocked);
        blocked[0]
    });
}
