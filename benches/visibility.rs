//! Times of single steps of the traversal, of whole traversals, and of Embree's ray calls, on a forest: `cargo bench
//! --bench visibility`.

use divan::{Bencher, black_box, counter::ItemsCount};
use mrvis::Model;
use mrvis::internals::bench::{Workload, surface_points};
use mrvis::internals::embree::Traversal;
use mrvis::internals::ray::{Occluder, Packet};
use mrvis::internals::scene::generate;
use mrvis::internals::simd::Isa;
use mrvis::internals::visibility::{Bundle, Exact, LeafMode, MultiResolution, Step, Workspace};
use mrvis::internals::{multi_resolution, native_width, traced};
use std::sync::OnceLock;

fn main() {
    divan::main();
}

/// Feature sizes: below all clusters, in between, above most clusters.
const SIZES: [f32; 3] = [0.05, 0.3, 1.0];
const ISAS: [Isa; 3] = [Isa::Portable, Isa::Avx2, Isa::Avx512];
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
    FOREST.get_or_init(|| Forest::new(false))
}

/// The same with trees that are instances of meshes.
fn placed_forest() -> &'static Forest {
    static FOREST: OnceLock<Forest> = OnceLock::new();
    FOREST.get_or_init(|| Forest::new(true))
}

impl Forest {
    fn new(instances: bool) -> Forest {
        let spec = generate::Spec { trees: 16, leaves: 600, instances, ..generate::Spec::new("forest") };
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

    fn engine(&self, isa: Isa) -> MultiResolution {
        let traversal = Traversal { width: 1, coherent: false };
        multi_resolution(&self.model, traversal, LeafMode::Exact).with_isa(isa)
    }

    fn bundles(&self) -> Vec<Bundle<'_>> {
        let packets = self.packets.chunks(self.packets.len() / BUNDLES);
        packets.map(|packets| Bundle { packets, emitter_size: self.emitter_size, emitter: &[] }).collect()
    }
}

/// Measures a step if the machine has the instruction set.
fn measure(forest: &Forest, bencher: Bencher, isa: Isa, step: Step) {
    if !isa.available() {
        return;
    }
    let engine = forest.engine(isa);
    let steps = engine.steps(&forest.packets[..1]);
    let items = ItemsCount::new(steps.items(step));
    bencher.counter(items).bench_local(|| black_box(&steps).run(black_box(step)));
}

#[divan::bench(args = ISAS)]
fn shaft(bencher: Bencher, isa: Isa) {
    measure(forest(), bencher, isa, Step::Shaft);
}

#[divan::bench(args = ISAS)]
fn nodes_of_sixteen_children(bencher: Bencher, isa: Isa) {
    measure(forest(), bencher, isa, Step::Nodes(0.3));
}

#[divan::bench(args = ISAS)]
fn blocks_of_sixteen_triangles(bencher: Bencher, isa: Isa) {
    measure(forest(), bencher, isa, Step::Blocks);
}

#[divan::bench(args = ISAS)]
fn instances_entered(bencher: Bencher, isa: Isa) {
    measure(placed_forest(), bencher, isa, Step::Enter);
}

#[divan::bench(args = ISAS)]
fn boxes_with_extinction(bencher: Bencher, isa: Isa) {
    measure(forest(), bencher, isa, Step::Slabs);
}

/// Bundles one by one, each from the root.
#[divan::bench(args = SIZES)]
fn walks_alone(bencher: Bencher, s: f32) {
    let forest = forest();
    let (engine, bundles) = (forest.engine(Isa::detect()), forest.bundles());
    let mut workspace = Workspace::default();
    bencher.counter(ItemsCount::new(BUNDLES * RAYS)).bench_local(|| {
        bundles.iter().map(|&bundle| engine.answer(bundle, s, &mut workspace).transmittance).sum::<f32>()
    });
}

/// Neighbouring bundles together.
#[divan::bench(args = SIZES)]
fn walks_in_groups(bencher: Bencher, s: f32) {
    let forest = forest();
    let (engine, bundles) = (forest.engine(Isa::detect()), forest.bundles());
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
