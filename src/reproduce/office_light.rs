//! Radiosity in the office with clusters by three builders: the pictures of Figures 7 and 8.

use super::desks::{SHELL, contrast};
use super::item::{Item, Panel};
use super::table::{Table, count, number};
use super::view::irradiance;
use super::{Context, fixed};
use crate::Result;
use crate::clusters::{self, Builder};
use crate::metrics::Image;
use crate::model::{Model, PrepareOptions};
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::{self, Options, Visibility};
use crate::scene::Scene;
use crate::scene::generate::{self, ROOM, Spec};
use glam::DVec3;
use std::sync::Arc;

/// Builders that the paper compares, in the form of the engines: boxes fitted to their contents.
const BUILDERS: [(Builder, &str); 3] = [
    (Builder::Grids, "uniform grids (new)"),
    (Builder::KdTree, "k-d tree, fitted boxes"),
    (Builder::GoldsmithSalmon, "Goldsmith-Salmon"),
];
/// Error that links are refined to: a high tolerance, as in the paper.
const ERROR: f64 = 0.1;
/// Side of a texel of the floor, metres: about the side of the smallest elements.
const TEXEL: f64 = 0.05;
/// Columns and rows of a picture.
pub const SIZE: [usize; 2] = [360, 270];
/// The camera in the doorway, and what it looks at.
pub const VIEW: [DVec3; 2] = [DVec3::new(0.0, -2.9, 1.9), DVec3::new(-0.6, 1.0, 0.3)];
/// Its vertical angle of view.
pub const ANGLE: f64 = 1.1;

/// Adds pictures and numbers of radiosity solutions with this visibility; returns the contrast under desks, by builder.
pub fn show(item: &mut Item, visibility: Visibility, context: &Context) -> Result<Vec<f64>> {
    let scene = Arc::new(generate::build(&Spec::new("office"))?);
    let columns = ["clusters by", "links", "time, s", "contrast under desks, %"];
    let mut table = Table::new("Radiosity along links", &columns);
    let (mut images, mut contrasts) = (Vec::new(), Vec::new());
    for (builder, name) in BUILDERS.into_iter().take(if context.small { 1 } else { 3 }) {
        let clusters = clusters::Options { builder, large_surface: SHELL };
        let options = PrepareOptions { clusters, ..PrepareOptions::default() };
        let model = Model::prepare(scene.clone(), &options, context.progress)?;
        let options =
            Options { visibility, error: ERROR, local_rays: Some(0), audit: 0, ..Options::default() };
        let outcome = radiosity::run(&model, &[], &options, context.progress)?;
        let under = contrast(&floor(&scene, &outcome.mesh)?)?;
        let seconds = outcome.record.seconds.work();
        table.push([name.into(), count(outcome.record.links), number(seconds, 2), number(100.0 * under, 1)]);
        let caption = format!("{name}, {}\u{a0}s", fixed(seconds, 2));
        images.push((irradiance(&outcome.mesh, VIEW, ANGLE, SIZE)?, caption));
        contrasts.push(under);
    }
    let white = bright(&images[0].0);
    let panels = images.iter().map(|(image, caption)| Panel::scaled(image, white, caption.clone()));
    item.row(
        format!("Radiosity along links, error {ERROR}; irradiance: black 0, white {white:.0} W/m² and more"),
        panels.collect(),
    );
    item.tables.push(table);
    Ok(contrasts)
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
    let elements = mesh.elements.iter().filter(|e| scene.objects[e.object as usize].name == "floor");
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
