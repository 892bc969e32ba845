//! What the command, the C library, benches and tests need besides the public interface. Not part of it: names here change without notice.

mod parts;

/// The measurement behind `mrvis bench`.
#[cfg(feature = "reports")]
pub mod bench {
    pub use crate::bench::workload::{ReceiverPoint, Workload, surface_points};
    pub use crate::bench::{Record, run, text};

    /// Its report.
    pub mod page {
        pub use crate::bench::page::{MrImage, ReceiverImages, render};
    }

    /// Two builders.
    pub mod side_by_side {
        pub use crate::bench::side_by_side::{ComparedRecord, SideBySide, side_by_side};
    }
}

/// Clusters.
pub mod clusters {
    pub use crate::clusters::{Builder, Cluster, FAN_OUT, Options, Tree, build};
}

/// Texts of errors.
pub mod error {
    pub use crate::error::{in_words, is_obeyed, own_word, parts_of, quote, shown, worded};
}

/// Output of solutions.
#[cfg(feature = "reports")]
pub mod export {
    pub use crate::export::{
        Camera, GridLight, MAX_PIXELS, MAX_SIDE, Mesh, PageView, Stage, SurfaceLight, Tone, VIEW, best_view,
        bytes_per_pixel, developed, picture, scene_view, solve_page, suitable_lightmap, surfaces, write_glb,
        write_lightmap_mesh, write_ply, write_vtu,
    };
}

/// Sky and sun.
pub mod sky {
    pub use crate::sky::{Environment, SkyModel};
    pub use glam::DVec3;
}

/// Height fields.
pub mod terrain {
    pub use crate::terrain::{
        EARTH_RADIUS, Georeference, Grid, Light, Loaded, ReadOptions, Sun, SweepOptions, horizon, irradiance,
        mountains, read, sky_view_factor, sunlit,
    };
    #[cfg(feature = "reports")]
    pub use crate::terrain::{Layer, write_geotiff, write_npz, write_png};
}

/// Files that appear whole or not at all.
pub mod files {
    pub use crate::files::{WholeFile, csv_text, escaped, input, json_text, write_json};
}

/// Readers of files, for tests with damaged files.
pub mod readers {
    use crate::model::cache;
    use crate::scene::{self, LoadOptions, Scene};
    use crate::{Result, points};
    use std::path::Path;

    /// Reads the content of a file with the reader of this name. Files that it names do not exist.
    ///
    /// # Errors
    /// Those of the reader.
    ///
    /// # Panics
    /// If there is no such reader, or a scene that it accepts cannot be used.
    pub fn read(reader: &str, bytes: &[u8]) -> Result<()> {
        let folder = Path::new("/nonexistent");
        match reader {
            "obj" | "ply" | "gltf" | "glb" => {
                let options = LoadOptions { max_memory: Some(1 << 30), ..LoadOptions::default() };
                let scene = scene::read_from_memory(Some(folder), reader, bytes, &options)?;
                assert!(scene.bounds.diagonal().is_finite() && !scene.triangles.is_empty());
            }
            "mtl" => drop(scene::read_materials(folder, bytes)?),
            "cache" => {
                if let Some(table) = cache::decode(bytes, &sample()) {
                    assert_eq!(table.optics.len(), table.hierarchy.micro.clusters.len());
                }
            }
            "csv" => drop(points::irradiance_of(folder, bytes)?),
            "ies" | "ldt" | "placements" => {
                let scene = scene::lit_from_memory(reader, bytes)?;
                let power = scene.emitters.iter().flat_map(|emitter| scene.power(emitter));
                assert!(scene.bounds.diagonal().is_finite() && power.sum::<f64>().is_finite());
            }
            other => panic!("no reader is called {other}"),
        }
        Ok(())
    }

