//! Paths by which error bars are checked.

use super::visibility::refined;
use super::*;
use crate::form_factors::analytic::point_to_polygon;
use crate::math::sampling::{point_on, sobol};
use crate::radiosity::elements::Shape;
use crate::radiosity::final_gather::{Buffers, FinalGather};

/// The light of elements of a floor below a lamp: in closed form and with next to no noise; and with a plate over half of the floor, as
/// the path tracer finds it.
#[test]
fn paths_of_the_audit_have_the_light_of_elements() {
    let lamp = facing_down([-0.5, 0.5], [-0.5, 0.5], 1.0);
    for blocked in [false, true] {
        let mut pieces = Pieces::empty();
        pieces.grey("floor", 0.0).polygon(&facing_up([-1.0, 1.0], [-1.0, 1.0], 0.0));
        pieces.glowing("lamp", 10.0).polygon(&lamp);
        if blocked {
            pieces.grey("plate", 0.0).polygon(&facing_up([0.0, 2.0], [-2.0, 2.0], 0.5));
        }
        let (scene, options) = (pieces.scene(), Options::default());
        let free = |p: &Point| 10.0 * std::f64::consts::PI * point_to_polygon(p.position, p.normal, &lamp);
        refined(&scene, &options, |linked| {
            let model = model_for(&scene, &options);
            let gather = FinalGather::new(&model, linked, &options);
            let mut checked = 0;
            for leaf in linked.leaves().into_iter().step_by(7) {
                let Shape::Surface { side, corners } = linked.elements.elements[leaf as usize].shape else {
                    continue;
                };
                let normal = linked.elements.sides[side as usize].normal;
                if normal.z < 0.9 || corners[0].z != 0.0 {
                    continue;
                }
                let point = |k: u32| {
                    let [u, v, ..] = sobol(k, 0, 7);
                    Point { position: point_on(&corners, u, v).as_dvec3(), normal: DVec3::Z }
                };
                let points: Vec<Point> = (0..256).map(point).collect();
                let light = match blocked {
                    true => super::limits::truth(&scene, &points, 64),
                    false => points.iter().map(free).collect(),
                };
                let want = light.iter().sum::<f64>() / light.len() as f64;
                let (found, noise) = gather.path_irradiance(leaf, 256, 1, &mut Buffers::default());
                let tolerance = if blocked { 5.0 * noise + 0.01 * want + 1e-3 } else { 2e-3 * want };
                assert!((found - want).abs() < tolerance, "{leaf}: {found} instead of {want}, noise {noise}");
                assert!(blocked || noise < 1e-3 * want, "{noise} of {want}");
                checked += 1;
            }
            assert!(checked >= 5, "{checked}");
        });
    }
}

/// A lamp hangs above the plane of another one's back, which lies in the plane of its front: no light passes between these two.
#[test]
fn the_back_of_a_lamp_gets_none_of_its_own_light() {
    let mut pieces = Pieces::empty();
    pieces.grey("room", 0.5).room(DVec3::ZERO, DVec3::new(4.0, 5.0, 2.8));
    pieces.glowing("level lamp", 50.0).polygon(&facing_down([1.0, 1.8], [2.0, 3.0], 2.7));
    let (edge, slope) = (DVec3::new(2.2, 2.1, 2.7), DVec3::new(0.0, 1.2, -0.2));
    pieces.glowing("tilted lamp", 50.0).rectangle(edge, slope, 0.8 * DVec3::X);
    let options = Options { audit: 200, ..coarse() };
    let audit = solved(&pieces.scene(), &[], &options).record.audit.expect("an audit");
    assert!(audit.elements >= 50 && audit.expected_rms < 0.1, "{audit:?}");
}
