//! Times of preparing a scene: clusters, optics, and reading both from a cache file: `cargo bench --features internals --bench
//! preparation`.

use divan::{Bencher, counter::ItemsCount};
use mrvis::internals::cache::{self, CacheLocation, Origin, PreparedClusters};
use mrvis::internals::clusters;
use mrvis::internals::optics::{self, Extinction};
use mrvis::internals::scene::generate;
use mrvis::{InstanceChange, Model, PrepareOptions, Scene};

fn main() {
    divan::main();
}

fn forest(trees: usize) -> Scene {
    let spec = generate::Spec { trees, leaves: 500, ..generate::Spec::new("forest") };
    generate::build(&spec).expect("a forest")
}

#[divan::bench(args = [9, 36], sample_count = 5)]
fn clusters(bencher: Bencher, trees: usize) {
    let scene = forest(trees);
    bencher
        .counter(ItemsCount::new(scene.triangle_count()))
        .bench_local(|| clusters::build(&scene, &Default::default()));
}

#[divan::bench(args = [Extinction::Analytic, Extinction::Measured], sample_count = 5)]
fn measures(bencher: Bencher, extinction: Extinction) {
    let scene = forest(9);
    let tree = clusters::build(&scene, &Default::default()).micro;
    let options = optics::Options { extinction, ..Default::default() };
    bencher
        .counter(ItemsCount::new(scene.triangle_count()))
        .bench_local(|| optics::measure(&scene, &tree, &options));
}

#[divan::bench(args = [9, 100], sample_count = 20)]
fn cache_hit(bencher: Bencher, trees: usize) {
    let (scene, options) = (forest(trees), cache::Options::default());
    let folder = tempfile::tempdir().expect("scratch folder");
    let place = CacheLocation::Folder(folder.path().to_owned());
    let make = || {
        let hierarchy = clusters::build(&scene, &options.clusters);
        let optics = optics::measure(&scene, &hierarchy.micro, &options.optics);
        PreparedClusters { hierarchy, optics }
    };
    cache::load_or_make(&scene, &place, &options, make);
    bencher.counter(ItemsCount::new(scene.triangle_count())).bench_local(|| {
        let (table, origin, _) = cache::load_or_make(&scene, &place, &options, make);
        assert_eq!(origin, Origin::Hit);
        table
    });
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
