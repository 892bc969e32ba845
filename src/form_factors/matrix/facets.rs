//! Facets: input polygons with the pieces that closed forms need and the points that rays start from.

use super::go_on;
use crate::Result;
use crate::math::triangle_area;
use crate::model::face_magnitudes;
use crate::progress::Progress;
use crate::ray::EndRule;
use crate::scene::Scene;
use glam::{DVec3, Vec3};

/// All facets of a scene, in the order of the input polygons.
pub struct Facets {
    /// First triangle of each facet in the scene's list, and the end of the last.
    first: Vec<u32>,
    /// One entry per facet.
    facets: Vec<Facet>,
    /// Centre and radius of each facet; a compact array for loops over all facets.
    balls: Vec<(DVec3, f64)>,
    /// Facet of each triangle.
    of_triangle: Vec<u32>,
}

/// A facet: one input polygon.
pub(super) struct Facet {
    /// Convex planar pieces, corners counterclockwise.
    pub pieces: Vec<Vec<DVec3>>,
    /// Corners of all pieces.
    pub corners: Vec<DVec3>,
    /// Area, scene units squared.
    pub area: f64,
    /// Centre of its box.
    pub centre: DVec3,
    /// Half the diagonal of its box.
    pub radius: f64,
    /// Quadrature points with unit normal and weight (fraction of the area): exact for polynomials of third degree on a
    /// parallelogram, of second degree on triangles.
    pub nodes: Vec<(DVec3, DVec3, f64)>,
    /// Unit normals of the triangles; with a single quadrilateral piece all are equal.
    pub normals: Vec<DVec3>,
    /// Triangles with the cumulative fraction of the area.
    pub triangles: Vec<([Vec3; 3], f32)>,
    /// The rule for ends of segments on it.
    pub end: EndRule,
    /// Corner and two edges of a parallelogram, for direct sampling of points.
    pub parallelogram: Option<[Vec3; 3]>,
}

impl Facets {
    /// The facets of a scene.
    pub fn new(scene: &Scene) -> Facets {
        Facets::new_unless(scene, &()).expect("nobody stops")
    }

    /// The facets of a scene: groups its triangles by the polygons that they came from.
    pub fn new_unless(scene: &Scene, progress: &dyn Progress) -> Result<Facets> {
        let polygon = &scene.triangle_polygon;
        let mut first: Vec<u32> = (0..polygon.len())
            .filter(|&t| t == 0 || polygon[t] != polygon[t - 1])
            .map(|t| t as u32)
            .collect();
        first.push(polygon.len() as u32);
        let magnitudes = face_magnitudes(scene);
        let one = |w: &[u32]| {
            go_on(progress)?;
            Ok(facet(scene, &magnitudes, w[0]..w[1]))
        };
        let facets: Vec<Facet> = first.windows(2).map(one).collect::<Result<_>>()?;
        let balls = facets.iter().map(|f| (f.centre, f.radius)).collect();
        let mut of_triangle = Vec::with_capacity(polygon.len());
        for (f, w) in first.windows(2).enumerate() {
            of_triangle.resize(w[1] as usize, f as u32);
        }
        Ok(Facets { first, facets, balls, of_triangle })
    }

    /// Number of facets.
    pub fn count(&self) -> usize {
        self.facets.len()
    }

    /// Area of a facet, scene units squared.
    pub fn area(&self, facet: usize) -> f64 {
        self.facets[facet].area
    }

    /// Index of the facet's first triangle, which determines object and material.
    pub fn triangle(&self, facet: usize) -> usize {
        self.first[facet] as usize
    }

    /// Object and material of each facet.
    pub fn labels(&self, scene: &Scene) -> Labels {
        let of = |list: &[u32]| (0..self.count()).map(|facet| list[self.triangle(facet)]).collect();
        Labels {
            objects: of(&scene.triangle_object),
            materials: of(&scene.triangle_material),
            object_names: scene.objects.iter().map(|o| o.name.clone()).collect(),
            material_names: scene.materials.iter().map(|m| m.name.clone()).collect(),
        }
    }

    pub(super) fn get(&self, facet: u32) -> &Facet {
        &self.facets[facet as usize]
    }

    /// The facet `facet`, unless its bounding ball is below all planes of `from`.
    pub(super) fn rising(&self, from: &Facet, facet: u32) -> Option<&Facet> {
        let (centre, radius) = self.balls[facet as usize];
        let mut planes = from.pieces.iter().zip(&from.normals);
        planes.any(|(piece, n)| n.dot(centre - piece[0]) + radius > 0.0).then(|| self.get(facet))
    }

    pub(super) fn of_triangle(&self, triangle: u32) -> u32 {
        self.of_triangle[triangle as usize]
    }
}

/// Objects and materials of facets.
pub struct Labels {
    /// By facet, index into `object_names`.
    pub objects: Vec<u32>,
    /// By facet, index into `material_names`.
    pub materials: Vec<u32>,
    /// Names of all objects.
    pub object_names: Vec<String>,
    /// Names of all materials.
    pub material_names: Vec<String>,
}

impl Facet {
    /// Approximate height of another facet above the plane of any piece, if more than `least`: the centre's height
    /// where the whole bounding ball is above, else the highest corner's. Scene units.
    pub fn rise(&self, other: &Facet, min_rise: f64) -> Option<f64> {
        let mut rise = min_rise;
        for (piece, normal) in self.pieces.iter().zip(&self.normals) {
            let height = normal.dot(other.centre - piece[0]);
            if height > other.radius {
                rise = rise.max(height);
            } else if height + other.radius > rise {
                rise = other.corners.iter().map(|p| normal.dot(*p - piece[0])).fold(rise, f64::max);
            }
        }
        (rise > min_rise).then_some(rise)
    }

