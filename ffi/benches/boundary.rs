//! What the C interface adds to a batch of a million segments: the same call in Rust and from C (`-O2`) in turn, in one process, on one
//! model, on one thread: `cargo bench -p mrvis-ffi --bench boundary`. Times are those of the processor, which other programs
//! disturb little. Fails if the interface adds more than 3 %.

#![allow(unsafe_code)]

use mrvis::{Answers, Engine, Method, Model, PrepareOptions, Scene, Segments};
use std::ffi::{CString, c_void};
use std::hint::black_box;
use std::process::{Command, ExitCode};

/// Segments of a batch, and of a bundle.
const SEGMENTS: usize = 1_000_000;
const RAYS: usize = 16;
/// Pairs of calls; their order alternates. More are measured until the interval of their median leaves the limit out, up to so many.
const PAIRS: usize = 15;
const MAX_PAIRS: usize = 120;
/// Largest ratio of the times.
const LIMIT: f64 = 1.03;
/// Feature size, scene units: most clusters of the scene are averaged.
const SIZE: f32 = 0.3;

/// The C interface, compiled into this program: its functions are called with the model that Rust asks.
#[allow(dead_code, unused_imports)]
#[path = "../src/lib.rs"]
mod capi;

unsafe extern "C" {
    fn mrv_visibility_answer(
        model: *const c_void,
        engine: i32,
        segments: *const c_void,
        answers: *const c_void,
        cost: *mut c_void,
    ) -> i32;
}

type Answer = unsafe extern "C" fn(*const c_void, i32, *const c_void, *const c_void, *mut c_void) -> i32;
type Ask = unsafe extern "C" fn(
    Answer,
    *const c_void,
    i32,
    *const f32,
    *const f32,
    *const u64,
    u64,
    f32,
    *mut f32,
    *mut f32,
    *mut f32,
    *mut u8,
) -> i32;

/// Compiles the C side and loads it.
fn c_side(folder: &tempfile::TempDir) -> Ask {
    let root = env!("CARGO_MANIFEST_DIR");
    let library = folder.path().join("boundary.so");
    let done = Command::new("cc")
        .args(["-O2", "-shared", "-fPIC", "-std=c99", "-Wall", "-Wextra", "-o"])
        .arg(&library)
        .arg(format!("-I{root}/include"))
        .arg(format!("{root}/benches/boundary.c"))
        .status()
        .expect("cc runs");
    assert!(done.success());
    let path = CString::new(library.display().to_string()).expect("a path");
    // SAFETY: the library was just compiled, and its function has this type; it stays loaded.
    unsafe {
        let handle = libc::dlopen(path.as_ptr(), libc::RTLD_NOW);
        assert!(!handle.is_null());
        let symbol = libc::dlsym(handle, c"ask".as_ptr());
        assert!(!symbol.is_null());
        std::mem::transmute::<*mut c_void, Ask>(symbol)
    }
}

/// Processor seconds of this process.
fn cpu_seconds() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the place is a local variable.
    let status = unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &raw mut time) };
    assert_eq!(status, 0);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// A batch between random points of the scene's box: bundles begin at one point near the ground.
struct Batch {
    origins: Vec<[f32; 3]>,
    targets: Vec<[f32; 3]>,
    offsets: Vec<u64>,
}

impl Batch {
    fn new(scene: &Scene) -> Batch {
        let mut state = 1u32;
        let mut draw = |low: f64, high: f64| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (low + (high - low) * f64::from(state >> 8) / 16_777_216.0) as f32
        };
        let [low, high] = scene.bounds();
        let (mut origins, mut targets, mut offsets) = (Vec::new(), Vec::new(), vec![0]);
        for _ in 0..SEGMENTS / RAYS {
            let from = [draw(low[0], high[0]), draw(low[1], high[1]), draw(low[2], high[2])];
            let to = [draw(low[0], high[0]), draw(low[1], high[1]), draw(low[2], high[2])];
            for _ in 0..RAYS {
                origins.push(from);
                targets.push(to.map(|t| t + draw(0.0, 0.1)));
            }
            offsets.push(origins.len() as u64);
        }
        Batch { origins, targets, offsets }
    }
}

