//! The compiled module, which the tests in Python import. This test is the reason that `cargo test` compiles it.

/// Python looks for this function in a module of this name.
#[test]
fn the_library_is_a_module_of_python() {
    let folder = std::env::current_exe().expect("a path").ancestors().nth(1).expect("a folder").to_path_buf();
    let library = std::fs::read(folder.join("lib_mrvis.so")).expect("the module");
    let name = b"\0PyInit__mrvis\0";
    assert!(library.windows(name.len()).any(|part| part == name));
}
