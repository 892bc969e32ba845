use super::*;
use glam::Vec3;

#[test]
fn nearest_axis_is_the_one_with_the_largest_cosine() {
    let n = 41;
    for i in 0..n {
        for j in 0..n {
            for k in 0..n {
                let d = Vec3::new(i as f32, j as f32, k as f32) - Vec3::splat(20.3);
                let best = AXES.iter().map(|a| a.dot(d).abs()).fold(0.0, f32::max);
                let found = AXES[nearest_axis(d)].dot(d).abs();
                assert!(found >= best * (1.0 - 1e-6), "{d}: {found} < {best}");
            }
        }
    }
}
