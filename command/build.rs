//! Where the command and its tests search for Embree.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let embree = std::env::var("DEP_EMBREE4_LIB").expect("the library says where Embree is");
    println!("cargo:rustc-link-arg=-Wl,-rpath,{embree}");
    // An installed command finds a private library beside itself, wherever it is moved.
    println!("cargo:rustc-link-arg-bins=-Wl,-rpath,$ORIGIN/../lib/mrvis");
}
