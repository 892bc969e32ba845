//! Radiosity in the office with clusters by three builders: the pictures of Figures 7 and 8.

use super::item::{Item, Panel, Table, count, number};
use super::shadow::{crop, mean};
use super::view::irradiance;
use super::{Context, by_links, by_rays, changed, fixed};
use glam::DVec3;
use mrvis::internals::clusters;
use mrvis::internals::radiosity::{self, Element, RadiosityMesh};
use mrvis::internals::scene::generate::{self, DESKS, ROOM, Spec};
use mrvis::metrics::Image;
use mrvis::{Builder, Engine, Model, PrepareOptions, Result, Scene};
use std::sync::Arc;

/// Builders that the paper compares, in the form of the engines: boxes fitted to their contents.
const BUILDERS: [(Builder, &str); 3] = [
    (Builder::Grids, "uniform grids (new)"),
    (Builder::KdTree, "k-d tree, fitted boxes"),
    (Builder::GoldsmithSalmon, "Goldsmith-Salmon"),
];
/// Error that links are refined to: a high tolerance, as in the paper.
const LINK_ERROR: f64 = 0.1;
/// That of the solution by rays.
const REFERENCE_ERROR: f64 = 0.02;
/// Heading of pictures and numbers.
const TITLE: &str = "Radiosity solutions";
/// Side of a texel of the floor, metres: about the side of the smallest elements.
const TEXEL: f64 = 0.05;
/// Columns and rows of a picture.
pub const SIZE: [usize; 2] = [360, 270];
/// The camera in the doorway, and what it looks at.
pub const VIEW: [DVec3; 2] = [DVec3::new(0.0, -2.9, 1.9), DVec3::new(-0.6, 1.0, 0.3)];
/// Its vertical angle of view.
pub const ANGLE: f64 = 1.1;

/// Contrasts of the shadows under the desks in radiosity solutions.
#[derive(Clone, Debug)]
pub struct InRadiosity {
    /// By builder, of light along links: uniform grids, and fitted boxes of the k-d tree and of Goldsmith and Salmon; two if small.
    pub by: Vec<f64>,
    /// Of elements that gather their light by rays; none beside average visibility.
    pub by_rays: Option<f64>,
}

/// Adds pictures and numbers of radiosity solutions with this visibility; beside exact visibility of one by rays.
pub fn show(item: &mut Item, engine: Engine, context: &Context) -> Result<InRadiosity> {
    let scene = Arc::new(generate::build(&Spec::new("office"))?);
    let columns = "clusters by | links | time, s | contrast under desks, %";
    let mut table = Table::new(TITLE, columns);
    let (mut images, mut contrasts) = (Vec::new(), Vec::new());
    // The last one is the reference of exact visibility, with a last pass by rays.
    let links = BUILDERS.into_iter().take(if context.small { 2 } else { 3 });
    let of_engine = changed(&by_links(LINK_ERROR), |options| options.engine = engine);
    let links = links.map(|(builder, name)| (builder, name, of_engine.clone()));
    let rays = by_rays(if context.small { LINK_ERROR } else { REFERENCE_ERROR });
    let rays = (engine == Engine::Exact).then_some((Builder::Grids, "reference: rays", rays));
    let has_reference = rays.is_some();
    for (builder, name, options) in links.chain(rays) {
        let clusters = clusters::Options { builder, large_surface: SHELL };
        let prepare = PrepareOptions::default().with_clusters(clusters);
        let model = Model::prepare_watched(scene.clone(), &prepare, context.progress)?;
        let outcome = radiosity::run(&model, &[], &options, context.progress)?;
        let under = contrast(&floor(&scene, &outcome.mesh)?)?;
        let seconds = outcome.record.seconds.work();
        table.push([name.into(), count(outcome.record.links), number(seconds, 2), number(100.0 * under, 1)]);
        let caption = format!("{name}, {}\u{a0}s", fixed(seconds, 2));
        images.push((irradiance(&outcome.mesh, VIEW, ANGLE, SIZE)?, caption));
        contrasts.push(under);
    }
    let by_rays = if has_reference { contrasts.pop() } else { None };
    let white = bright(&images[0].0);
    let panels = images.iter().map(|(image, caption)| Panel::scaled(image, white, caption.clone()));
    item.row(
        format!(
            "{TITLE}, error {LINK_ERROR} along links; irradiance: black 0, white {white:.0} W/m² and more"
        ),
        panels.collect(),
    );
    item.tables.push(table);
    Ok(InRadiosity { by: contrasts, by_rays })
}