/// The median of the ratio, and the interval that holds it with a probability of 95 % or more: order statistics at n / 2 ± 0.98 √n, two
/// standard deviations of a binomial count with p = 1/2, rounded outwards.
fn median_and_interval(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    let n = values.len() as f64;
    let low = (n / 2.0 - 0.98 * n.sqrt()).floor().max(1.0) as usize;
    [values[values.len() / 2], values[low - 1], values[values.len() - low]]
}

fn main() -> ExitCode {
    let mut holds = true;
    let folder = tempfile::tempdir().expect("a folder");
    let ask = c_side(&folder);
    let scene = Scene::generate("cubes").expect("a scene");
    let batch = Batch::new(&scene);
    let mut options = PrepareOptions::default();
    options.threads = 1;
    let model = Model::prepare(scene, &options).expect("a model");
    let handle = capi::model_handle(model.clone());
    let bundles = batch.offsets.len() - 1;
    for (number, engine) in [(1, Engine::Exact), (2, Engine::MultiResolution)] {
        let visibility = model.visibility().with_engine(engine);
        let mut rust =
            (vec![0.0; bundles], vec![0.0; bundles], vec![0.0; bundles], vec![Method::Clear; bundles]);
        let mut c = (vec![0.0; bundles], vec![0.0; bundles], vec![0.0; bundles], vec![0u8; bundles]);
        let mut in_rust = || {
            let start = cpu_seconds();
            let segments =
                Segments::new(&batch.origins[..], &batch.targets[..], &batch.offsets).feature_size(SIZE);
            let mut answers =
                Answers::new(&mut rust.0).intervals(&mut rust.1, &mut rust.2).methods(&mut rust.3);
            black_box(visibility.answer_into(&segments, &mut answers)).expect("answers");
            cpu_seconds() - start
        };
        let mut from_c = || {
            let start = cpu_seconds();
            // SAFETY: the arrays have as many entries as the C side says, and the handle is live.
            let status = unsafe {
                ask(
                    mrv_visibility_answer,
                    handle,
                    number,
                    batch.origins.as_ptr().cast(),
                    batch.targets.as_ptr().cast(),
                    batch.offsets.as_ptr(),
                    bundles as u64,
                    SIZE,
                    c.0.as_mut_ptr(),
                    c.1.as_mut_ptr(),
                    c.2.as_mut_ptr(),
                    c.3.as_mut_ptr(),
                )
            };
            assert_eq!(status, 0);
            cpu_seconds() - start
        };
        in_rust();
        from_c();
        let (mut ratios, mut seconds) = (Vec::new(), Vec::new());
        let mut found = [0.0, 0.0, f64::INFINITY];
        for pair in 0..MAX_PAIRS {
            let [r, c] = if pair % 2 == 0 {
                let r = in_rust();
                [r, from_c()]
            } else {
                let c = from_c();
                [in_rust(), c]
            };
            ratios.push(c / r);
            seconds.push(r);
            if (pair + 1) % PAIRS == 0 {
                found = median_and_interval(ratios.clone());
                if found[2] <= LIMIT || found[1] > LIMIT {
                    break;
                }
            }
        }
        assert!(rust.0 == c.0 && rust.1 == c.1 && rust.2 == c.2, "C and Rust differ");
        // An interval that the limit lies in after all pairs: the median decides.
        let [ratio, low, high] = found;
        holds &= ratio <= LIMIT;
        println!(
            "{engine:?}: {SEGMENTS} segments, Rust {:.1} ms, C / Rust {ratio:.4}, {low:.4} to {high:.4} (median of {} pairs), limit {LIMIT}",
            1e3 * median_and_interval(seconds)[0],
            ratios.len()
        );
    }
    if holds { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
