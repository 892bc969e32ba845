//! Options of a benchmark and their validity for a scene.

use super::lights;
use super::measure::MAX_ROUNDS;
use super::sample::Sample;
use crate::clusters::Builder;
use crate::error::{quote, shown};
use crate::model::cache::CacheLocation;
use crate::scene::Scene;
use crate::{Error, Result, memory, optics};

/// Largest number of segments from a point to an emitter: the length of one scrambled Sobol' sequence.
pub(super) const MAX_RAYS: usize = 1 << 16;
/// Numbers of segments of the MR rows, relative to `rays`: steps of 4 halve the noise of exact rays.
const MR_FACTORS: [usize; 3] = [1, 4, 16];
/// Largest number of segments of a row to one emitter: at 10 million a second (`mrvis bench` on one core) it takes a day.
const MAX_SEGMENTS: f64 = 1e12;

options! {
    /// Options of [`Model::bench`](crate::Model::bench): [`BenchOptions::default`] with other values of some fields.
    #[derive(Clone, Debug)]
    #[non_exhaustive]
    pub struct BenchOptions {
        /// Receiver points, uniform over all surfaces that do not emit.
        // With one emitter the results of one row take up to 8 GB, 32 + 48 bytes a point.
        pub points: usize = 20_000, in 1..=100_000_000;
        /// Segments from a point to an emitter; 4 and 16 times as many are measured as well.
        pub rays: usize = 16, in 1..=65_536;
        /// Feature sizes, scene units, above 0; default none: four sizes from two texels of the shadow images to a fifth of the largest
        /// receiver.
        pub feature_sizes: Vec<f64> = Vec::new();
        /// Objects, groups or materials for shadow images; default none: the largest flat surfaces, and terrain.
        pub receivers: Vec<String> = Vec::new();
        /// Rays from a point to an emitter in the reference.
        pub reference_rays: usize = 1024, in 1..=65_536;
        /// Threads of the timed sections. All else runs on the threads of the model.
        pub threads: usize = 1, in 1..=1024;
        /// Fraction of the bundles on which independent exact rays check the stated intervals.
        pub audit: f64 = 0.05, in 0.0..=1.0, "a part of the bundles";
        /// Largest memory of the results, bytes; default: four fifths of the available memory.
        pub max_memory: Option<u64> = None;
        /// Seed of all random numbers; default 1.
        pub seed: u64 = 1;
        /// Texels along the longer side of the maps; 0: no maps, `None`: 256, or fewer with more than eight emitters.
        #[doc(hidden)]
        // Common programs open images of up to this side.
        pub map: Option<usize> = Some(0), in 0..=16_384, "a number of texels";
        /// Largest number of times that each timed row is run; the smallest of its times counts.
        #[doc(hidden)]
        pub rounds: usize = MAX_ROUNDS, in 1..=MAX_ROUNDS;
        /// Algorithm that builds the clusters.
        #[doc(hidden)]
        pub builder: Builder = Builder::default();
        /// How cluster optics are measured.
        #[doc(hidden)]
        pub clusters: optics::Options = optics::Options::default();
        /// Where measured clusters are cached.
        #[doc(hidden)]
        pub cache: CacheLocation = CacheLocation::Off;
    }
}

impl BenchOptions {
    /// Numbers of segments from a point to an emitter of the MR rows.
    pub(super) fn mr_rays(&self) -> Vec<usize> {
        MR_FACTORS.iter().map(|f| f * self.rays).filter(|&n| n <= MAX_RAYS).collect()
    }

    /// Approximate peak memory of a run, bytes, without the scene, its clusters and Embree's tree.
    fn bytes(&self, emitters: usize) -> f64 {
        // Points, pairs, both halves of the reference, and the largest row with its intervals: bytes per point and per pair.
        let rows = self.points as f64 * (32.0 + emitters as f64 * 48.0);
        // The samples of the decisions (points and images).
        let samples = 2 * Sample::bytes(&self.mr_rays());
        // One map at a time: points of all spacings and light of some thirty rows; pairs, both halves of the reference and a row.
        let texels = self.map.map_or(0.0, |side| (side as f64).powi(2));
        let maps = texels * (160.0 + emitters as f64 * 64.0);
        rows.max(maps) + samples as f64
    }

