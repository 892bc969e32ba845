//! Ground whose height field rays meet in full resolution, while fewer triangles exchange its light.

use super::Scene;
use crate::terrain::{Mesh, Piece as TerrainPiece, triangle_at};
use glam::{DAffine3, DVec3};
use std::ops::Range;
use std::sync::Arc;

/// A rectangle of samples, and the triangles that represent it.
#[derive(Clone, Debug)]
pub(crate) struct Piece {
    /// Its first sample.
    pub first: u32,
    /// Samples of a row of all its height field.
    pub stride: u32,
    /// Columns and rows of its samples.
    pub size: [u16; 2],
    /// Its triangles among `corners` and `triangles`.
    range: Range<u32>,
    /// Largest vertical distance of a sample from them, scene units.
    error: f32,
}

/// Height fields with more cells than a scene has triangles for.
#[derive(Clone, Debug, Default)]
pub struct FineGround {
    /// Positions of all samples of all height fields, in the coordinates of the file; NaN in holes.
    samples: Vec<DVec3>,
    /// Ends of the samples of each height field, and its object in the soup.
    fields: Vec<(usize, u32)>,
    pieces: Vec<Piece>,
    /// Corners of the triangles of pieces, in columns and rows from the first sample.
    corners: Vec<[[f32; 2]; 3]>,
    /// The number of each of these triangles: of a polygon of the soup, then of a face of the scene.
    triangles: Vec<u32>,
}

/// The ground of a scene, relative to its origin.
#[derive(Debug)]
pub struct Resolved {
    /// Positions of samples, scene units.
    pub samples: Vec<[f32; 3]>,
    /// By face, the height to which the ground may rise above it, scene units; 0 for faces that do not stand for a piece.
    pub heights: Vec<f32>,
    /// The largest of them.
    pub highest: f32,
    /// Connected parts of the scene that have such faces, ascending.
    pub parts: Vec<u32>,
    ground: FineGround,
}

impl FineGround {
    /// A height field of more triangles becomes fine ground, of which about as many triangles exchange light. The solver takes 1.4 kB and
    /// 40 µs for each (`mrvis solve` of fractal mountains of up to 1.3 million triangles on two cores): 0.7 GB and 20 s.
    pub const MAX_TRIANGLES: usize = 1 << 19;
    /// Largest cosine between a ray that meets the upper side of fine ground and the normal of the face that stands for it: the slopes of
    /// cells may differ from that of the face by 30°. A ray from below within 30° of the plane of the face counts as one from above, too.
    pub const MAX_BACK: f32 = 0.5;

    /// Adds a height field of an object: positions of samples, their number in a row, and the number of the first polygon of its pieces.
    pub(super) fn add(
        &mut self,
        samples: impl Iterator<Item = DVec3>,
        columns: usize,
        mesh: &Mesh,
        pieces: Vec<TerrainPiece>,
        polygon: u32,
        object: u32,
    ) {
        let start = self.samples.len() as u32;
        self.samples.extend(samples);
        self.fields.push((self.samples.len(), object));
        for piece in pieces {
            let [column, row] = piece.first;
            let first = self.corners.len() as u32;
            for t in piece.triangles.clone() {
                let corner = |v: u32| {
                    let [c, r] = mesh.vertices[v as usize];
                    [(c - column) as f32, (r - row) as f32]
                };
                self.corners.push(mesh.triangles[t as usize].map(corner));
                self.triangles.push(polygon + t);
            }
            self.pieces.push(Piece {
                first: start + row * columns as u32 + column,
                stride: columns as u32,
                size: piece.cells.map(|n| n + 1),
                range: first..self.corners.len() as u32,
                error: piece.error,
            });
        }
    }

    /// Adds that of a soup whose polygons and objects get numbers from these on.
    pub(super) fn append(&mut self, of: &FineGround, polygon: u32, object: u32) {
        let (sample, corner) = (self.samples.len() as u32, self.corners.len() as u32);
        self.fields.extend(of.fields.iter().map(|(end, k)| (sample as usize + end, object + k)));
        self.samples.extend(&of.samples);
        self.corners.extend(&of.corners);
        self.triangles.extend(of.triangles.iter().map(|t| polygon + t));
        self.pieces.extend(of.pieces.iter().map(|piece| Piece {
            first: sample + piece.first,
            range: corner + piece.range.start..corner + piece.range.end,
            ..*piece
        }));
    }

