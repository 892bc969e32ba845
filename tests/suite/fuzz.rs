//! Readers of files never panic, hang or take much memory, whatever a file holds.
//!
//! Each reader gets the files of `tests/corpus/READER` and random changes of them for a part of five seconds, or of
//! MRVIS_FUZZ_SECONDS. `make fuzz` searches for an hour instead, guided by the code that is reached (`tests/fuzz`).

use crate::install::project;
use mrvis_command::readers::{NAMES, read, sample_cache};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Seconds of all readers together.
fn seconds() -> f64 {
    std::env::var("MRVIS_FUZZ_SECONDS").map_or(5.0, |n| n.parse().expect("MRVIS_FUZZ_SECONDS is a number"))
}

/// Longest time for an input of at most [`MAX_BYTES`].
const MAX_TIME: Duration = Duration::from_secs(20);
/// Largest input that changes make.
const MAX_BYTES: usize = 1 << 16;

/// Words that occur in the formats, and values at the edges of ranges.
const WORDS: [&str; 40] = [
    "v 0 0 0\n",
    "f 1 2 3\n",
    "f -1 -2 -3\n",
    "vt 0 1\n",
    "usemtl a\n",
    "mtllib a.mtl\n",
    "o a\n",
    "\\\n",
    "/",
    "//",
    "-",
    "Kd 1 0 0\n",
    "Ke 1 1 1\n",
    "d 0.2\n",
    "map_Kd -s 1 1 1 a.png\n",
    "newmtl a\n",
    "Tr 0\n",
    "end_header\n",
    "element face 2\n",
    "property list uchar int vertex_indices\n",
    "element vertex 4000000000\n",
    "1e308",
    "-1e308",
    "nan",
    "inf",
    "1e-320",
    "4294967295",
    "-2147483648",
    "18446744073709551615",
    "9999999999999999999999",
    "0",
    "\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],",
    "\"byteStride\":1,",
    "\"count\":4294967295",
    "\"children\":[0]",
    "\"uri\":\"../../../etc/passwd\"",
    "data:application/octet-stream;base64,",
    "\u{0}",
    "\u{feff}",
    "\"\"\"",
];

struct Fuzzer {
    random: Pcg64Mcg,
    pool: Vec<Vec<u8>>,
}

impl Fuzzer {
    fn below(&mut self, n: usize) -> usize {
        (self.random.next_u64() % n.max(1) as u64) as usize
    }

    fn range(&mut self, length: usize) -> std::ops::Range<usize> {
        let start = self.below(length + 1);
        let longest = [4, 32, length][self.below(3)];
        start..(start + self.below(longest + 1)).min(length)
    }

    /// An input of the pool with some changes.
    fn input(&mut self) -> Vec<u8> {
        let k = self.below(self.pool.len());
        let mut bytes = self.pool[k].clone();
        for _ in 0..1 + self.below(5) {
            self.change(&mut bytes);
        }
        bytes.truncate(MAX_BYTES.max(self.pool[k].len()));
        bytes
    }

    fn change(&mut self, bytes: &mut Vec<u8>) {
        let at = self.below(bytes.len() + 1);
        match self.below(9) {
            0 if at < bytes.len() => bytes[at] ^= 1 << self.below(8),
            1 if at < bytes.len() => bytes[at] = self.random.next_u32() as u8,
            2 => drop(bytes.drain(self.range(bytes.len()))),
            3 => {
                let piece = bytes[self.range(bytes.len())].to_vec();
                drop(bytes.splice(at..at, piece));
            }
            4 => {
                let other = self.below(self.pool.len());
                let range = self.range(self.pool[other].len());
                let piece = self.pool[other][range].to_vec();
                drop(bytes.splice(at..at, piece));
            }
            5 => drop(bytes.splice(at..at, WORDS[self.below(WORDS.len())].bytes())),
            // A number in text.
            6 => {
                let digit = |b: &u8| b.is_ascii_digit() || b"+-.e".contains(b);
                let start = at + bytes[at..].iter().position(digit).unwrap_or(bytes.len() - at);
                let end = start + bytes[start..].iter().take_while(|b| digit(b)).count();
                drop(bytes.splice(start..end, WORDS[21 + self.below(10)].bytes()));
            }
            // A number in binary.
            7 if at + 4 <= bytes.len() => {
                let numbers =
                    [0, 1, 0x7fff_ffff, 0x8000_0000, u32::MAX, f32::NAN.to_bits(), f32::INFINITY.to_bits()];
                bytes[at..at + 4].copy_from_slice(&numbers[self.below(7)].to_le_bytes());
            }
            _ => bytes.truncate(at.max(bytes.len() / 2)),
        }
    }
}

/// Reads an input; whether the reader takes it. The input stays in a file: one that ends the process or takes for ever is there.
fn run(reader: &str, bytes: &[u8]) -> bool {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("fuzz.{reader}"));
    std::fs::write(&path, bytes).expect("written");
    let start = Instant::now();
    let result = std::panic::catch_unwind(|| read(reader, bytes));
    let result = result.unwrap_or_else(|_| panic!("{} panics", path.display()));
    assert!(start.elapsed() < MAX_TIME, "{} takes long", path.display());
    // What a decoder panics at is an error, but one to be known.
    let text = result.as_ref().map_or_else(ToString::to_string, |()| "read".into());
    let suitable = !text.is_empty() && text.len() <= 600 && !text.contains(char::is_control);
    assert!(suitable, "{} has an unsuitable message: {text:?}", path.display());
    result.is_ok()
}

fn fuzz(reader: &str) {
    let folder = project("tests/corpus").join(reader);
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    files.sort();
    let mut pool: Vec<Vec<u8>> = files.iter().map(|f| std::fs::read(f).expect("a file")).collect();
    if reader == "cache" {
        pool.push(sample_cache());
    }
    assert!(!pool.is_empty(), "no files to begin with for {reader}");
    let good = pool.iter().filter(|bytes| run(reader, bytes)).count();
    let mut fuzzer = Fuzzer { random: Pcg64Mcg::new(7), pool };
    let (start, mut inputs) = (Instant::now(), 0);
    while start.elapsed().as_secs_f64() < seconds() / NAMES.len() as f64 {
        run(reader, &fuzzer.input());
        inputs += 1;
    }
    assert!(
        good > 0 && inputs > 50,
        "{reader}: {inputs} inputs; files of the corpus that can be read: {good}"
    );
}

#[test]
fn readers_survive_damaged_files() {
    NAMES.into_iter().for_each(fuzz);
}
