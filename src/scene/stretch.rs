//! Deviation of a transform from a similarity.

use glam::DMat3;

/// Largest ratio of a transform's largest to its smallest singular value for which instances share the optics of a mesh. Sizes of
/// clusters scale with the factor of a similarity and extinctions with its inverse: both are off by at most this ratio, a fifth of
/// the default tolerance of cluster optics, 5 %.
pub const MAX_STRETCH: f64 = 1.01;

/// Ratio of the largest to the smallest singular value, at least 1: 1 for a similarity, infinite for a singular matrix, 1 for
/// zero. From the eigenvalues of `mᵀm` in closed form (Smith 1961).
pub fn stretch(m: DMat3) -> f64 {
    let largest = m.to_cols_array().into_iter().fold(0.0, |l: f64, x| l.max(x.abs()));
    if largest == 0.0 {
        return 1.0;
    }
    let m = m * largest.recip();
    let g = m.transpose() * m;
    let mean = (g.x_axis.x + g.y_axis.y + g.z_axis.z) / 3.0;
    let b = g - DMat3::from_diagonal(glam::DVec3::splat(mean));
    let spread = (b.to_cols_array().into_iter().map(|x| x * x).sum::<f64>() / 6.0).sqrt();
    if spread == 0.0 {
        return 1.0;
    }
    let angle = (0.5 * (b * spread.recip()).determinant()).clamp(-1.0, 1.0).acos() / 3.0;
    let largest = mean + 2.0 * spread * angle.cos();
    let smallest = mean + 2.0 * spread * (angle + std::f64::consts::TAU / 3.0).cos();
    // Below this the smallest eigenvalue is rounding.
    if smallest <= 1e-14 * largest { f64::INFINITY } else { (largest / smallest).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn stretch_of_transforms() {
        let turn = DMat3::from_quat(DQuat::from_xyzw(0.1, -0.4, 0.7, 0.3).normalize());
        let other = DMat3::from_quat(DQuat::from_xyzw(-0.5, 0.2, 0.1, 0.9).normalize());
        let check = |scale: [f64; 3], want: f64| {
            let got = stretch(turn * DMat3::from_diagonal(DVec3::from_array(scale)) * other);
            assert!((got / want - 1.0).abs() < 1e-7, "{scale:?}: {got} instead of {want}");
        };
        check([1.0, 1.0, 1.0], 1.0);
        check([-3e20, 3e20, 3e20], 1.0);
        check([1e-200, 1e-200, -1.01e-200], 1.01);
        check([2.0, 1.0, 4.0], 4.0);
        check([2.0, 2.0, 1.0], 2.0);
        assert!(stretch(turn * DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0))).is_infinite());
        assert_eq!(stretch(DMat3::ZERO), 1.0);
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.02, 1.0, 0.0), DVec3::Z);
        assert!(stretch(shear) > MAX_STRETCH);
    }
}
