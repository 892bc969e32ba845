//! The distance cut against Embree at equal error, by class of receiver, on one thread:
//! `cargo bench --bench distance_cut -- SCENE... [--points N] [--reach C]... [--size S]... [--rays N]...`
//!
//! A scene is a file, or `forest:TREES:LEAVES` for a generated one. A row states time and error of one number of segments, and how much
//! longer Embree's fastest call takes to the same error, interpolated between 1, 4, 16, ... 1,024 rays. Reach 0 averages nothing; NaN stands for that of
//! the pilot.
//! Class 0 has nothing near that cannot be averaged, others one, and steps of four blocks of sixteen triangles.

use mrvis::internals::bench::{Order, Workload, surface_points};
use mrvis::internals::embree::Traversal;
use mrvis::internals::ray::{Occluder, Packet};
use mrvis::internals::scene::{Scene, generate};
use mrvis::internals::visibility::{Bundle, Cut, Exact, fastest_traversal};
use mrvis::internals::{cut, native_width, traced};
use mrvis::{Detail, Model, PrepareOptions};
use std::time::Instant;

/// Numbers of exact rays that errors are interpolated between.
const EXACT: [usize; 6] = [1, 4, 16, 64, 256, 1024];
/// Rays of each of the two halves of the reference.
const REFERENCE: usize = 1024;

struct Arguments {
    scenes: Vec<String>,
    points: usize,
    reaches: Vec<f32>,
    sizes: Vec<f32>,
    rays: Vec<usize>,
}

impl Arguments {
    fn read() -> Arguments {
        let (mut scenes, mut points) = (vec![], 2000);
        let (mut reaches, mut sizes, mut rays) = (vec![], vec![], vec![]);
        let mut words = std::env::args().skip(1);
        while let Some(word) = words.next() {
            let mut value = || words.next().expect("a value").parse::<f32>().expect("a number");
            match word.as_str() {
                "--bench" => {}
                "--points" => points = value() as usize,
                "--reach" => reaches.push(value()),
                "--size" => sizes.push(value()),
                "--rays" => rays.push(value() as usize),
                _ => scenes.push(word),
            }
        }
        let or = |list: Vec<f32>, default: &[f32]| if list.is_empty() { default.to_vec() } else { list };
        let rays = if rays.is_empty() { vec![16, 64] } else { rays };
        Arguments { scenes, points, reaches: or(reaches, &[0.0, f32::NAN]), sizes: or(sizes, &[1e-6]), rays }
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
    let options = PrepareOptions::default().with_detail(Detail::Rays);
    let model = Model::prepare(scene(name), &options, &()).expect("a model");
    let triangles = model.scene().triangle_count();
    let start = Instant::now();
    let Some(cut) = cut(&model) else {
        println!("{name}: no cut");
        return;
    };
    let (seconds, bytes) = (start.elapsed().as_secs_f64(), cut.bytes() as f64 / triangles as f64);
    let (reach, factor) = cut.fit();
    println!(
        "{name}: {triangles} triangles, cut {seconds:.2} s, {bytes:.1} bytes a triangle, reach {reach}, factor {factor:.3}"
    );
    let points = surface_points(&model, 20 * arguments.points, 1).expect("points");
    let low = points.iter().map(|p| p.position.z).fold(f32::MAX, f32::min);
    let high = points.iter().map(|p| p.position.z).fold(f32::MIN, f32::max);
    let workload = Workload::new(&model, points, 1);
    let classes: Vec<(usize, bool)> = (0..workload.pairs.len())
        .map(|pair| {
            let mut packets = Vec::new();
            workload.add_bundle(model.scene(), pair, (16, Order::Near), 0, &mut packets);
            cut.class_and_use(&bundle(&workload, pair, &packets))
        })
        .collect();
    let is_ground = |pair: usize| {
        let point = workload.points[workload.pairs[pair].point as usize];
        point.normal.z > 0.9 && point.position.z < low + 0.02 * (high - low)
    };
    let all = Receivers { model: &model, workload: &workload, arguments };
    all.class(&cut, "all", |_| true);
    all.class(&cut, "ground", is_ground);
    for class in 0..6 {
        let used = classes.contains(&(class, true));
        let name = format!("class {class}, {}", if used { "used" } else { "not used" });
        all.class(&cut, &name, |pair| classes[pair].0 == class);
    }
}

fn bundle<'a>(workload: &'a Workload, pair: usize, packets: &'a [Packet]) -> Bundle<'a> {
    Bundle { packets, emitter_size: workload.pairs[pair].emitter_size, emitter: workload.hull(pair) }
}

struct Receivers<'a> {
    model: &'a Model,
    workload: &'a Workload,
    arguments: &'a Arguments,
}

