//! Refinement keeps links because of their measurement, which biases them; measuring again removes the bias.

use super::*;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::refinement::{link_errors, refine, remeasure_links};

const SEEDS: u64 = 300;

/// A floor, a lamp above it, and a table's top in between.
fn table() -> Scene {
    let around = |half: f64| ([0.07 - half, 0.07 + half], [0.03 - half, 0.03 + half]);
    let ([floor, top, lamp], mut pieces) = ([2.0, 0.5, 0.4].map(around), Pieces::empty());
    pieces.grey("floor", 0.2).polygon(&facing_up(floor.0, floor.1, 0.0));
    pieces.grey("top", 0.2).polygon(&facing_up(top.0, top.1, 0.8));
    pieces.glowing("lamp", 10.0).polygon(&facing_down(lamp.0, lamp.1, 2.0));
    pieces.scene()
}

/// Mean irradiance of the floor under the table, |x|, |y| < 1, by links that are measured again or not, for each seed.
fn under(scene: &Scene, seeds: std::ops::RangeInclusive<u64>, again: bool) -> Vec<f64> {
    let mut options = Options { error: 0.3, min_area: 1e-4, ..Options::default() };
    let deadline = Deadline::start(&(), None);
    let model = model_for(scene, &options);
    let mut by_seed = Vec::new();
    for seed in seeds {
        options.seed = seed;
        let mut linked = visibility::linked(&model, &options);
        const THRESHOLD: f32 = 5e-3;
        for _ in 0..3 {
            let errors = [link_errors(&linked), Vec::new()];
            refine(&mut linked, &errors, THRESHOLD, false, &|_| false, &());
            let nodes = linked.active_nodes();
            linked.iterate(&nodes, 1e-3, 12, &deadline);
            linked.update_oracle_statistics();
        }
        if again {
            remeasure_links(&mut linked, THRESHOLD, 0.0, &deadline);
        }
        let nodes = linked.active_nodes();
        linked.iterate(&nodes, 1e-5, 40, &deadline);
        let (mut sum, mut all) = (0.0, 0.0);
        for (e, element) in linked.elements.elements.iter().enumerate() {
            let crate::radiosity::elements::Shape::Surface { side, .. } = element.shape else { continue };
            let side = &linked.elements.sides[side as usize];
            let on_floor = side.front && scene.triangle_object[side.triangles[0] as usize] == 0;
            let inner = (element.centre - glam::Vec3::new(0.07, 0.03, 0.0)).abs().max_element() < 1.0;
            if element.is_leaf() && on_floor && inner {
                sum += element.area * mean(linked.elements.states[e].irradiance);
                all += element.area;
            }
        }
        assert!((all - 4.0).abs() < 1e-3, "leaves of a metre or less: {all}");
        by_seed.push(sum / all);
    }
    by_seed
}

#[test]
fn kept_links_are_less_biased_when_looked_at_again() {
    let scene = table();
    let n = 24;
    let at = |k: usize| (2.0 * (k as f64 + 0.5) / f64::from(n)) - 1.0;
    let place = |k: usize| DVec3::new(at(k % n as usize) + 0.07, at(k / n as usize) + 0.03, 0.0);
    let points: Vec<Point> =
        (0..(n * n) as usize).map(|k| Point { position: place(k), normal: DVec3::Z }).collect();
    let truth: f64 = limits::truth(&scene, &points, 512).iter().sum::<f64>() / points.len() as f64;
    let bias = |again: bool| {
        let off: Vec<f64> = under(&scene, 1..=SEEDS, again).iter().map(|e| e / truth - 1.0).collect();
        let mean = off.iter().sum::<f64>() / SEEDS as f64;
        let spread = off.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (SEEDS * (SEEDS - 1)) as f64;
        (mean, spread.sqrt())
    };
    let (once, again) = (bias(false), bias(true));
    // Most of what is left is the bias of a quotient: of what a few rays carry, clear by all.
    assert!(again.0.abs() < 0.02 && again.0.abs() < 0.7 * once.0.abs(), "{once:?} {again:?}");
}
