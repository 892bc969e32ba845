//! Geometry builders of the generators: quadrilaterals, boxes, prisms.

use crate::scene::{Soup, SoupMaterial};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use rand_pcg::{
    Pcg64Mcg,
    rand_core::{Rng as _, SeedableRng},
};

/// Uniform in `[0, 1)`.
pub fn unit(random: &mut Pcg64Mcg) -> f64 {
    (random.next_u64() >> 11) as f64 * 2f64.powi(-53)
}

/// A uniformly distributed rotation (Shoemake 1992).
pub fn rotation(random: &mut Pcg64Mcg) -> DMat3 {
    let (u, turn) = (unit(random), std::f64::consts::TAU);
    let (s1, c1) = (turn * unit(random)).sin_cos();
    let (s2, c2) = (turn * unit(random)).sin_cos();
    let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
    DMat3::from_quat(DQuat::from_xyzw(a * s1, a * c1, b * s2, b * c2))
}

/// Random numbers of one generator run; independent of the platform.
pub(super) struct Random(Pcg64Mcg);

impl Random {
    pub fn new(seed: u64) -> Self {
        Random(Pcg64Mcg::seed_from_u64(seed))
    }

    /// Uniform in `[0, 1)`.
    pub fn unit(&mut self) -> f64 {
        unit(&mut self.0)
    }

    /// Uniform in `[lo, hi)`.
    pub fn between(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.unit()
    }

    /// Uniform in the box.
    pub fn point(&mut self, min: DVec3, max: DVec3) -> DVec3 {
        DVec3::new(self.between(min.x, max.x), self.between(min.y, max.y), self.between(min.z, max.z))
    }

    /// Uniform in the unit ball.
    pub fn in_ball(&mut self) -> DVec3 {
        loop {
            let p = self.point(DVec3::NEG_ONE, DVec3::ONE);
            if p.length_squared() <= 1.0 {
                return p;
            }
        }
    }

    /// A uniformly distributed rotation (Shoemake 1992).
    pub fn rotation(&mut self) -> DMat3 {
        rotation(&mut self.0)
    }
}

/// A soup under construction, with the current object and material.
pub(super) struct Builder {
    pub soup: Soup,
    object: u32,
    material: u32,
    number: usize,
}

impl Builder {
    pub fn new(name: &str) -> Self {
        Builder { soup: Soup::new(name), object: 0, material: 0, number: 0 }
    }

    /// Starts a new object.
    pub fn object(&mut self, name: impl Into<String>) -> &mut Self {
        let name = name.into();
        self.object =
            self.soup.object(if self.number > 1 { format!("{name} {}", self.number) } else { name });
        self
    }

    /// Names of the next objects end with this number, if it is above 1.
    pub fn number(&mut self, number: usize) {
        self.number = number;
    }

    /// Sets the current material: the known one of this name, or a new one.
    pub fn material(&mut self, name: &str, reflectance: [f32; 3]) -> &mut Self {
        let known = self.soup.materials.iter().position(|m| m.name == name);
        self.material = match known {
            Some(i) => i as u32,
            None => self.soup.material(SoupMaterial::diffuse(name, reflectance)),
        };
        self
    }

    /// Starts an object `light` with an emissive material of its own, radiance in W/(m² sr).
    pub fn emissive(&mut self, reflectance: f32, radiance: [f32; 3]) -> &mut Self {
        self.object("light");
        let light = SoupMaterial { reflectance: [reflectance; 3], ..SoupMaterial::light("light", radiance) };
        self.material = self.soup.material(light);
        self
    }

    /// Adds an emissive rectangle with edges `u` and `v` around `centre` that faces along `u × v`.
    pub fn light(&mut self, centre: DVec3, u: DVec3, v: DVec3, radiance: f32) {
        self.emissive(0.0, [radiance; 3]).rectangle(centre, u, v);
    }

    /// Adds a polygon, counterclockwise seen from its front.
    pub fn polygon(&mut self, corners: &[DVec3]) {
        self.soup.polygon(self.object, self.material, corners);
    }

    /// Adds a rectangle with edges `u` and `v` around `centre` that faces along `u × v`.
    pub fn rectangle(&mut self, centre: DVec3, u: DVec3, v: DVec3) {
        let (u, v) = (0.5 * u, 0.5 * v);
        self.polygon(&[centre - u - v, centre + u - v, centre + u + v, centre - u + v]);
    }

    /// Adds a closed box between two corners with outward faces.
    pub fn cuboid(&mut self, min: DVec3, max: DVec3) {
        let place = DAffine3::from_scale_rotation_translation(max - min, DQuat::IDENTITY, min);
        self.parallelepiped(place);
    }

    /// Adds a closed box of the given size around `centre`, rotated by `turn`.
    pub fn turned_box(&mut self, centre: DVec3, size: DVec3, turn: DMat3) {
        let edges = DMat3::from_cols(turn.x_axis * size.x, turn.y_axis * size.y, turn.z_axis * size.z);
        self.parallelepiped(DAffine3::from_mat3_translation(edges, centre - edges * DVec3::splat(0.5)));
    }

    /// Adds the image of the unit cube under `place`, with outward faces.
    fn parallelepiped(&mut self, place: DAffine3) {
        let corner = |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
        self.soup.closed_box(self.object, self.material, |i| place.transform_point3(corner(i)));
    }

    /// Adds a closed upright prism: a regular polygon of `corners` corners from height 0 to `height` above `foot`.
    pub fn prism(&mut self, foot: DVec3, radius: f64, height: f64, corners: u32) {
        let first = self.soup.positions.len() as u32;
        for z in [0.0, height] {
            for i in 0..corners {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(corners)).sin_cos();
                self.soup.positions.push(foot + DVec3::new(radius * cos, radius * sin, z));
            }
        }
        let (object, material) = (self.object, self.material);
        for i in 0..corners {
            let j = (i + 1) % corners;
            let side = [i, j, corners + j, corners + i].map(|k| first + k);
            self.soup.indexed_polygon(object, material, side);
        }
        self.soup.indexed_polygon(object, material, (0..corners).rev().map(|i| first + i));
        self.soup.indexed_polygon(object, material, (corners..2 * corners).map(|i| first + i));
    }

    /// Adds an open upright cylinder wall, visible from both sides, with a bottom.
    pub fn cup(&mut self, foot: DVec3, radius: f64, height: f64, corners: u32) {
        let rim = |i: u32, z: f64| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i % corners) / f64::from(corners)).sin_cos();
            foot + DVec3::new(radius * cos, radius * sin, z)
        };
        for i in 0..corners {
            self.polygon(&[rim(i, 0.0), rim(i + 1, 0.0), rim(i + 1, height), rim(i, height)]);
        }
        let bottom: Vec<DVec3> = (0..corners).rev().map(|i| rim(i, 0.0)).collect();
        self.polygon(&bottom);
    }
}
