//! Times of the largest inscribed disc in typical silhouettes and of the feature-based error of images: `cargo bench
//! --bench raster`.

use divan::{Bencher, black_box};
use mrvis::internals::raster::{BitImage, Edt, Morphology, Outside};
use mrvis::metrics::{FbemOptions, Image, fbem};

fn main() {
    divan::main();
}

/// Kinds of silhouettes: few leaves, many leaves, one large box, the gaps between many leaves.
const KINDS: [&str; 4] = ["sparse", "dense", "solid", "gaps"];

/// Silhouettes of `n` × `n` pixels.
fn silhouettes(kind: &str, n: usize) -> Vec<BitImage> {
    let mut state = 1u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % below
    };
    let leaves = match kind {
        "sparse" => 20,
        "solid" => 1,
        _ => 90,
    };
    let mut make = || {
        let mut image = BitImage::new(n, n);
        for _ in 0..leaves {
            let side = if kind == "solid" { n - 4 } else { n / 16 + random(n / 8) };
            let (left, top) = (random(n - side + 1), random(n - side + 1));
            (top..top + side).for_each(|y| image.set_span(y, left, left + side));
        }
        if kind == "gaps" { image.complement() } else { image }
    };
    (0..64).map(|_| make()).collect()
}

#[divan::bench(args = KINDS, consts = [32, 64])]
fn max_inscribed_diameter<const N: usize>(bencher: Bencher, kind: &str) {
    let images = silhouettes(kind, N);
    let mut edt = Edt::new();
    let mut next = 0;
    bencher.bench_local(|| {
        next = (next + 1) % images.len();
        edt.max_inscribed_diameter(black_box(&images[next]), Outside::Free)
    });
}

#[divan::bench(args = KINDS, consts = [32, 64])]
fn erosions_with_8_neighbours<const N: usize>(bencher: Bencher, kind: &str) {
    let images = silhouettes(kind, N);
    let mut edt = Edt::new();
    let mut next = 0;
    bencher.bench_local(|| {
        next = (next + 1) % images.len();
        edt.largest_size(black_box(&images[next]), Morphology::Paper8, Outside::Free)
    });
}

#[divan::bench(args = [64, 256, 1024])]
fn squared_distances(bencher: Bencher, n: usize) {
    let image = &silhouettes("dense", n)[0];
    let mut edt = Edt::new();
    bencher.bench_local(|| edt.squared_distances(black_box(image), Outside::Free).len());
}

#[divan::bench(args = [256, 1024], sample_count = 10)]
fn feature_based_error(bencher: Bencher, n: usize) {
    let shadow = &silhouettes("dense", n)[0];
    let image = |dark: f32| Image::from_fn(n, n, 1.0, |x, y| if shadow.get(x, y) { dark } else { 1.0 });
    let (Ok(reference), Ok(approximation)) = (image(0.0), image(0.1)) else { return };
    let (sizes, options) = ([n as f64 / 20.0], FbemOptions::default());
    bencher.bench_local(|| fbem(black_box(&reference), &approximation, &sizes, &options).map(|f| f[0].value));
}
