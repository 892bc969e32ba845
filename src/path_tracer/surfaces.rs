//! Traced geometry with normals, reflectances and emission of hit points.

use crate::embree::{CommittedScene, Hits, Traversal};
use crate::model::{Model, SurfaceSearch};
use crate::ray::{EndRule, Packet};
use crate::scene::{FineGround, Profile, magnitude};
use glam::{DVec3, Vec3};

/// Path rays are incoherent; single rays are fastest.
const TRAVERSAL: Traversal = Traversal { width: 1, coherent: false };

/// The traced scene and its surface properties.
pub struct Surfaces<'a> {
    model: &'a Model,
    traced: CommittedScene,
    /// Unit normals of the triangles of each mesh, in the frame of the mesh.
    normals: Vec<Vec<Vec3>>,
    /// Largest distance of a given point from its surface, scene units.
    slack: f32,
    /// Largest distance from given points at which their surface is looked for: stacked faces may be farther than the slack; scene units.
    reach: f32,
}

/// A hit of a path ray.
pub struct SurfaceHit<'a> {
    /// Start of the next rays, slightly above the surface on the side that was hit; scene units.
    pub position: Vec3,
    /// Distance of the position from the surface, scene units; see [`skin`].
    pub skin: f32,
    /// Unit normal of the side that was hit.
    pub normal: Vec3,
    /// Reflectance, RGB, in `[0, 1]`.
    pub reflectance: [f32; 3],
    /// Radiance of the front side, W/(m² sr), RGB.
    pub emission: [f32; 3],
    /// Directions in which the front emits; none for a diffuse face.
    pub profile: Option<&'a Profile>,
    /// Corners of the face where it stands, scene units.
    pub corners: [Vec3; 3],
    /// Cosine between the face's front normal and the reverse ray direction, positive on the front.
    pub cosine: f32,
}

/// Distance above a face with these corners at which paths start, continue and end: 34 roundings (2⁻²⁴) of the largest coordinate of
/// the face, four times what intersections with it err by for rays from places with no larger coordinates; scene units.
pub fn skin(corners: impl IntoIterator<Item = Vec3>) -> f32 {
    2e-6 * corners.into_iter().fold(Vec3::ZERO, |most, p| most.max(p.abs())).max_element()
}