impl Receivers<'_> {
    fn class(&self, cut: &Cut, name: &str, is_in: impl Fn(usize) -> bool) {
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
        let exact = self.exact_rows(&pairs, &reference);
        let visible = reference[0].iter().sum::<f32>() / pairs.len() as f32;
        println!(
            "  {name}: part {part:.3}, visible {visible:.3}, Embree {:.0} ns a ray, RMS of 16 {:.4}, of 64 {:.4}",
            exact[2].1 * 1e9 / 16.0,
            exact[2].0,
            exact[3].0
        );
        for &rays in &self.arguments.rays {
            let mut packets = Vec::new();
            for &pair in &pairs {
                self.workload.add_bundle(self.model.scene(), pair, (rays, Order::Near), 0, &mut packets);
            }
            let of_pair = packets.chunks(rays.div_ceil(16)).zip(&pairs);
            let bundles: Vec<Bundle> =
                of_pair.map(|(packets, &pair)| bundle(self.workload, pair, packets)).collect();
            for &s in &self.arguments.sizes {
                for &reach in &self.arguments.reaches {
                    let mut cut = cut.clone();
                    if reach.is_finite() {
                        cut.set(reach);
                    }
                    row(&cut, (rays, s, reach), &bundles, &reference, &exact);
                }
            }
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

    /// RMS error and time a pair, seconds, of each number of rays.
    fn exact_rows(&self, pairs: &[usize], reference: &[Vec<f32>; 2]) -> Vec<(f64, f64)> {
        let row = |&rays: &usize| {
            let (part, mut packets) = (&pairs[..pairs.len().min((1 << 19) / rays)], Vec::new());
            self.workload.packed(self.model.scene(), part, rays, 0, &mut packets);
            let (scene, width) = (traced(self.model), native_width(self.model));
            let traversal = fastest_traversal(scene, width, &packets[..packets.len().min(1024)]);
            let engine = Exact { scene: scene.clone(), traversal };
            let mut blocked = vec![0; packets.len()];
            let seconds = best(|| engine.occluded(&packets, &mut blocked));
            let visible: Vec<f32> = (0..part.len()).map(|k| clear(&blocked, k * rays, rays)).collect();
            (errors(&visible, reference).0, seconds / part.len() as f64)
        };
        EXACT.iter().map(row).collect()
    }
}

fn row(
    cut: &Cut,
    (rays, s, reach): (usize, f32, f32),
    bundles: &[Bundle],
    reference: &[Vec<f32>; 2],
    exact: &[(f64, f64)],
) {
    let (mut visible, mut counts) = (Vec::new(), [0u64; 2]);
    cut.sums(bundles, s, |sums| {
        visible.push(sums.transmittance / sums.segments.max(1) as f32);
        counts = [counts[0] + u64::from(sums.nodes), counts[1] + u64::from(sums.blocks)];
    });
    let mut sink = 0.0;
    let seconds = best(|| cut.sums(bundles, s, |sums| sink += sums.transmittance)) / bundles.len() as f64;
    let (rms, bias) = errors(&visible, reference);
    let [nodes, blocks] = counts.map(|count| count as f64 / (bundles.len() * rays) as f64);
    println!(
        "    {rays} segments, s {s}, reach {reach}: {:.0} ns, {nodes:.1} nodes, {blocks:.1} blocks, RMS {rms:.4}, bias {bias:+.4}, \
         {:.2} times as fast",
        seconds * 1e9 / rays as f64,
        time_to(exact, rms) / seconds
    );
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
