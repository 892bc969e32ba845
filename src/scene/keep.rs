//! Selection of the polygons to triangulate.

use super::{Repairs, Soup, duplicates::same_corners, triangulate::newell};
use glam::{DVec3, Vec3};

/// Smallest opacity of a face that blocks light; faces below are dropped. A face transmits all or nothing here, so an
/// error in opacity is smallest with the limit at one half.
pub(super) const MIN_OPACITY: f32 = 0.5;

/// Largest number of polygons with the same corners that are kept: both sides of two materials. Bounds the search among them.
const MAX_KEPT: usize = 4;

/// Polygons that remain before triangulation.
pub(super) struct KeptPolygons {
    /// Index of each polygon in the soup.
    pub polygon: Vec<u32>,
    /// Merged vertices of all polygons in order; no two consecutive ones are equal.
    pub corners: Vec<u32>,
    /// Corner of the soup that each entry of `corners` comes from.
    pub source: Vec<u32>,
    ends: Vec<usize>,
    /// Object of each polygon.
    pub object: Vec<u32>,
}

impl KeptPolygons {
    /// Range of a kept polygon in `corners` and `source`.
    pub fn span(&self, i: usize) -> std::ops::Range<usize> {
        (if i == 0 { 0 } else { self.ends[i - 1] })..self.ends[i]
    }

    /// Cleans the corners of all polygons and drops polygons that are transparent, have fewer than three corners, or
    /// are duplicates.
    pub fn of(soup: &Soup, number: &[u32], positions: &[Vec3], repairs: &mut Repairs) -> KeptPolygons {
        let mut all = KeptPolygons {
            polygon: Vec::with_capacity(soup.polygons()),
            corners: Vec::with_capacity(soup.corners.len()),
            source: Vec::with_capacity(soup.corners.len()),
            ends: Vec::with_capacity(soup.polygons()),
            object: Vec::new(),
        };
        for i in 0..soup.polygons() {
            let material = &soup.materials[soup.polygon_material[i] as usize];
            // Emitters remain at any opacity.
            if material.opacity < MIN_OPACITY && material.emission == [0.0; 3] {
                repairs.transparent_faces += 1;
                continue;
            }
            let start = all.corners.len();
            for k in soup.span(i) {
                let v = number[soup.corners[k] as usize];
                if all.corners.len() == start || all.corners.last() != Some(&v) {
                    all.corners.push(v);
                    all.source.push(k as u32);
                }
            }
            while all.corners.len() > start + 1 && all.corners.last() == Some(&all.corners[start]) {
                all.corners.pop();
                all.source.pop();
            }
            if all.corners.len() < start + 3 {
                all.corners.truncate(start);
                all.source.truncate(start);
                repairs.zero_area_faces += 1;
                continue;
            }
            all.polygon.push(i as u32);
            all.ends.push(all.corners.len());
        }
        all.drop_duplicates(soup, positions, repairs);
        all.object = all.polygon.iter().map(|&p| soup.polygon_object[p as usize]).collect();
        all
    }

    /// Drops one of two polygons with the same corners:
    ///
    /// * facing the same way, unless both object and material differ: the later one is kept, but not instead of one that alone emits;
    /// * facing opposite ways, only if object and material are equal: the earlier one is kept.
    ///
    /// Other pairs are two solids in contact, or the two sides of a wall.
    fn drop_duplicates(&mut self, soup: &Soup, positions: &[Vec3], repairs: &mut Repairs) {
        let slices: Vec<&[u32]> = (0..self.polygon.len()).map(|i| &self.corners[self.span(i)]).collect();
        let normal = |i: u32| {
            let p: Vec<DVec3> =
                slices[i as usize].iter().map(|&v| positions[v as usize].as_dvec3()).collect();
            newell(&p)
        };
        let origin = |i: u32| {
            let polygon = self.polygon[i as usize] as usize;
            (soup.polygon_object[polygon], soup.polygon_material[polygon])
        };
        let emits = |i: u32| soup.materials[origin(i).1 as usize].emission != [0.0; 3];
        let mut drop = vec![false; slices.len()];
        for group in same_corners(&slices) {
            let mut survivors: Vec<(u32, DVec3)> = Vec::new();
            for &i in &group {
                let n = normal(i);
                let differs = |&(j, m): &(u32, DVec3)| {
                    let [own, other] = [i, j].map(origin);
                    match n.dot(m) < 0.0 {
                        true => own != other,
                        false => own.0 != other.0 && own.1 != other.1,
                    }
                };
                let same = survivors.iter().position(|other| !differs(other));
                match same {
                    None if survivors.len() < MAX_KEPT => survivors.push((i, n)),
                    Some(k) if n.dot(survivors[k].1) > 0.0 && emits(i) >= emits(survivors[k].0) => {
                        drop[survivors[k].0 as usize] = true;
                        survivors[k] = (i, n);
                        repairs.duplicate_faces += 1;
                    }
                    _ => {
                        drop[i as usize] = true;
                        repairs.duplicate_faces += 1;
                    }
                }
            }
        }
        if drop.contains(&true) {
            self.retain(|i| !drop[i]);
        }
    }

    fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let (mut corners, mut source, mut polygon, mut ends) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for i in (0..self.polygon.len()).filter(|&i| keep(i)) {
            corners.extend_from_slice(&self.corners[self.span(i)]);
            source.extend_from_slice(&self.source[self.span(i)]);
            polygon.push(self.polygon[i]);
            ends.push(corners.len());
        }
        (self.corners, self.source, self.polygon, self.ends) = (corners, source, polygon, ends);
    }
}
