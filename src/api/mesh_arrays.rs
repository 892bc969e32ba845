//! Polygons in arrays of the caller, and their validity.

use super::segments::{PerEntry, Strided};
use crate::error::quote;
use crate::scene::MAX_COORDINATE;
use crate::{Error, Result};
use glam::DVec3;
use std::fmt::Display;

/// Positions of vertices in an array of the caller.
#[derive(Clone, Copy, Debug)]
pub enum Positions<'a> {
    /// Single precision.
    F32(Strided<'a, f32>),
    /// Double precision, for coordinates far from zero.
    F64(Strided<'a, f64>),
}

impl Positions<'_> {
    pub(super) fn len(&self) -> usize {
        match self {
            Positions::F32(positions) => positions.len(),
            Positions::F64(positions) => positions.len(),
        }
    }

    /// All positions in order.
    pub(super) fn iter(&self) -> impl Iterator<Item = DVec3> {
        (0..self.len()).map(|i| match self {
            Positions::F32(positions) => glam::Vec3::from_array(positions.numbers(i)).as_dvec3(),
            Positions::F64(positions) => DVec3::from_array(positions.numbers(i)),
        })
    }
}

impl<'a> From<Strided<'a, f32>> for Positions<'a> {
    fn from(positions: Strided<'a, f32>) -> Positions<'a> {
        Positions::F32(positions)
    }
}

impl<'a> From<Strided<'a, f64>> for Positions<'a> {
    fn from(positions: Strided<'a, f64>) -> Positions<'a> {
        Positions::F64(positions)
    }
}

impl<'a> From<&'a [[f32; 3]]> for Positions<'a> {
    fn from(positions: &'a [[f32; 3]]) -> Positions<'a> {
        Positions::F32(positions.into())
    }
}

impl<'a> From<&'a [[f64; 3]]> for Positions<'a> {
    fn from(positions: &'a [[f64; 3]]) -> Positions<'a> {
        Positions::F64(positions.into())
    }
}

/// A mesh in arrays of the caller, which a [`SceneBuilder`](crate::SceneBuilder) copies: triangles, or polygons with any number of
/// corners. Corners turn counterclockwise as seen from the front.
#[derive(Clone, Copy, Debug)]
#[must_use = "a mesh is added to a `SceneBuilder`"]
pub struct MeshArrays<'a> {
    pub(super) name: &'a str,
    pub(super) positions: Positions<'a>,
    pub(super) indices: &'a [u32],
    pub(super) sizes: Option<&'a [u32]>,
    pub(super) materials: PerEntry<'a, u32>,
}

impl<'a> MeshArrays<'a> {
    /// Triangles with material 0: three `indices` each, into `positions`, which are in scene units.
    pub fn new(name: &'a str, positions: impl Into<Positions<'a>>, indices: &'a [u32]) -> MeshArrays<'a> {
        MeshArrays { name, positions: positions.into(), indices, sizes: None, materials: PerEntry::All(0) }
    }

    /// Polygons instead of triangles: the number of corners of each, at least 3; `indices` holds all corners, one polygon after the
    /// other. Polygons may be concave; small deviations from a plane are accepted.
    pub fn polygon_sizes(mut self, sizes: &'a [u32]) -> MeshArrays<'a> {
        self.sizes = Some(sizes);
        self
    }

    /// The material of all polygons, as [`SceneBuilder::add_material`](crate::SceneBuilder::add_material) numbered it; default 0.
    pub fn material(mut self, material: u32) -> MeshArrays<'a> {
        self.materials = PerEntry::All(material);
        self
    }

    /// The material of each polygon.
    pub fn face_materials(mut self, materials: &'a [u32]) -> MeshArrays<'a> {
        self.materials = PerEntry::Each(materials);
        self
    }

    /// Number of polygons.
    pub(super) fn polygons(&self) -> usize {
        self.sizes.map_or(self.indices.len() / 3, <[u32]>::len)
    }

    /// Number of corners of a polygon.
    pub(super) fn size(&self, polygon: usize) -> u32 {
        self.sizes.map_or(3, |sizes| sizes[polygon])
    }

    /// Checks all preconditions of the rooms that it calls. `materials`: number of materials.
    pub(super) fn check(&self, materials: usize) -> Result<()> {
        let wrong = |name: &str, i: usize, value: &dyn Display, problem: String| {
            let value = format!("{value} of mesh `{}`", quote(self.name));
            Err(Error::argument(format!("{name}[{i}]"), value, problem))
        };
        let do_not_fit = |what: String| Err(Error::arguments(format!("mesh `{}`: {what}", quote(self.name))));
        let (vertices, corners, polygons) = (self.positions.len(), self.indices.len(), self.polygons());
        if polygons == 0 {
            return do_not_fit("⟨indices⟩ is empty: a mesh needs at least one polygon".into());
        }
        match self.sizes {
            None if corners % 3 != 0 => {
                return do_not_fit(format!(
                    "⟨indices⟩ holds {corners} corners, no multiple of 3: give ⟨polygon_sizes⟩ for polygons"
                ));
            }
            None => {}
            Some(sizes) => {
                if let Some(i) = sizes.iter().position(|&n| n < 3) {
                    return wrong("polygon_sizes", i, &sizes[i], "a polygon has at least 3 corners".into());
                }
                let sum: u64 = sizes.iter().map(|&n| u64::from(n)).sum();
                if sum != corners as u64 {
                    return do_not_fit(format!(
                        "⟨polygon_sizes⟩ sum to {sum}, but ⟨indices⟩ holds {corners} corners: they must agree"
                    ));
                }
            }
        }
        if let Some(i) = self.indices.iter().position(|&v| v as usize >= vertices) {
            let problem = format!("must be below {vertices}, the number of ⟨positions⟩");
            return wrong("indices", i, &self.indices[i], problem);
        }
        let lies = |p: DVec3| p.is_finite() && p.abs().max_element() <= MAX_COORDINATE;
        if let Some((i, p)) = self.positions.iter().enumerate().find(|&(_, p)| !lies(p)) {
            return wrong("positions", i, &p, format!("must be finite, at most {MAX_COORDINATE:e}"));
        }
        let (name, used) = match &self.materials {
            PerEntry::All(material) => ("material", std::slice::from_ref(material)),
            PerEntry::Each(each) if each.len() == polygons => ("face_materials", *each),
            PerEntry::Each(each) => {
                let entries = each.len();
                return do_not_fit(format!(
                    "⟨face_materials⟩ has {entries} entries for {polygons} polygons: give one each"
                ));
            }
        };
        match used.iter().position(|&m| m as usize >= materials) {
            None => Ok(()),
            Some(i) => {
                let problem =
                    format!("there are {materials} materials; add them before the meshes that use them");
                wrong(name, i, &used[i], problem)
            }
        }
    }
}
