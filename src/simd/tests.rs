//! All instruction sets against portable code, bit by bit; `decay` against the exponential.

use super::*;
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

const ALL: [Isa; 3] = [Isa::Portable, Isa::Avx2, Isa::Avx512];

fn available() -> impl Iterator<Item = Isa> {
    ALL.into_iter().filter(|isa| isa.available())
}

/// Applies every operation to one set of operands; returns the results as bit patterns with names.
struct EveryOperation {
    a: [f32; LANES],
    b: [f32; LANES],
    half: [u16; LANES],
    mask: u32,
}

impl Kernel for EveryOperation {
    type Output = Vec<(&'static str, Vec<u32>)>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Self::Output {
        let (a, b) = (simd.load(&self.a), simd.load(&self.b));
        let m = simd.mask(self.mask);
        let words = |v: S::F| {
            let mut lanes = [0.0; LANES];
            simd.store(v, &mut lanes);
            lanes.map(f32::to_bits).to_vec()
        };
        let truth = |m: S::M| vec![simd.bits(m)];
        vec![
            ("splat", words(simd.splat(self.a[3]))),
            ("load", words(a)),
            ("load_half", words(simd.load_half(&self.half))),
            ("load_whole", words(simd.load_whole(&self.half))),
            ("add", words(simd.add(a, b))),
            ("sub", words(simd.sub(a, b))),
            ("mul", words(simd.mul(a, b))),
            ("div", words(simd.div(a, b))),
            ("min", words(simd.min(a, b))),
            ("max", words(simd.max(a, b))),
            ("abs", words(simd.abs(a))),
            ("root", words(simd.root(a))),
            ("select", words(simd.select(m, a, b))),
            ("keep", words(simd.keep(m, a))),
            ("le", truth(simd.le(a, b))),
            ("lt", truth(simd.lt(a, b))),
            ("and", truth(simd.and(m, simd.lt(a, b)))),
            ("or", truth(simd.or(m, simd.lt(a, b)))),
            ("and_not", truth(simd.and_not(m, simd.lt(a, b)))),
            ("mask", truth(m)),
            ("fma", words(simd.fma(a, b, simd.abs(a)))),
            ("sum_twos", words(simd.sum_twos(a))),
            ("sum_fours", words(simd.sum_fours(a))),
            ("sum", vec![simd.sum(a).to_bits()]),
            ("decay", words(decay(simd, simd.abs(a)))),
        ]
    }
}

/// Smallest and largest lane; operands must not be NaN.
struct Extremes([f32; LANES]);

impl Kernel for Extremes {
    type Output = (f32, f32);

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> (f32, f32) {
        let v = simd.load(&self.0);
        (simd.least(v), simd.greatest(v))
    }
}

/// Equal bit patterns, or both NaN: the payload of a NaN is unspecified.
fn same(a: u32, b: u32) -> bool {
    a == b || (f32::from_bits(a).is_nan() && f32::from_bits(b).is_nan())
}

const SPECIAL: [f32; 16] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    1e-40,
    -1e-40,
    1e30,
    1e-30,
    80.0,
    f32::EPSILON,
];

/// A special value, an arbitrary bit pattern, or a number in [-10, 10].
fn value(random: &mut Pcg64Mcg) -> f32 {
    let word = random.next_u32();
    match word % 4 {
        0 => SPECIAL[(word >> 4) as usize % SPECIAL.len()],
        1 => f32::from_bits(random.next_u32()),
        _ => (random.next_u32() as f32 / u32::MAX as f32 - 0.5) * 20.0,
    }
}

#[test]
fn every_instruction_set_computes_the_same_bits() {
    let mut random = Pcg64Mcg::new(7);
    for round in 0..4000 {
        let a = std::array::from_fn(|_| value(&mut random));
        let b =
            std::array::from_fn(
                |i| if random.next_u32().is_multiple_of(8) { a[i] } else { value(&mut random) },
            );
        let half = std::array::from_fn(|_| random.next_u32() as u16);
        let mask = random.next_u32() & 0xffff;
        let run = |isa| dispatch(isa, EveryOperation { a, b, half, mask });
        let truth = run(Isa::Portable);
        for isa in available() {
            for ((name, expect), (_, found)) in truth.iter().zip(run(isa)) {
                let equal =
                    expect.len() == found.len() && expect.iter().zip(&found).all(|(&x, &y)| same(x, y));
                assert!(equal, "{name} on {}, round {round}: {a:?} {b:?} {mask:x}", isa.name());
            }
        }
        let numbers = a.map(|v| if v.is_nan() { 2.5 } else { v });
        let (least, greatest) = (numbers.into_iter().reduce(f32::min), numbers.into_iter().reduce(f32::max));
        for isa in available() {
            let found = dispatch(isa, Extremes(numbers));
            assert_eq!((Some(found.0), Some(found.1)), (least, greatest), "{}: {numbers:?}", isa.name());
        }
    }
}

