//! The light in a room, and irradiance along its floor: `cargo run --release --example solve`.

use mrvis::{Detail, Model, PrepareOptions, Progress, Scene, SolveOptions, SurfacePoint};

/// Says what goes on.
struct Talk;

impl Progress for Talk {
    fn stage(&self, name: &str, _steps: u64) {
        eprintln!("{name}");
    }
}

fn main() -> mrvis::Result<()> {
    let scene = Scene::generate("cornell")?;
    let mut prepare = PrepareOptions::default();
    prepare.detail = Detail::Clusters;
    let mut options = SolveOptions::default();
    let model = Model::prepare(scene, &prepare.with_progress(Talk))?;
    options.error = 0.05;
    let light = model.with_progress(Talk).solve(&options)?;
    let points: Vec<SurfacePoint> = (1..10)
        .map(|k| SurfacePoint { position: [55.0 * f64::from(k), 0.0, 30.0], normal: [0.0, 1.0, 0.0] })
        .collect();
    println!("     x        red      green       blue  W/m\u{b2}");
    for (point, [red, green, blue]) in points.iter().zip(light.irradiance(&points)?) {
        println!("{:6} {red:10.3} {green:10.3} {blue:10.3}", point.position[0]);
    }
    let report = light.report();
    let error = report.error_estimate.map_or("unknown".into(), |e| format!("{:.1} %", 100.0 * e));
    println!("{} elements, estimated error {error}", report.elements);
    Ok(())
}
