//! Finds Embree 4 and compiles the C shim, which checks `src/embree/sys.rs` against the installed headers. Also computes a hash of the
//! source code that measures clusters; cache files of other code are not used.
//!
//! Search order for Embree 4:
//! 1. `EMBREE_DIR`: a prefix with `include/embree4` and `lib` (or `lib64`, or Debian's `lib/<triplet>`);
//! 2. the system: `/usr/include/embree4/rtcore.h`, also under `/usr/local` and `/opt/homebrew`;
//! 3. the private prefix `.prefix/embree` of the project, which `make` prepares.

use std::collections::hash_map::DefaultHasher;
use std::env;
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};

fn main() {
    println!("cargo:rerun-if-env-changed=EMBREE_DIR");
    println!("cargo:rerun-if-changed=src/embree/shim.h");
    println!("cargo:rerun-if-changed=src/embree/shim.c");
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-env=MRVIS_TABLE_CODE={:016x}", fingerprint(TABLE_ROOMS));

    let embree = find_embree().unwrap_or_else(|message| {
        eprintln!("error: {message}");
        std::process::exit(1)
    });
    println!("cargo:rerun-if-changed={}", embree.include.join("embree4/rtcore_config.h").display());
    println!("cargo:rustc-link-search=native={}", embree.lib.display());
    println!("cargo:rustc-link-lib=dylib=embree4");
    // Tests and examples find the library from any working directory without LD_LIBRARY_PATH.
    println!("cargo:rustc-link-arg=-Wl,-rpath,{}", embree.lib.display());
    // The build scripts of `command` and `ffi` read it: arguments of linking hold for the package alone that gives them.
    println!("cargo:lib={}", embree.lib.display());

    cc::Build::new()
        .file("src/embree/shim.c")
        .include(&embree.include)
        .opt_level(3)
        .flag_if_supported("-std=c11")
        .warnings(true)
        .compile("mrvis_embree_shim");
}

/// Source files that determine the content of cache files: the modules that build and measure clusters, and all modules
/// that these may use. `tests/suite/tidy.rs` compares the list with the table in `src/ARCHITECTURE.md`.
const TABLE_ROOMS: &[&str] = &[
    "src/optics",
    "src/error.rs",
    "src/files",
    "src/clusters",
    "src/image_io",
    "src/math.rs",
    "src/memory.rs",
    "src/metrics",
    "src/options.rs",
    "src/progress.rs",
    "src/raster",
    "src/scene",
    "src/sky",
    "src/terrain",
    "src/threads.rs",
    "Cargo.lock",
];

/// Hash of all files at and below the given paths. It depends on the Rust version and is compared only for equality.
fn fingerprint(paths: &[&str]) -> u64 {
    let mut waiting: Vec<PathBuf> = paths.iter().map(PathBuf::from).collect();
    let mut files = Vec::new();
    while let Some(path) = waiting.pop() {
        println!("cargo:rerun-if-changed={}", path.display());
        match std::fs::read_dir(&path) {
            Ok(entries) => waiting.extend(entries.flatten().map(|e| e.path())),
            Err(_) => files.push(path),
        }
    }
    files.sort();
    let mut hash = DefaultHasher::new();
    for file in files {
        (file.to_string_lossy(), std::fs::read(&file).unwrap_or_default()).hash(&mut hash);
    }
    hash.finish()
}

struct Embree {
    include: PathBuf,
    lib: PathBuf,
}

fn find_embree() -> Result<Embree, String> {
    if let Some(dir) = env::var_os("EMBREE_DIR") {
        let dir = PathBuf::from(dir);
        return probe(&dir).ok_or_else(|| {
            format!(
                "EMBREE_DIR is {}, but include/embree4/rtcore.h or lib/libembree4.so is missing there",
                dir.display()
            )
        });
    }
    let private =
        Path::new(&env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it")).join(".prefix/embree");
    println!("cargo:rerun-if-changed={}", private.display());
    ["/usr", "/usr/local", "/opt/homebrew"].iter().map(Path::new).chain([private.as_path()]).find_map(probe).ok_or(
        "Embree 4 was not found in the system or in .prefix/embree, and EMBREE_DIR is not set. Run `make build` in the \
         project folder, or install the Embree 4 development package of your distribution (Debian 13: libembree-dev)"
            .to_owned(),
    )
}

fn probe(prefix: &Path) -> Option<Embree> {
    let include = prefix.join("include");
    if !include.join("embree4/rtcore.h").is_file() {
        return None;
    }
    let triplet = format!("lib/{}-linux-gnu", env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default());
    ["lib", "lib64", &triplet].iter().map(|l| prefix.join(l)).find_map(|lib| {
        let found = ["libembree4.so", "libembree4.dylib"].iter().any(|f| lib.join(f).exists());
        found.then(|| Embree { include: include.clone(), lib: lib.canonicalize().unwrap_or(lib) })
    })
}
