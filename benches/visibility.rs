//! Times of single steps of the traversal, on a forest: `cargo bench --features internals --bench visibility`. Those of whole traversals and
//! of Embree's ray calls are in the record of `mrvis bench`.

use divan::{Bencher, black_box, counter::ItemsCount};
use mrvis::Model;
use mrvis::internals::bench::{Workload, surface_points};
use mrvis::internals::embree::Traversal;
use mrvis::internals::multi_resolution;
use mrvis::internals::ray::Packet;
use mrvis::internals::scene::generate;
use mrvis::internals::simd::Isa;
use mrvis::internals::visibility::{LeafMode, MultiResolution, Step};
use std::sync::OnceLock;

fn main() {
    divan::main();
}

const ISAS: [Isa; 3] = [Isa::Portable, Isa::Avx2, Isa::Avx512];
const RAYS: usize = 16;

/// 16 trees of 600 leaves, and a bundle.
struct Forest {
    model: Model,
    packets: Vec<Packet>,
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
        let points = surface_points(&model, 20_000, 1).expect("points");
        let workload = Workload::new(&model, points, 1);
        let mut packets = Vec::new();
        workload.add_bundle(model.scene(), workload.pairs.len() / 2, RAYS, 0, &mut packets);
        Forest { model, packets }
    }

    fn engine(&self, isa: Isa) -> MultiResolution {
        let traversal = Traversal { width: 1, coherent: false };
        multi_resolution(&self.model, traversal, LeafMode::Exact).with_isa(isa)
    }
}

/// Measures a step if the machine has the instruction set.
fn measure(forest: &Forest, bencher: Bencher, isa: Isa, step: Step) {
    if !isa.available() {
        return;
    }
    let engine = forest.engine(isa);
    let steps = engine.steps(&forest.packets);
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
