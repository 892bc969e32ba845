//! The command `mrvis`.

fn main() {}