    /// Whether this facet is one piece and no corner of the other lies behind it.
    pub fn sees_all_of(&self, other: &Facet) -> bool {
        let (point, normal) = (self.pieces[0][0], self.normals[0]);
        let above = |p: DVec3| normal.dot(p - point);
        self.pieces.len() == 1
            && (above(other.centre) > other.radius || other.corners.iter().all(|&p| above(p) >= 0.0))
    }
}

/// Barycentric quadrature points, exact for polynomials of second degree (Strang and Fix 1973).
const QUADRATURE_POINTS: [[f64; 3]; 3] =
    [[2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0]];

fn facet(scene: &Scene, magnitudes: &[f32], triangles: std::ops::Range<u32>) -> Facet {
    let corners: Vec<[Vec3; 3]> = triangles.clone().map(|t| scene.corners(t)).collect();
    let areas: Vec<f64> = corners.iter().map(|&[a, b, c]| triangle_area(a, b, c)).collect();
    let area: f64 = areas.iter().sum();
    let points = || corners.iter().flatten().map(|p| p.as_dvec3());
    let (low, high) = points().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    let (mut nodes, mut normals) = (Vec::new(), Vec::new());
    let mut sum = 0.0;
    let mut shares = Vec::new();
    for (t, a) in corners.iter().zip(&areas) {
        let [p, q, r] = t.map(|p| p.as_dvec3());
        let normal = (q - p).cross(r - p).normalize_or_zero();
        normals.push(normal);
        nodes.extend(QUADRATURE_POINTS.map(|[u, v, w]| (p * u + q * v + r * w, normal, a / area / 3.0)));
        sum += a / area;
        shares.push((*t, sum as f32));
    }
    let pieces = match scene.triangles.get(triangles.start as usize..triangles.end as usize) {
        Some(&[a, b]) => quad(scene, a, b).map(|q| vec![q]),
        _ => None,
    };
    let parallelogram = pieces.as_ref().and_then(|p| match p[0][..] {
        [a, b, c, d] if (a + c - b - d).length() <= 1e-6 * (c - a).length() => {
            Some([a, b - a, d - a].map(|p| p.as_vec3()))
        }
        _ => None,
    });
    if let (Some(_), Some([quad])) = (&parallelogram, pieces.as_deref()) {
        // Two-point Gauss rule along both sides.
        let at = [0.5 - 0.5 / 3f64.sqrt(), 0.5 + 0.5 / 3f64.sqrt()];
        let place = |u: f64, v: f64| quad[0] + (quad[1] - quad[0]) * u + (quad[3] - quad[0]) * v;
        nodes = at.iter().flat_map(|&u| at.map(|v| (place(u, v), normals[0], 0.25))).collect();
    }
    let apart = || corners.iter().map(|t| t.map(|p| p.as_dvec3()).to_vec()).collect();
    let pieces: Vec<Vec<DVec3>> = pieces.unwrap_or_else(apart);
    Facet {
        corners: pieces.concat(),
        pieces,
        area,
        centre: 0.5 * (low + high),
        radius: 0.5 * (high - low).length(),
        nodes,
        normals,
        triangles: shares,
        end: EndRule::new(
            magnitudes[triangles.start as usize..triangles.end as usize].iter().copied().fold(0.0, f32::max),
        ),
        parallelogram,
    }
}

/// The convex planar quadrilateral that two triangles with a common edge form, if they do.
fn quad(scene: &Scene, a: [u32; 3], b: [u32; 3]) -> Option<Vec<DVec3>> {
    let k = (0..3).find(|&k| !b.contains(&a[k]))?;
    let other = b.into_iter().find(|v| !a.contains(v))?;
    let quad = [a[k], a[(k + 1) % 3], other, a[(k + 2) % 3]].map(|v| scene.positions[v as usize].as_dvec3());
    let turns: [DVec3; 4] =
        std::array::from_fn(|i| (quad[(i + 1) % 4] - quad[i]).cross(quad[(i + 2) % 4] - quad[(i + 1) % 4]));
    let normal = (quad[2] - quad[0]).cross(quad[3] - quad[1]);
    let size = (quad[2] - quad[0]).length().max((quad[3] - quad[1]).length());
    let flat = (quad[1] - quad[0]).dot(normal.normalize_or_zero()).abs() <= 1e-6 * size;
    (flat && turns.iter().all(|t| t.dot(normal) > 0.0)).then(|| quad.to_vec())
}

/// A facet that rays hit on its front, and the number of hits up to [`Partner::MAX_HITS`], in 32 bits to save memory.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Deserialize, serde::Serialize)]
pub struct Partner(u32);

impl Partner {
    const HIT_BITS: u32 = 6;
    /// Largest number of hits that is stored.
    pub const MAX_HITS: u32 = (1 << Partner::HIT_BITS) - 1;
    /// Largest number of facets.
    pub const MAX_FACETS: usize = 1 << (32 - Partner::HIT_BITS);

    /// A facet with this number of hits.
    pub fn new(facet: u32, hits: u32) -> Partner {
        Partner(facet << Partner::HIT_BITS | hits.min(Partner::MAX_HITS))
    }

    /// The facet.
    pub fn facet(self) -> u32 {
        self.0 >> Partner::HIT_BITS
    }

    /// Number of hits, at most [`Partner::MAX_HITS`].
    pub fn hits(self) -> u32 {
        self.0 & Partner::MAX_HITS
    }

    /// Sorts a list and adds the hits of equal facets.
    pub fn merge(list: &mut Vec<Partner>) {
        list.sort_unstable();
        list.dedup_by(|next, first| {
            let same = next.facet() == first.facet();
            if same {
                *first = Partner::new(first.facet(), first.hits() + next.hits());
            }
            same
        });
    }
}