/// The irradiance that all but one per cent of the pixels do not exceed.
pub fn bright(image: &Image) -> f32 {
    let mut values = image.data().to_vec();
    values.sort_by(f32::total_cmp);
    values[values.len() * 99 / 100]
}

/// Irradiance of the floor, whose elements are rectangles along the axes.
fn floor(scene: &Scene, mesh: &RadiosityMesh) -> Result<Image<'static>> {
    let [columns, rows] = [ROOM.x, ROOM.y].map(|length| (length / TEXEL).round() as usize);
    let mut values = vec![0.0f32; columns * rows];
    // Its lower side is an element as well if rays reach it.
    let is_floor = |e: &&Element| e.front && scene.parts().objects[e.object as usize].name == "floor";
    let elements = mesh.elements.iter().filter(is_floor);
    for element in elements {
        let corners = element.corners.map(|c| mesh.vertices[c as usize].as_dvec3() + mesh.origin);
        let low = corners.iter().fold(DVec3::INFINITY, |low, c| low.min(*c));
        let high = corners.iter().fold(DVec3::NEG_INFINITY, |high, c| high.max(*c));
        // Texels whose centres lie in the element; the first row is at the largest y.
        let cells = |from: f64, to: f64, n: usize| {
            let first = |length: f64| ((length / TEXEL - 0.5).ceil().max(0.0) as usize).min(n);
            first(from)..first(to)
        };
        let value = (element.irradiance.iter().sum::<f64>() / 3.0) as f32;
        for y in cells(0.5 * ROOM.y - high.y, 0.5 * ROOM.y - low.y, rows) {
            for x in cells(low.x + 0.5 * ROOM.x, high.x + 0.5 * ROOM.x, columns) {
                values[y * columns + x] = value;
            }
        }
    }
    Image::new(columns, rows, TEXEL, values)
}

/// Planar surfaces of the shell of the room, which never block, stay outside the clusters; the tops of desks, with an inscribed
/// disc of 0.08 of the diagonal, do not.
pub const SHELL: f32 = 0.15;
/// Half of the area under a desk, of 1.6 x 0.8 m, that the penumbra of its edges leaves, metres.
const FLOOR_UNDER_DESK: [f64; 2] = [0.5, 0.2];
/// Half of the inner and outer border of the floor around a desk, up to the next one, metres.
const FLOOR_AROUND_DESK: [[f64; 2]; 2] = [[0.9, 0.5], [1.2, 0.8]];

/// Loss of light under the desks, relative to the floor around them.
pub fn contrast(image: &Image) -> Result<f64> {
    let texel = |metres: f64| (metres / image.texel()).round() as usize;
    // Sum and number of texels in a rectangle around a desk.
    let sum = |[x, y]: [f64; 2], [across, along]: [f64; 2]| -> Result<[f64; 2]> {
        let (left, top) = (0.5 * ROOM.x + x - across, 0.5 * ROOM.y - y - along);
        let part = [left, top, left + 2.0 * across, top + 2.0 * along].map(texel);
        let part = crop(image, part)?;
        let count = part.data().len() as f64;
        Ok([count * mean(&part), count])
    };
    let (mut under, mut around) = ([0.0; 2], [0.0; 2]);
    for desk in DESKS {
        let [own, inner, outer] =
            [FLOOR_UNDER_DESK, FLOOR_AROUND_DESK[0], FLOOR_AROUND_DESK[1]].map(|half| sum(desk, half));
        let [own, inner, outer] = [own?, inner?, outer?];
        for k in 0..2 {
            under[k] += own[k];
            around[k] += outer[k] - inner[k];
        }
    }
    Ok(1.0 - under[0] / under[1] / (around[0] / around[1]))
}
