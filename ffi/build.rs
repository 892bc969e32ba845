//! Where `libmrvis.so` and the tests search for Embree.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let embree = std::env::var("DEP_EMBREE4_LIB").expect("the library says where Embree is");
    println!("cargo:rustc-link-arg=-Wl,-rpath,{embree}");
    // An installed shared library finds a private Embree beside itself, wherever it is moved. The number of its soname changes with the
    // binary interface.
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("linux") {
        println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libmrvis.so.0");
        println!("cargo:rustc-cdylib-link-arg=-Wl,-rpath,$ORIGIN/mrvis");
    }
}
