//! Lights of the extension `KHR_lights_punctual` as small emitters and suns.

use super::Reader;
use crate::math::parallel;
use crate::scene::luminaires::Lamp;
use crate::scene::names::counted;
use crate::scene::profile::{Distribution, axes};
use crate::scene::{LoadOptions, MAX_COORDINATE, Scene, Soup};
use crate::sky::Sun;
use crate::{Result, error::quote, math::Aabb};
use glam::{DAffine3, DMat4, DVec3};
use gltf::khr_lights_punctual::{Kind, Light};

/// Largest side of the plate of a point or spot light relative to the scene's diagonal: 1 cm in a room of 5 m, so that pictures show a
/// point. It limits plates far from all surfaces.
const PLATE: f64 = 2e-3;
/// Largest side of the plate relative to the distance of the nearest surface: at ten sides its light is that of a point within (1/10)² /
/// 2 = 0.5 %.
const MAX_PLATE_RATIO: f64 = 0.1;
/// Smallest side of the plate relative to the scene's diagonal: a dozen times the rounding of single-precision coordinates, 4e-7 of them.
const SMALLEST_PLATE: f64 = 5e-6;
/// Tabulated angles between the inner and the outer cone of a spot: interpolation loses less than (1/64)² / 4 of its
/// intensity.
const CONE_STEPS: usize = 64;

/// Largest inner angle of a spot relative to the outer one: an edge of 1 % of the beam is sharp in any image, and steps of
/// the table differ by more than the rounding of cosines.
const MAX_INNER: f64 = 0.99;
/// Axis of the two plates of a point light: nothing is lit in their plane, which with coordinates in irrational ratios passes through no
/// other point of a grid along the axes of the scene.
const POINT_AXIS: DVec3 = DVec3::new(1.0, std::f64::consts::SQRT_2, 1.732_050_807_568_877_2);
/// Smallest outer angle of a spot, radians: a beam of a millimetre at a metre.
const MIN_CONE: f64 = 1e-3;

/// A light of a node.
pub(super) struct PlacedLight {
    name: String,
    at: DVec3,
    /// Towards −z of the node.
    aim: DVec3,
    /// Linear RGB factors.
    colour: [f64; 3],
    /// Candelas, or lux of a directional light.
    strength: f64,
    /// None for a directional light.
    distribution: Option<Distribution>,
    /// Whether it has two plates, with its place between them.
    shines_to_all_sides: bool,
}

impl Reader<'_> {
    /// Adds the light of a node.
    pub(super) fn light(&mut self, light: &Light, node: Option<&str>, world: DMat4) -> Result<()> {
        let name = node.or(light.name()).map_or(format!("light {}", light.index()), str::to_owned);
        let (at, aim) = (world.transform_point3(DVec3::ZERO), world.transform_vector3(DVec3::NEG_Z));
        let (strength, colour) = (f64::from(light.intensity()), light.color().map(f64::from));
        let sound = |v: &f64| v.is_finite() && *v >= 0.0;
        let near = at.is_finite() && at.abs().max_element() <= MAX_COORDINATE;
        let aim = aim.try_normalize().filter(|_| near);
        let (Some(aim), true) = (aim, sound(&strength) && colour.iter().all(sound)) else {
            return Err(self.wrong(format!(
                "light `{}`: its position is not within ±{MAX_COORDINATE:e}, or its color or intensity is not a finite number >= 0",
                quote(&name)
            )));
        };
        let aim = if matches!(light.kind(), Kind::Point) { POINT_AXIS.normalize() } else { aim };
        let table = match light.kind() {
            Kind::Directional => None,
            Kind::Point => Some(vec![(0.0, 1.0), (180.0, 1.0)]),
            Kind::Spot { inner_cone_angle, outer_cone_angle } => {
                let (inner, outer) = (f64::from(inner_cone_angle), f64::from(outer_cone_angle));
                if !(0.0 <= inner && (MIN_CONE..=std::f64::consts::FRAC_PI_2 + 1e-6).contains(&outer)) {
                    return Err(self.wrong(
                        "a spot light's cone angles must lie within 0 to π/2, the outer one at least 0.001",
                    ));
                }
                self.hard_spots += usize::from(inner >= outer);
                Some(cone(inner.min(MAX_INNER * outer), outer))
            }
        };
        let distribution = table.map(|t| Distribution::about_axis(&t));
        if strength > 0.0 && colour != [0.0; 3] {
            let shines_to_all_sides = matches!(light.kind(), Kind::Point);
            self.lights.push(PlacedLight {
                name,
                at,
                aim,
                colour,
                strength,
                distribution,
                shines_to_all_sides,
            });
        }
        Ok(())
    }

    /// Adds emitters for the lights to the polygons of the scene, beside those of meshes that are placed.
    pub(super) fn add_lights(&self, soup: &mut Soup, placed: &[Placed], options: &LoadOptions) -> Result<()> {
        let own = Aabb::of(soup.positions.iter().map(|p| p.as_vec3()));
        let diagonal = f64::from(placed.iter().map(|of| of.bounds).fold(own, Aabb::union).diagonal());
        // Without surfaces nothing is lit, and the size of a light is not known.
        if diagonal <= 0.0 {
            return Ok(());
        }
        // The plates of other lights do not count as surfaces: all distances are found before plates are added.
        let distances: Vec<f64> = self.lights.iter().map(|light| nearest(light.at, soup, placed)).collect();
        for (light, distance) in self.lights.iter().zip(distances) {
            let c0 = if light.aim.x.abs() > 0.9 { DVec3::Y } else { DVec3::X };
            let axes = axes(light.aim, c0).ok_or_else(|| self.wrong("a light without a direction"))?;
            if let Some(distribution) = light.distribution.clone() {
                let side = (MAX_PLATE_RATIO * distance).clamp(SMALLEST_PLATE * diagonal, PLATE * diagonal);
                let mut lamp = Lamp {
                    name: light.name.clone(),
                    at: light.at,
                    axes,
                    size: [side, side, 0.0],
                    distribution,
                    scale: light.strength,
                    factors: [1.0; 2],
                    colour: light.colour,
                };
                if light.shines_to_all_sides {
                    lamp.at += 0.5 * lamp.thickness(diagonal) * light.aim;
                }
                lamp.add(soup, diagonal, options);
                continue;
            }
            let irradiance = light.strength / options.photometry().lumens_per_watt;
            soup.suns.push(Sun::new(-light.aim, light.colour.map(|c| c * irradiance)));
        }
        if self.hard_spots > 0 {
            soup.repairs.messages.push(format!(
                "{} with an inner cone angle that is not below the outer one: it is taken as {MAX_INNER} of the outer one",
                counted(self.hard_spots, "spot light")
            ));
        }
        if !self.lights.is_empty() {
            let count = counted(self.lights.len(), "light");
            soup.repairs.messages.push(format!(
                "{count} of KHR_lights_punctual made into emitters: point and spot lights squares of {MAX_PLATE_RATIO} of the \
                 distance of the nearest surface (at most {PLATE} of the scene's diagonal), directional lights suns, unless the options state a sun or none; the property `range`, beyond which a light has no effect, is not used"
            ));
        }
        Ok(())
    }
}

