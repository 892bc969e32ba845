//! The distance cut against Embree at equal error, by class of receiver, on one thread:
//! `cargo bench --features internals --bench distance_cut -- SCENE... [--points N] [--rays N]... [--width W FACTOR]...`
//!
//! A scene is a file, or `forest:TREES:LEAVES` for a generated one. A row states time and error of one number of segments in a mode, how
//! much longer Embree's fastest call takes to the same error, interpolated between 1, 4, 16, ... 1,024 rays, and the part of the stated
//! intervals that hold. Widths are relative to the emitter's; `--width` adds one with this factor of extinctions.

use mrvis::internals::bench::{Workload, surface_points};
use mrvis::internals::embree::Traversal;
use mrvis::internals::ray::{Occluder, Packet};
use mrvis::internals::scene::{Scene, generate};
use mrvis::internals::visibility::{Answer, Bundle, Cut, Exact, Mode, Sums, fastest_traversal};
use mrvis::internals::{cut, native_width, traced};
use mrvis::{Detail, Model, PrepareOptions};
use std::time::Instant;

/// Numbers of exact rays that errors are interpolated between.
const EXACT: [usize; 6] = [1, 4, 16, 64, 256, 1024];
/// Rays of each of the two halves of the reference.
const REFERENCE: usize = 1024;
/// Rays that are traced together.
const TOGETHER: usize = 1 << 16;

struct Arguments {
    scenes: Vec<String>,
    points: usize,
    rays: Vec<usize>,
    widths: Vec<(f32, f32)>,
}

impl Arguments {
    fn read() -> Arguments {
        let mut all = Arguments { scenes: vec![], points: 2000, rays: vec![], widths: vec![] };
        let mut words = std::env::args().skip(1);
        while let Some(word) = words.next() {
            let mut value = || words.next().expect("a value").parse::<f32>().expect("a number");
            match word.as_str() {
                "--bench" => {}
                "--points" => all.points = value() as usize,
                "--rays" => all.rays.push(value() as usize),
                "--width" => all.widths.push((value(), value())),
                _ => all.scenes.push(word),
            }
        }
        if all.rays.is_empty() {
            all.rays = vec![16, 64, 256];
        }
        all
    }
}

fn main() {
    let arguments = Arguments::read();
    for scene in &arguments.scenes {
        measure(scene, &arguments);
    }
}

fn scene(name: &str) -> Scene {
    let mut words = name.split(':');
    if words.next() != Some("forest") {
        return Scene::load(name).expect("a scene");
    }
    let mut number = || words.next().expect("forest:TREES:LEAVES").parse().expect("a number");
    let (trees, leaves) = (number(), number());
    generate::build(&generate::Spec { trees, leaves, ..generate::Spec::new("forest") }).expect("a forest")
}

fn measure(name: &str, arguments: &Arguments) {
    let mut options = PrepareOptions::default();
    options.detail = Detail::Rays;
    let model = Model::prepare(scene(name), &options).expect("a model");
    let triangles = model.scene().triangle_count();
    let start = Instant::now();
    let cut = cut(&model);
    let seconds = start.elapsed().as_secs_f64();
    let Some(cut) = cut else {
        println!("{name}: {triangles} triangles, {seconds:.2} s; the cut pays nowhere");
        return;
    };
    let bytes = cut.bytes() as f64 / triangles as f64;
    println!("{name}: {triangles} triangles, cut {seconds:.2} s, {bytes:.1} bytes a triangle");
    for mode in cut.modes() {
        println!("  width {}", mode.width);
        for (class, fit) in mode.fits.iter().enumerate() {
            println!("    class {class}: {fit:?}, gain {:.2}", fit.gain());
        }
    }
    let points = surface_points(&model, 20 * arguments.points, 1).expect("points");
    let low = points.iter().map(|p| p.position.z).fold(f32::MAX, f32::min);
    let high = points.iter().map(|p| p.position.z).fold(f32::MIN, f32::max);
    let workload = Workload::new(&model, points, 1);
    let is_ground = |pair: usize| {
        let point = workload.points[workload.pairs[pair].point as usize];
        point.normal.z > 0.9 && point.position.z < low + 0.02 * (high - low)
    };
    let all = Receivers { model: &model, workload: &workload, cut: &cut, arguments };
    all.class("all", |_| true);
    all.class("ground", is_ground);
    all.class("others", |pair| !is_ground(pair));
}