impl<'a> Surfaces<'a> {
    pub fn new(model: &'a Model) -> Surfaces<'a> {
        let magnitude = model.magnitude();
        let normals = model.meshes().iter().map(|mesh| {
            let scene = mesh.scene();
            (0..scene.triangles.len() as u32).map(|t| scene.face_normal(t)).collect()
        });
        let slack = 1e-5 * model.bounds().diagonal() + 1e-6 * magnitude;
        Surfaces {
            traced: model.traced().clone(),
            normals: normals.collect(),
            slack,
            reach: slack + 2.0 * model.largest_stack_distance(),
            model,
        }
    }

    /// Converts a position in the file's coordinates to the scene's local coordinates.
    pub fn local(&self, position: DVec3) -> Vec3 {
        (position - self.model.scene().origin).as_vec3()
    }

    /// The start of the paths of a given point, above the surface that the point lies on: of the surfaces whose normals are within 60° of
    /// that of the point, the nearest one along the normal of the point. The point may be below it by 1e-5 of the scene's diagonal, above
    /// it by the skin of the surface, and either by twice the distance by which stacked faces were moved. Without one, the point is taken
    /// as it is, lifted. On an edge or in a corner the start is inside the surface. Also returns its distance from the surface.
    pub fn start(&self, given: Vec3, normal: Vec3) -> (Vec3, f32) {
        let near = |place, search| Some((place, self.nearest(place, normal, search)?));
        let found = self.model.find_around(given, normal, self.slack, near);
        let Some((place, (depth, stack, hit))) = found else {
            let given = self.model.ground_above(given, normal).map_or(given, |(place, _)| place);
            let skin = skin([given]);
            return (given + skin * normal, skin);
        };
        let end = EndRule::new(magnitude(hit.corners));
        // Paths start in the plane of the file: from a face that was moved below it, the edge of a carpet hides light.
        let above = depth.clamp(0.0, stack);
        let inside = self.model.off_edges(hit.corners, place + (above - depth) * normal, normal, end);
        (inside + hit.skin * normal, hit.skin)
    }

    /// The nearest of the surfaces along the normal of a point whose normals have at least this cosine with it, its distance against the
    /// normal, and the largest distance of faces of its stack from their common plane.
    fn nearest(
        &self,
        given: Vec3,
        normal: Vec3,
        search: SurfaceSearch,
    ) -> Option<(f32, f32, SurfaceHit<'_>)> {
        /// Largest number of surfaces that are tried: bounds the time where many sheets lie on each other.
        const MAX_SURFACES: usize = 64;
        let mut ray = Packet::EMPTY;
        ray.set_ray(0, given + self.reach * normal, -normal);
        (ray.near[0], ray.far[0]) = (0.0, 2.0 * self.reach);
        let mut found: Option<(f32, f32, SurfaceHit)> = None;
        for _ in 0..MAX_SURFACES {
            let mut hits = Hits::NONE;
            self.intersect(std::slice::from_ref(&ray), std::slice::from_mut(&mut hits));
            let Some(hit) = self.place(&ray, &hits, 0, -normal) else { break };
            let depth = hits.t[0] - self.reach;
            // Stacked faces were moved either way.
            let stack = 2.0 * self.model.stack_distance(hits.instance[0], hits.triangle[0]);
            // Of faces that were moved off each other the first is that of this side of the common plane.
            let is_nearer =
                |(other, ..): &(f32, f32, SurfaceHit)| depth.abs() + stack + hit.skin < other.abs();
            // A point that lies higher than rays start has the light of its place.
            let near = hit.skin.max(skin([given]));
            let above = if search.is_near { near } else { self.slack };
            let is_on = depth <= near.max(stack) && -depth <= above.max(stack);
            if hit.cosine.abs() >= search.min_cosine && is_on && found.as_ref().is_none_or(is_nearer) {
                found = Some((depth, stack, hit));
            }
            ray.near[0] = hits.t[0].next_up();
        }
        found
    }

    /// Sets `blocked[k]` to the mask of blocked lanes of `packets[k]`.
    pub fn blocked(&self, packets: &[Packet], blocked: &mut [u32]) {
        self.traced.occluded_by(TRAVERSAL, packets, blocked);
    }

    /// First hits of `packets`.
    pub fn intersect(&self, packets: &[Packet], hits: &mut [Hits]) {
        self.traced.first_hits(TRAVERSAL, packets, hits);
    }

    /// The hit of a lane whose ray has the unit vector `direction`; `None` if the ray left the scene.
    pub fn place(&self, ray: &Packet, hits: &Hits, lane: usize, direction: Vec3) -> Option<SurfaceHit<'_>> {
        let t = hits.triangle[lane];
        if t == Hits::NO_HIT {
            return None;
        }
        let instance = &self.model.instances()[hits.instance[lane] as usize];
        let mesh = self.model.mesh_of(hits.instance[lane]);
        let front = instance.turned(self.normals[instance.mesh as usize][t as usize]);
        let (reflectance, emission, profile) = match instance.material {
            Some(m) => {
                let material = &self.model.scene().materials[m as usize];
                (material.reflectance, material.emission, None)
            }
            None => {
                let material = &mesh.materials[mesh.triangle_material[t as usize] as usize];
                (mesh.triangle_reflectance[t as usize], material.emission, material.profile.as_deref())
            }
        };
        // The face where it stands; Embree meets it in the frame of its mesh.
        let own = mesh.corners(t);
        let (placed, skin) = if instance.mesh == 0 {
            (own, skin(own))
        } else {
            let placed = own.map(|p| instance.affine().transform_point3(p.as_dvec3()).as_vec3());
            (placed, skin(placed).max(instance.scale() * skin(own)))
        };
        // Rounding of a long ray may exceed the skin of a face near the origin.
        let met = ray.point(lane, hits.t[lane]);
        let cosine = -front.dot(direction);
        // Fine ground has neither the height nor the slope of the face that stands for it.
        let is_fine = mesh.fine_ground.as_ref().is_some_and(|ground| ground.replaces(t));
        let met = if is_fine { met } else { met - front.dot(met - placed[0]) * front };
        let is_back = cosine < if is_fine { -FineGround::MAX_BACK } else { 0.0 };
        let normal = if is_back { -front } else { front };
        Some(SurfaceHit {
            position: met + skin * normal,
            skin,
            normal,
            reflectance,
            emission,
            profile,
            corners: placed,
            cosine,
        })
    }
}