/// A mesh in a place of the scene.
pub(super) struct Placed<'a> {
    pub bounds: Aabb,
    pub mesh: &'a Scene,
    pub to_world: DAffine3,
}

/// Distance of a point from the polygons and the triangles of placed meshes, scene units.
fn nearest(at: DVec3, soup: &Soup, placed: &[Placed]) -> f64 {
    let of_polygon = |i: usize| {
        let corners = soup.span(i).map(|k| soup.positions[soup.corners[k] as usize]);
        let first = corners.clone().next().unwrap_or(at);
        let pairs = corners.clone().skip(1).zip(corners.skip(2));
        pairs.map(|(b, c)| distance_from_triangle(at, [first, b, c])).fold(f64::INFINITY, f64::min)
    };
    let polygons = parallel::map(0..soup.polygons(), of_polygon).into_iter().fold(f64::INFINITY, f64::min);
    placed.iter().fold(polygons, |nearest, Placed { bounds, mesh, to_world }| {
        if f64::from(at.as_vec3().clamp(bounds.min, bounds.max).distance(at.as_vec3())) >= nearest {
            return nearest;
        }
        let of_triangle = |t: u32| {
            distance_from_triangle(at, mesh.corners(t).map(|p| to_world.transform_point3(p.as_dvec3())))
        };
        parallel::map(0..mesh.triangles.len() as u32, of_triangle).into_iter().fold(nearest, f64::min)
    })
}

fn distance_from_triangle(at: DVec3, corners: [DVec3; 3]) -> f64 {
    let [a, b, c] = corners;
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let edges = [(a, b), (b, c), (c, a)];
    if normal != DVec3::ZERO && edges.iter().all(|(p, q)| normal.cross(q - p).dot(at - p) >= 0.0) {
        return normal.dot(at - a).abs();
    }
    let of_edge = |(p, q): (DVec3, DVec3)| {
        let t = (at - p).dot(q - p) / (q - p).length_squared().max(f64::MIN_POSITIVE);
        at.distance(p.lerp(q, t.clamp(0.0, 1.0)))
    };
    edges.map(of_edge).into_iter().fold(f64::INFINITY, f64::min)
}

/// The intensity of a spot light of one candela: ((cos γ − cos outer) / (cos inner − cos outer))², as the extension
/// recommends; pairs of degrees and candelas.
fn cone(inner: f64, outer: f64) -> Vec<(f64, f64)> {
    let mut table = vec![];
    if inner > 0.0 {
        table.push((0.0, 1.0));
    }
    for k in 0..=CONE_STEPS {
        let gamma = inner + (outer - inner) * k as f64 / CONE_STEPS as f64;
        let part = (gamma.cos() - outer.cos()) / (inner.cos() - outer.cos());
        table.push((gamma.to_degrees(), part.clamp(0.0, 1.0).powi(2)));
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::testing::{Pieces, facing_up};
    use std::f64::consts::FRAC_PI_4;

    /// A tilted square 5 cm from a point that lies inside its bounds.
    #[test]
    fn the_nearest_surface_may_be_placed() {
        let mut pieces = Pieces::empty();
        pieces.grey("square", 0.5).polygon(&facing_up([-1.0, 1.0], [-1.0, 1.0], 0.0));
        let mesh = pieces.scene();
        let turned = DAffine3::from_rotation_x(FRAC_PI_4);
        let to_world = DAffine3::from_translation(-0.05 * turned.transform_vector3(DVec3::Z)) * turned;
        let corners = (0..2).flat_map(|t| mesh.corners(t));
        let bounds = Aabb::of(corners.map(|p| to_world.transform_point3(p.as_dvec3()).as_vec3()));
        let placed =
            [Placed { bounds, mesh: &mesh, to_world: to_world * DAffine3::from_translation(mesh.origin) }];
        let found = nearest(DVec3::ZERO, &Soup::new("empty"), &placed);
        assert!((found - 0.05).abs() < 1e-6, "{found}");
    }
}
