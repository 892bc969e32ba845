//! How the time of a solve grows with the number of triangles.

use crate::model::Model;
use crate::progress::Progress;
use crate::radiosity::{Options, Seconds, run};
use crate::scene::generate::{self, Spec};
use crate::{Error, Result};
use serde::Serialize;

/// Triangles of the smallest scene, where the series begins; rows do not depend on each other.
const FIRST: usize = 1000;
/// Triangles of a cube, the only shape of these scenes.
const TRIANGLES_OF_CUBE: usize = 12;

/// Allowed sizes of the largest scene of a series, triangles. Below it a series would have one scene; above it the solve
/// needs more than 10 GB (about a kilobyte a triangle).
pub const LARGEST: std::ops::RangeInclusive<usize> = 10 * FIRST..=10_000_000;

/// The solve of one scene of a series.
#[derive(Clone, Debug, Serialize)]
pub struct SolveScalingRow {
    /// Triangles.
    pub triangles: usize,
    /// Elements at the end of the solve, clusters included.
    pub elements: usize,
    /// Links at the end of the solve.
    pub links: usize,
    /// Segments that Embree traced.
    pub exact_rays: u64,
    /// Bytes of elements and links.
    pub bytes: usize,
    /// RMS error of the irradiance, which the audit measured, relative to the mean irradiance; `null` without an audit.
    pub rms_error: Option<f64>,
    /// Seconds of each stage.
    pub stages: Seconds,
    /// Seconds of preparation and solve, without reading the scene and without the audit.
    pub seconds: f64,
}

/// A series of solves of growing scenes.
#[derive(Clone, Debug, Serialize)]
pub struct Scaling {
    /// Version of this program.
    pub mrvis: String,
    /// Threads used.
    pub threads: usize,
    /// The options of all solves.
    pub options: Options,
    /// The kind of generated scene.
    pub scene: String,
    /// One row a scene, the smallest first.
    pub rows: Vec<SolveScalingRow>,
    /// Slope of ln(seconds) against ln(triangles), by least squares: 1 if time is proportional to triangles. The rays of the local
    /// pass take about the same time in all scenes, which lowers the slope.
    pub slope: f64,
    /// The slope between the two largest scenes, which that constant time lowers least.
    pub slope_last: f64,
}

/// Solves scenes of randomly rotated cubes with 1,000, 10,000, … triangles, at most `largest`, all to the same error.
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
        rows.push(SolveScalingRow {
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

/// Slope of ln y against ln x by least squares; 0 for fewer than two points.
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

    /// Rays are counted instead of seconds: their number is the same in every run.
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
