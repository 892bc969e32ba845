//! Form factors between the objects of a room: `cargo run --release --example form_factors`.

use mrvis::{Detail, FormFactorOptions, Grouping, Model, PrepareOptions, Scene};

fn main() -> mrvis::Result<()> {
    let scene = Scene::generate("cornell")?;
    let mut prepare = PrepareOptions::default();
    prepare.detail = Detail::Rays;
    let model = Model::prepare(scene, &prepare)?;
    let mut options = FormFactorOptions::default();
    options.grouping = Grouping::Object;
    let factors = model.form_factors(&options)?;
    for (from, name) in factors.names.iter().enumerate() {
        print!("{name:>12}");
        for to in 0..factors.names.len() {
            print!(" {:7.4}", factors.factor(from, to));
        }
        println!("   {:6.4} escapes", factors.escaped[from]);
    }
    println!("{} rays, rows are off by {:.1e} before closure", factors.rays, factors.row_sum_error);
    Ok(())
}