/// All instruction sets against scalar arithmetic on small operands.
#[test]
fn operations_do_what_they_are_called() {
    let a = std::array::from_fn(|i| i as f32 - 4.0);
    let b = [2.0; LANES];
    let half = [0x3f80; LANES];
    for isa in available() {
        let results = dispatch(isa, EveryOperation { a, b, half, mask: 0b101 });
        let word =
            |name: &str, lane: usize| results.iter().find(|(n, _)| *n == name).expect("operation").1[lane];
        let number = |name: &str, lane: usize| f32::from_bits(word(name, lane));
        for lane in 0..LANES {
            let x = a[lane];
            assert_eq!(number("splat", lane), a[3]);
            assert_eq!(number("load_half", lane), 1.0);
            assert_eq!(number("load_whole", lane), f32::from(0x3f80_u16));
            assert_eq!([number("add", lane), number("sub", lane)], [x + 2.0, x - 2.0]);
            assert_eq!([number("mul", lane), number("div", lane)], [2.0 * x, x / 2.0]);
            assert_eq!([number("min", lane), number("max", lane)], [x.min(2.0), x.max(2.0)]);
            assert_eq!([number("abs", lane), number("root", lane.max(4))], [x.abs(), a[lane.max(4)].sqrt()]);
            let picked = 0b101 >> lane & 1 == 1;
            assert_eq!(number("select", lane), if picked { x } else { 2.0 });
            assert_eq!(number("keep", lane), if picked { x } else { 0.0 });
            assert_eq!(number("fma", lane), x * 2.0 + x.abs());
            let (two, four) = (lane / 2 * 2, lane / 4 * 4);
            assert_eq!(number("sum_twos", lane), a[two] + a[two + 1]);
            assert_eq!(number("sum_fours", lane), a[four..four + 4].iter().sum::<f32>());
        }
        // a < 2 in lanes 0 to 5, a = 2 in lane 6.
        assert_eq!([word("lt", 0), word("le", 0)], [0b11_1111, 0b111_1111]);
        assert_eq!([word("and", 0), word("or", 0), word("and_not", 0)], [0b101, 0b11_1111, 0]);
        assert_eq!(number("sum", 0), 56.0);
    }
}

#[test]
fn comparisons_with_nan_are_false_and_the_second_operand_is_returned() {
    let (a, b) = ([f32::NAN; LANES], [3.0; LANES]);
    for isa in available() {
        for (a, b, second) in [(a, b, 3.0f32), (b, a, f32::NAN)] {
            let results = dispatch(isa, EveryOperation { a, b, half: [0; LANES], mask: 0 });
            for (name, words) in results {
                match name {
                    "lt" | "le" => assert_eq!(words, [0], "{name}"),
                    "min" | "max" => {
                        assert!(words.iter().all(|&w| same(w, second.to_bits())), "{name} on {}", isa.name());
                    }
                    _ => {}
                }
            }
        }
    }
}

struct Decay([f32; LANES]);

impl Kernel for Decay {
    type Output = [f32; LANES];

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        simd.store(decay(simd, simd.load(&self.0)), &mut out);
        out
    }
}

#[test]
fn decay_is_the_exponential_to_a_hundred_thousandth() {
    let mut x = 0.0f32;
    let mut last = f32::INFINITY;
    while x < 200.0 {
        let xs = std::array::from_fn(|i| x + i as f32 * 1e-3);
        let found = dispatch(Isa::detect(), Decay(xs));
        for (x, y) in xs.into_iter().zip(found) {
            let truth = (-f64::from(x)).exp();
            assert!((f64::from(y) - truth).abs() < 1e-5, "decay({x}) = {y}, not {truth}");
            // At most 1 and never 0: transmittance 0 is reserved for triangles.
            assert!(y > 0.0 && y <= 1.0 && y <= last * (1.0 + 1e-4), "decay({x}) = {y} after {last}");
            last = y;
        }
        x += 16e-3;
    }
    for huge in [1e3, 1e30, f32::INFINITY] {
        let y = dispatch(Isa::detect(), Decay([huge; LANES]))[0];
        assert!((0.0..1e-30).contains(&y), "decay({huge}) = {y}");
    }
}
