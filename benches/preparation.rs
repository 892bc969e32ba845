//! Times of the update of a model: `cargo bench --features reports --bench preparation`. Those of its preparation are in the record of
//! `mrvis bench`.

use divan::Bencher;
use mrvis::internals::scene::generate;
use mrvis::{InstanceChange, Model, PrepareOptions};

fn main() {
    divan::main();
}

/// Moves instances of a forest of `n` trees of 100 leaves: the trees of Embree and of groups above them, nothing below.
#[divan::bench(args = [(1_000, 1), (1_000, 100), (10_000, 1), (10_000, 100), (100_000, 1), (100_000, 100)], sample_count = 10)]
fn update(bencher: Bencher, (n, changed): (usize, usize)) {
    let spec = generate::Spec { trees: n, leaves: 100, instances: true, ..generate::Spec::new("forest") };
    let scene = generate::build(&spec).expect("a forest");
    let mut model = Model::prepare(scene, &PrepareOptions::default()).expect("a model");
    let mut round = 0;
    bencher.bench_local(|| {
        round += 1;
        let changes: Vec<InstanceChange> = (0..changed)
            .map(|k| 1 + (round * 7919 + k * (n / changed)) % n)
            .map(|i| {
                let mut transform = model.instances()[i].transform;
                transform[0][3] += 0.37;
                transform[1][3] -= 0.21;
                InstanceChange::Move { instance: i as u32, transform }
            })
            .collect();
        model = model.update(&changes).expect("updated");
    });
}
