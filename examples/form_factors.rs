//! Form factors between the objects of a room: `cargo run --release --example form_factors`.

use mrvis::{Detail, FormFactorOptions, Grouping, Model, PrepareOptions, Scene};

fn main() -> mrvis::Result<()> {
    let scene = Scene::generate("cornell")?;
    let model = Model::prepare(scene, &PrepareOptions::default().with_detail(Detail::Rays), &())?;
    let options = FormFactorOptions::default().with_grouping(Grouping::Object);
    let factors = model.form_factors(&options, &())?;
    for (from, name) in factors.names().iter().enumerate() {
        print!("{name:>12}");
        for to in 0..factors.len() {
            print!(" {:7.4}", factors.factor(from, to));
        }
        println!("   {:6.4} escapes", factors.escaped()[from]);
    }
    println!("{} rays, rows are off by {:.1e} before closure", factors.rays(), factors.row_sum_error());
    Ok(())
}