    /// Checks the options independently of a scene.
    ///
    /// # Errors
    /// [`Error::Argument`] that names the option and its range.
    #[doc(hidden)]
    pub fn check(&self) -> Result<()> {
        self.check_ranges()?;
        self.clusters.check_ranges()?;
        let segments = self.points as f64 * self.rays as f64;
        if segments > MAX_SEGMENTS {
            return Err(Error::arguments(format!(
                "⟨points⟩ {} with ⟨rays⟩ {} are {segments:.0e} segments to each emitter, more than {MAX_SEGMENTS:.0e}: lower ⟨points⟩ or \
                 ⟨rays⟩",
                self.points, self.rays
            )));
        }
        let usable = |s: f64| s.is_finite() && s > 0.0 && (s as f32).is_normal();
        if let Some(s) = self.feature_sizes.iter().find(|&&s| !usable(s)) {
            return Err(Error::argument("feature_size", s, "must be a length above 0 in scene units"));
        }
        Ok(())
    }

    /// Checks the options for this scene, including [`BenchOptions::check`].
    #[doc(hidden)]
    pub fn check_for(&self, scene: &Scene) -> Result<()> {
        self.check()?;
        let sources = lights::per_point(scene);
        if sources == 0 {
            let names: Vec<String> = scene.objects.iter().take(4).map(|o| quote(&o.name)).collect();
            return Err(Error::Scene(format!(
                "{}: nothing emits light; add ⟨LoadOptions::emitters⟩ with the name of an object, group or material and its \
                 power in watts (there are `{}`{}), or ⟨sky⟩ or ⟨sun⟩",
                shown(&scene.path),
                names.join("`, `"),
                if scene.objects.len() > names.len() { ", …" } else { "" },
            )));
        }
        let diagonal = f64::from(scene.world_bounds().diagonal());
        if let Some(s) = self.feature_sizes.iter().find(|&&s| s > 10.0 * diagonal) {
            let problem = format!("the whole scene is only {diagonal:.3} {} across", scene.unit);
            return Err(Error::argument("feature_size", s, problem));
        }
        for name in &self.receivers {
            scene.faces_named_placed(scene.placed(), name).map_err(|error| error.of("receivers"))?;
        }
        self.check_memory(sources, self.max_memory.or_else(memory::usable))
    }

    /// Checks that a run fits into the usable memory, bytes, if that is known.
    fn check_memory(&self, emitters: usize, usable: Option<u64>) -> Result<()> {
        let bytes = self.bytes(emitters);
        let plural = if emitters == 1 { "" } else { "s" };
        match usable {
            Some(usable) if bytes > usable as f64 => Err(Error::arguments(format!(
                "⟨points⟩ {} with {emitters} emitter{plural} and ⟨rays⟩ {} need about {:.1} GB of memory, {:.1} GB may be used: \
                 lower ⟨points⟩ or ⟨rays⟩, or raise ⟨max_memory⟩",
                self.points,
                self.rays,
                bytes / 1e9,
                usable as f64 / 1e9
            ))),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_maps_take_memory() {
        let fits = |map: Option<usize>| {
            BenchOptions { map, ..BenchOptions::default() }.check_memory(4, Some(1_000_000_000)).is_ok()
        };
        assert!(fits(None) && fits(Some(0)) && fits(Some(512)) && !fits(Some(4096)));
        assert!(BenchOptions { map: Some(16_385), ..BenchOptions::default() }.check().is_err());
    }

    /// With many rays the samples of the decisions take most of the memory.
    #[test]
    fn memory_is_checked_with_all_that_is_held() {
        let fits = |rays: usize, points: usize, gigabytes: f64| {
            let options = BenchOptions { rays, points, ..BenchOptions::default() };
            options.check_memory(4, Some((gigabytes * 1e9) as u64)).is_ok()
        };
        assert!(fits(16, 20_000, 0.1) && !fits(16, 10_000_000, 1.0));
        // 256 bundles of 65,536 segments, twice: 1.2 GB.
        assert!(!fits(65_536, 100, 1.0) && fits(65_536, 100, 1.5));
        let message = BenchOptions { rays: 65_536, ..BenchOptions::default() }
            .check_memory(1, Some(1_000_000))
            .unwrap_err();
        assert!(message.to_string().contains("with 1 emitter and `rays` 65536"), "{message}");
    }
}
