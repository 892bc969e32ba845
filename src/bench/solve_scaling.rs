//! How the time of a solution grows with the scene.

use crate::model::Model;
use crate::progress::Progress;
use crate::radiosity::{Options, Seconds, run};
use crate::scene::generate::{self, Spec};
use crate::{Error, Result};
use serde::Serialize;

/// Triangles of the smallest scene.
const FIRST: usize = 1000;
/// Triangles of a cube.
const TRIANGLES_OF_CUBE: usize = 12;

/// Range of the largest scene of a series, triangles: two scenes at least, and what memory holds.
pub const LARGEST: std::ops::RangeInclusive<usize> = 10 * FIRST..=10_000_000;

/// One scene.
#[derive(Clone, Debug, Serialize)]
pub struct ScalingRow {
    /// Triangles.
    pub triangles: usize,
    /// Elements at the end, clusters included.
    pub elements: usize,
    /// Links at the end.
    pub links: usize,
    /// Exact segments traced.
    pub exact_rays: u64,
    /// Bytes of elements and links.
    pub bytes: usize,
    /// RMS error found by the audit relative to the mean irradiance; none without an audit.
    pub rms_error: Option<f64>,
    /// Seconds by stage.
    pub stages: Seconds,
    /// Seconds from the triangles to the light, without the audit.
    pub seconds: f64,
}

/// A series of scenes.
#[derive(Clone, Debug, Serialize)]
pub struct Scaling {
    /// Version of this program.
    pub mrvis: String,
    /// Threads used.
    pub threads: usize,
    /// The options of each solution.
    pub options: Options,
    /// The kind of scene.
    pub scene: String,
    /// Smallest scene first.
    pub rows: Vec<ScalingRow>,
    /// Slope of the logarithm of the seconds against that of the triangles (least squares). Part of the time, as that of most
    /// rays of the local pass, is the same in all scenes and lowers the slope.
    pub slope: f64,
    /// The slope between the two largest scenes, where that part is smallest.
    pub slope_last: f64,
}

/// Solves scenes of randomly rotated cubes, from a thousand triangles in steps of a factor of ten up to `largest`, all to the
/// same error.
///
/// # Errors
/// `largest` is not in [`LARGEST`], an option is out of range, or Embree refuses.
pub fn solve_scaling(options: &Options, largest: usize, progress: &dyn Progress) -> Result<Scaling> {
    if !LARGEST.contains(&largest) {
        return Err(Error::Argument(format!("scaling {largest}: must lie in {LARGEST:?} triangles")));
    }
    let mut rows = Vec::new();
    for triangles in std::iter::successors(Some(FIRST), |n| n.checked_mul(10)).take_while(|&n| n <= largest) {
        let spec =
            Spec { seed: options.seed, count: Some(triangles / TRIANGLES_OF_CUBE), ..Spec::new("cubes") };
        let scene = generate::build(&spec)?;
        let model = Model::prepare(scene, &options.prepare(), progress)?;
        let record = run(&model, &[], options, progress)?.record;
        let s = &record.seconds;
        rows.push(ScalingRow {
            triangles: record.scene.triangles,
            elements: record.elements,
            links: record.links,
            exact_rays: record.exact_rays,
            bytes: record.bytes,
            rms_error: record.audit.map(|a| a.rms_error),
            seconds: s.embree + s.hierarchy + s.characterise + s.elements + s.solve + s.local,
            stages: record.seconds,
        });
        if record.interrupted {
            break;
        }
    }
    let times: Vec<(f64, f64)> = rows.iter().map(|r| (r.triangles as f64, r.seconds)).collect();
    Ok(Scaling {
        mrvis: env!("CARGO_PKG_VERSION").into(),
        threads: rayon::current_num_threads(),
        options: options.clone(),
        scene: "cubes".into(),
        slope: slope(&times),
        slope_last: slope(&times[times.len().saturating_sub(2)..]),
        rows,
    })
}

/// Slope of the logarithms by least squares; 0 for fewer than two points.
fn slope(points: &[(f64, f64)]) -> f64 {
    let points: Vec<(f64, f64)> =
        points.iter().map(|(x, y)| (x.ln(), y.max(f64::MIN_POSITIVE).ln())).collect();
    let n = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let (mut up, mut down) = (0.0, 0.0);
    for p in &points {
        up += (p.0 - x) * (p.1 - y);
        down += (p.0 - x).powi(2);
    }
    if down > 0.0 { up / down } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_those_of_powers() {
        for power in [0.5, 1.0, 1.3] {
            let points = [1e3, 1e4, 1e5].map(|n: f64| (n, 0.1 * n.powf(power)));
            assert!((slope(&points) - power).abs() < 1e-9);
        }
        assert_eq!(slope(&[(1.0, 1.0)]), 0.0);
    }

    /// In rays, which depend on no clock.
    #[test]
    fn rays_grow_no_faster_than_triangles() {
        let options = Options { error: 0.1, audit: 0, ..Options::default() };
        let scaling = solve_scaling(&options, 10 * FIRST, &()).expect("two scenes");
        let [small, large] = &scaling.rows[..] else { panic!("two rows") };
        assert!(large.triangles > 9 * small.triangles && large.elements > small.elements, "{scaling:?}");
        assert!(large.exact_rays < 14 * small.exact_rays, "{scaling:?}");
        assert!([FIRST, LARGEST.end() + 1].iter().all(|&n| solve_scaling(&options, n, &()).is_err()));
    }
}
