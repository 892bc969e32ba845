//! The 13 axes and the interpolation between them.

use super::*;
use glam::DQuat;

#[test]
fn axis_mix_surrounds_the_direction() {
    let n = 21;
    for i in 0..n * n * n {
        let d = Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32) - Vec3::splat(10.3);
        let mix = AxisMix::around(d);
        let sum: f32 = mix.weights.iter().sum();
        assert!((sum - 1.0).abs() < 1e-5 && mix.weights.iter().all(|&w| w >= -1e-6), "{d}: {mix:?}");
        // The unnormalised axes, turned to the direction's side and weighted, sum to the direction.
        let length = [1.0f32, 2.0f32.sqrt(), 3.0f32.sqrt()];
        let back: Vec3 = (0..3)
            .map(|k| {
                let axis = AXES[mix.axes[k]];
                mix.weights[k] * length[k] * axis * axis.dot(d).signum()
            })
            .sum();
        assert!((back - d / d.abs().max_element()).length() < 1e-5, "{d}: {back}");
    }
}

#[test]
fn thirteen_axes_are_the_neighbours_of_a_cell() {
    for (i, a) in AXES.iter().enumerate() {
        assert!((a.length() - 1.0).abs() < 1e-6);
        let cell = a.to_array().map(|c| c.partial_cmp(&0.0).expect("a number") as i32 as f32);
        assert!((Vec3::from(cell).normalize() - a).length() < 1e-6, "axis {i} points at no neighbour");
        assert!(AXES[..i].iter().all(|b| a.dot(*b).abs() < 0.99), "axis {i} is there twice");
        let mix = AxisMix::around(-2.5 * a);
        let own = mix.axes.iter().zip(mix.weights).find(|(axis, _)| **axis == i);
        assert!(own.is_some_and(|(_, w)| (w - 1.0).abs() < 1e-5), "axis {i} is not its own mix: {mix:?}");
    }
}

/// A disc perpendicular to an axis has its largest blocker size along that axis: indices are not mixed up.
#[test]
fn each_axis_measures_its_own_direction() {
    for (k, &view) in AXES.iter().enumerate() {
        let turn = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, view.as_dvec3()));
        let corners: Vec<DVec3> = (0..48)
            .map(|i| turn * (DMat3::from_rotation_z(f64::from(i) * std::f64::consts::TAU / 48.0) * DVec3::X))
            .collect();
        let mut disc = Pieces::new();
        disc.polygon(&corners);
        let optics = whole(disc, &options());
        let largest =
            (0..AXIS_COUNT).max_by(|&a, &b| optics.blocker_size[a].total_cmp(&optics.blocker_size[b]));
        assert_eq!(largest, Some(k), "{optics:?}");
        assert!(
            (optics.blocker_size[k] - 2.0).abs() < 0.12,
            "axis {k}: a disc of diameter 2 measures {}",
            optics.blocker_size[k]
        );
    }
}