fn bundle<'a>(workload: &'a Workload, pair: usize, packets: &'a [Packet]) -> Bundle<'a> {
    Bundle {
        packets,
        emitter_size: workload.pairs[pair].emitter_size,
        emitter: workload.hull_of_surface(pair),
    }
}

struct Receivers<'a> {
    model: &'a Model,
    workload: &'a Workload,
    cut: &'a Cut,
    arguments: &'a Arguments,
}

impl Receivers<'_> {
    fn class(&self, name: &str, is_in: impl Fn(usize) -> bool) {
        let of_class: Vec<usize> = (0..self.workload.pairs.len()).filter(|&pair| is_in(pair)).collect();
        let part = of_class.len() as f64 / self.workload.pairs.len() as f64;
        // Neighbours stay neighbours: runs of 64.
        let runs: Vec<&[usize]> = of_class.chunks(64).collect();
        let step = (of_class.len() / self.arguments.points).max(1);
        let pairs: Vec<usize> = runs.into_iter().step_by(step).flatten().copied().collect();
        if pairs.len() < 200 {
            return;
        }
        let reference = [1, 2].map(|stream| self.reference(&pairs, stream));
        let exact = EXACT.map(|rays| self.exact(&pairs, rays, &reference));
        let visible = reference[0].iter().sum::<f32>() / pairs.len() as f32;
        println!(
            "  {name}: part {part:.3}, visible {visible:.3}, Embree {:.0} ns a ray, RMS of 16 {:.4}, of 64 {:.4}, of 256 {:.4}",
            exact[2].1 * 1e9 / 16.0,
            exact[2].0,
            exact[3].0,
            exact[4].0
        );
        for &rays in &self.arguments.rays {
            self.rows(&pairs, rays, &reference, &exact);
        }
    }

    fn rows(&self, pairs: &[usize], rays: usize, reference: &[Vec<f32>; 2], exact: &[(f64, f64)]) {
        let mut packets = Vec::new();
        for &pair in pairs {
            self.workload.add_bundle(self.model.scene(), pair, rays, 0, &mut packets);
        }
        let of_pair = packets.chunks(rays.div_ceil(16)).zip(pairs);
        let bundles: Vec<Bundle> =
            of_pair.map(|(packets, &pair)| bundle(self.workload, pair, packets)).collect();
        let counts = |all: &Sums, seconds: f64| {
            let n = f64::from(all.segments);
            let per = |count: u32| f64::from(count) / n;
            let [nodes, blocks] = [all.nodes, all.blocks].map(per);
            let [node_tests, block_tests] = [all.node_tests, all.block_tests].map(per);
            let work = [all.work() / n, all.embree_work() / n];
            let ns = seconds * 1e9 / n;
            format!(
                "nodes {nodes:.2}, blocks {blocks:.2}, tests {node_tests:.2} {block_tests:.2}, work {work:.1?}, {ns:.0} ns"
            )
        };
        let sum = |answer: &dyn Fn(&Bundle) -> Sums| {
            let mut all = Sums::default();
            let seconds = best(|| {
                all = Sums::default();
                bundles.iter().for_each(|bundle| all.add(answer(bundle)));
            });
            counts(&all, seconds)
        };
        println!("    {rays} segments, nothing averaged: {}", sum(&|bundle| self.cut.exact_sums(bundle)));
        let given = self.arguments.widths.iter().map(|&(width, factor)| Mode::unmeasured(width, factor));
        for mode in self.cut.modes().iter().copied().chain(given) {
            let counts = sum(&|bundle| self.cut.sums(bundle, &mode));
            let mut found = Vec::new();
            let seconds = best(|| {
                found.clear();
                self.cut.answers(&bundles, &mode, |answer, _| found.push(answer));
            });
            let visible: Vec<f32> = found.iter().map(|answer| answer.transmittance).collect();
            let holds = held(&found, reference);
            let what = format!("width {}, {counts}, intervals hold {holds:.3}", mode.width);
            print_row((rays, &what), &visible, seconds / bundles.len() as f64, reference, exact);
        }
    }

    fn reference(&self, pairs: &[usize], stream: u64) -> Vec<f32> {
        let traversal = Traversal { width: native_width(self.model), coherent: false };
        let engine = Exact { scene: traced(self.model).clone(), traversal };
        let (mut visible, mut packets) = (Vec::new(), Vec::new());
        for part in pairs.chunks(64) {
            self.workload.packed(self.model.scene(), part, REFERENCE, stream, &mut packets);
            let mut blocked = vec![0; packets.len()];
            engine.occluded(&packets, &mut blocked);
            visible.extend((0..part.len()).map(|k| clear(&blocked, k * REFERENCE, REFERENCE)));
        }
        visible
    }

    /// Embree with its fastest call for packets like these.
    fn engine(&self, packets: &[Packet]) -> Exact {
        let (scene, width) = (traced(self.model), native_width(self.model));
        let traversal = fastest_traversal(scene, width, &packets[..packets.len().min(1024)]);
        Exact { scene: scene.clone(), traversal }
    }

    /// RMS error of so many exact rays, and their time a pair, seconds.
    fn exact(&self, pairs: &[usize], rays: usize, reference: &[Vec<f32>; 2]) -> (f64, f64) {
        let (mut visible, mut seconds, mut packets) = (Vec::new(), 0.0, Vec::new());
        let mut engine = None;
        for part in pairs.chunks(TOGETHER / rays) {
            self.workload.packed(self.model.scene(), part, rays, 0, &mut packets);
            let engine = engine.get_or_insert_with(|| self.engine(&packets));
            let mut blocked = vec![0; packets.len()];
            seconds += best(|| engine.occluded(&packets, &mut blocked));
            visible.extend((0..part.len()).map(|k| clear(&blocked, k * rays, rays)));
        }
        (errors(&visible, reference).0, seconds / pairs.len() as f64)
    }
}

