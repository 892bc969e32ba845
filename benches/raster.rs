//! Time of the largest inscribed disc in silhouettes as characterisation meets them: `cargo bench --bench raster`.

use divan::{Bencher, black_box};
use mrvis::raster::{BitImage, Edt, Outside};

fn main() {
    divan::main();
}

/// Kinds of silhouette: a few leaves, many leaves, one box that fills nearly all, the gaps of the many leaves.
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

#[divan::bench(args = [64, 256, 1024])]
fn squared_distances(bencher: Bencher, n: usize) {
    let image = &silhouettes("dense", n)[0];
    let mut edt = Edt::new();
    bencher.bench_local(|| edt.squared_distances(black_box(image), Outside::Free).len());
}
