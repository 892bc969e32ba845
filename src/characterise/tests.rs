use super::*;
use glam::Vec3;

#[test]
fn axis_mix_surrounds_the_direction() {
    let n = 21;
    for i in 0..n * n * n {
        let d = Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32) - Vec3::splat(10.3);
        let mix = AxisMix::around(d);
        let sum: f32 = mix.weights.iter().sum();
        assert!((sum - 1.0).abs() < 1e-5 && mix.weights.iter().all(|&w| w >= -1e-6), "{d}: {mix:?}");
        // Unnormalised axes, turned to the direction's side, add up to it.
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