fn print_row(
    (rays, what): (usize, &str),
    visible: &[f32],
    seconds: f64,
    reference: &[Vec<f32>; 2],
    exact: &[(f64, f64)],
) {
    let (rms, bias) = errors(visible, reference);
    println!(
        "    {rays} segments, {what}: {:.0} ns, RMS {rms:.4}, bias {bias:+.4}, {:.2} times as fast",
        seconds * 1e9 / rays as f64,
        time_to(exact, rms) / seconds
    );
}

/// Part of the intervals that hold the fraction of the reference.
fn held(found: &[Answer], [a, b]: &[Vec<f32>; 2]) -> f64 {
    let holds =
        |((answer, a), b): &((&Answer, &f32), &f32)| (answer.lo..=answer.hi).contains(&(0.5 * (*a + *b)));
    found.iter().zip(a).zip(b).filter(holds).count() as f64 / found.len() as f64
}

/// RMS error and mean error; the noise of the reference cancels between its halves.
fn errors(visible: &[f32], [a, b]: &[Vec<f32>; 2]) -> (f64, f64) {
    let (mut square, mut bias) = (0.0, 0.0);
    for ((&x, &a), &b) in visible.iter().zip(a).zip(b) {
        square += f64::from(x - a) * f64::from(x - b);
        bias += f64::from(x - 0.5 * (a + b));
    }
    let n = visible.len() as f64;
    ((square / n).max(1e-12).sqrt(), bias / n)
}

fn clear(blocked: &[u32], first: usize, count: usize) -> f32 {
    let stopped = (first..first + count).filter(|i| blocked[i / 16] >> (i % 16) & 1 == 1).count();
    1.0 - stopped as f32 / count as f32
}

/// The shortest of three times, seconds.
fn best(mut run: impl FnMut()) -> f64 {
    let mut time = || {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    };
    (0..3).map(|_| time()).fold(f64::INFINITY, f64::min)
}

/// Time in which exact rays reach an error.
fn time_to(exact: &[(f64, f64)], rms: f64) -> f64 {
    let k = (1..exact.len() - 1).find(|&k| exact[k].0 < rms).unwrap_or(exact.len() - 1);
    let ((a, s), (b, t)) = (exact[k - 1], exact[k]);
    let part = (rms.ln() - a.ln()) / (b.ln() - a.ln());
    (s.ln() + part * (t.ln() - s.ln())).exp()
}