    /// Moves the samples of an object.
    pub(super) fn transform(&mut self, object: u32, by: &DAffine3) {
        let mut start = 0;
        for &(end, of) in &self.fields {
            if of == object {
                self.samples[start..end].iter_mut().for_each(|p| *p = by.transform_point3(*p));
            }
            start = end;
        }
    }

    /// Changes the position of each sample to that on a sphere of this radius: a chord of the length L is up to L² / 8R below it.
    pub(super) fn curve(&mut self, place: impl Fn(DVec3) -> DVec3, radius: f64) {
        for piece in &mut self.pieces {
            let Piece { first, stride, size: [columns, rows], .. } = *piece;
            let last = first + (u32::from(rows) - 1) * stride + u32::from(columns) - 1;
            let diagonal = self.samples[first as usize].distance_squared(self.samples[last as usize]);
            piece.error += (diagonal / (8.0 * radius)) as f32;
        }
        self.samples.iter_mut().for_each(|p| *p = place(*p));
    }

    /// The ground of a scene with this origin, of whose faces `polygons` states the polygon in the soup and `components` the connected
    /// part.
    fn resolved(mut self, origin: DVec3, polygons: &[u32], components: &[u32]) -> Resolved {
        let mut face = vec![u32::MAX; polygons.iter().max().map_or(0, |&last| last as usize + 1)];
        (0u32..).zip(polygons).for_each(|(t, &polygon)| face[polygon as usize] = t);
        let mut heights = vec![0.0; polygons.len()];
        let FineGround { pieces, triangles, .. } = &mut self;
        pieces.retain(|piece| {
            let triangles = &mut triangles[piece.range.start as usize..piece.range.end as usize];
            triangles.iter_mut().for_each(|t| *t = face.get(*t as usize).copied().unwrap_or(u32::MAX));
            // Polygons that are left out for want of area have a neighbour in their place; of a terrain that is in the scene twice all
            // are left out.
            let Some(any) = triangles.iter().copied().find(|t| *t != u32::MAX) else { return false };
            for t in triangles {
                *t = if *t == u32::MAX { any } else { *t };
                heights[*t as usize] = piece.error.max(f32::MIN_POSITIVE);
            }
            true
        });
        let mut parts: Vec<u32> =
            (0..heights.len()).filter(|&t| heights[t] > 0.0).map(|t| components[t]).collect();
        parts.sort_unstable();
        parts.dedup();
        let samples = std::mem::take(&mut self.samples);
        let samples = samples.into_iter().map(|p| (p - origin).as_vec3().to_array()).collect();
        let highest = heights.iter().copied().fold(0.0, f32::max);
        Resolved { samples, heights, highest, parts, ground: self }
    }
}

impl Scene {
    /// Sets the ground that rays meet in place of faces.
    pub(super) fn refine_ground(&mut self, ground: Option<FineGround>) {
        self.fine_ground = ground.map(|ground| {
            Arc::new(ground.resolved(self.origin, &self.triangle_polygon, &self.triangle_component))
        });
    }
}

impl Resolved {
    /// Rectangles of samples.
    pub(crate) fn pieces(&self) -> &[Piece] {
        &self.ground.pieces
    }

    /// The face of the scene that stands for a place on a piece, columns and rows from 0 to 1.
    pub fn face_at(&self, piece: u32, place: [f32; 2]) -> u32 {
        let Piece { size, range, .. } = &self.ground.pieces[piece as usize];
        let cells = size.map(|n| f32::from(n - 1));
        let range = range.start as usize..range.end as usize;
        let corners = &self.ground.corners[range.clone()];
        let (k, _) = triangle_at(corners, [place[0] * cells[0], place[1] * cells[1]]);
        self.ground.triangles[range.start + k]
    }

    /// Whether the samples are met in place of a face.
    pub fn replaces(&self, face: u32) -> bool {
        self.heights.get(face as usize).is_some_and(|height| *height > 0.0)
    }
}