    /// The scene whose cache files the reader `cache` reads, 40 cubes.
    pub fn sample() -> Scene {
        let spec = scene::generate::Spec { count: Some(40), ..scene::generate::Spec::new("cubes") };
        let soup = scene::generate::soup(&spec).expect("a scene");
        scene::resolve(soup, &LoadOptions::default()).expect("a scene")
    }

    /// Content of a cache file of [`sample`].
    pub fn sample_cache() -> Vec<u8> {
        let (scene, options) = (sample(), cache::Options::default());
        let hierarchy = crate::clusters::build(&scene, &options.clusters);
        let optics = crate::optics::measure(&scene, &hierarchy.micro, &options.optics);
        cache::encode(&cache::PreparedClusters { hierarchy, optics }).expect("bytes")
    }
}

/// Form factors between facets.
pub mod form_factors {
    pub use crate::form_factors::matrix::{
        Facets, Format, Grouping, Report, Settings, by_groups, compute, memory_bound, write,
    };
}

/// Images in files.
#[cfg(feature = "reports")]
pub mod image_io {
    pub use crate::image_io::{
        Channel, Picture, difference, grey, mask_overlay, read_image, thumbnail, write_exr, write_exr_rgb,
        write_png,
    };
}

/// Boxes, triangles and disjoint sets.
pub mod math {
    pub use crate::math::{Aabb, Sets, parallel, triangle_area};
}

/// Memory of the machine.
pub mod memory {
    pub use crate::memory::{address_space_limit, check_room, left_of_address_space, usable};
}

/// Measures of images.
pub mod metrics {
    pub use crate::metrics::fbem::spectrum_sizes;
    pub use crate::metrics::features::FeatureSet;
    pub use crate::metrics::norms::{Norms, norms};
}

/// Models and files of measured clusters.
pub mod model {
    pub use crate::model::{cache::CacheLocation, embree_version};
}

/// Cluster optics.
pub mod optics {
    pub use crate::optics::{Extinction, Options, extinction};
}

/// Parts of pages.
#[cfg(feature = "reports")]
pub mod page {
    pub use crate::page::{
        TableCell, bytes, chart, count, data_url, document, figure, file_name, seconds, small_chart, table,
    };
}

/// The path tracer.
pub mod path_tracer {
    pub use crate::path_tracer::{Settings, irradiance};
}

/// Charts.
#[cfg(feature = "reports")]
pub mod plot {
    pub use crate::plot::{Marks, Plot, PlotPoint, Scale, Series, number};
}

/// Points in files.
pub mod points {
    pub use crate::points::{
        Comparison, Irradiance, Point, compare, read_irradiance, read_points, write_irradiance,
    };
}

/// The light in a scene.
pub mod radiosity {
    pub use crate::radiosity::mesh::{Element, RadiosityMesh};
    pub use crate::radiosity::{
        Inside, Ledger, Options, Outcome, PointLight, Powers, Record, RowNormalisation, Solution, View, run,
        solve,
    };
}

/// Processes that share rows.
pub mod ranks {
    pub use crate::ranks::{Exchange, Ranks};
}

/// Bit images.
pub mod raster {
    pub use crate::raster::{BitImage, Opener, expand, fill_triangle};
}

/// Segments.
pub mod ray {
    pub use crate::ray::{LANES, Occluder, Packet};
}

/// Scenes from polygons and generators.
pub mod scene {
    pub use crate::scene::{
        Emitter, LoadOptions, MeasuringGrid, Move, Object, Photometry, Scene, Soup, SoupMaterial,
        StoredCamera, generate, mtl_path, parse_emitter, read_added, read_placements, resolve,
        unit_in_metres, write_gltf, write_obj,
    };
}

/// Pools of threads.
pub mod threads {
    pub use crate::threads::{MAX_THREADS, Threads, in_callback, is_in_callback};
}

/// Visibility engines.
pub mod visibility {
    pub use crate::visibility::{Bundle, Exact, LeafMode, MultiResolution, Workspace};
}
