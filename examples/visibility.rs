//! Which part of the light is visible from a row of points, exactly and by clusters: `cargo run --release --example visibility`.

use mrvis::{Answers, Engine, Model, PrepareOptions, Scene, Segments, Strided};

fn main() -> mrvis::Result<()> {
    let scene = match std::env::args().nth(1) {
        Some(path) => Scene::load(path)?,
        None => Scene::generate("cubes")?,
    };
    let model = Model::prepare(scene, &PrepareOptions::default())?;
    let [low, high] = model.scene().bounds();
    let visibility = model.visibility();
    let exact = visibility.clone().with_engine(Engine::Exact);
    let at = |axis: usize, part: f64| low[axis] + part * (high[axis] - low[axis]);
    println!("     x      exact  clusters");
    for k in 1..10 {
        let point = [at(0, k as f64 / 10.0), at(1, 0.5), at(2, 1e-3)];
        let ask = |v: &mrvis::Visibility| {
            v.from_point(point, [0.0, 0.0, 1.0]).to_source(0).feature_size(0.2).rays(256).answer()
        };
        let (exact, clusters) = (ask(&exact)?, ask(&visibility)?);
        println!("{:7.2} {:9.3} {:9.3}", point[0], exact.transmittance, clusters.transmittance);
    }
    // Many segments at once: from the corners of a grid, each a bundle of its own, to one point above.
    let grid: Vec<[f32; 3]> =
        (0..10_000).map(|k| [(k % 100) as f32 / 100.0, (k / 100) as f32 / 100.0, 0.01]).collect();
    let top = [at(0, 0.5) as f32, at(1, 0.5) as f32, at(2, 0.9) as f32];
    let bundles: Vec<u64> = (0..=grid.len() as u64).collect();
    let segments = Segments::new(&grid[..], Strided::repeated(&top, grid.len()), &bundles);
    let mut clear = vec![0.0; grid.len()];
    let cost = visibility.answer_into(&segments, &mut Answers::new(&mut clear))?;
    println!("{} of {} segments are clear", clear.iter().sum::<f32>(), cost.segments);
    Ok(())
}
