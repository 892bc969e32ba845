//! Small scenes for tests, resolved like files.

use super::{LoadOptions, Scene, Soup, SoupMaterial, resolve};
use glam::{DMat3, DQuat, DVec3, Vec3};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

/// Uniform in `[0, 1)`.
pub fn unit(random: &mut Pcg64Mcg) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// Uniform in the unit cube.
pub fn in_cube(random: &mut Pcg64Mcg) -> DVec3 {
    DVec3::new(unit(random), unit(random), unit(random))
}

/// A direction, uniform on the sphere.
pub fn direction(random: &mut Pcg64Mcg) -> Vec3 {
    let (z, turn) = (2.0 * unit(random) - 1.0, std::f64::consts::TAU * unit(random));
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * turn.cos(), r * turn.sin(), z).as_vec3()
}

/// A uniformly distributed rotation (Shoemake 1992).
pub fn rotation(random: &mut Pcg64Mcg) -> DMat3 {
    let (u, a, b) =
        (unit(random), std::f64::consts::TAU * unit(random), std::f64::consts::TAU * unit(random));
    let (r, q) = ((1.0 - u).sqrt(), u.sqrt());
    DMat3::from_quat(DQuat::from_xyzw(r * a.sin(), r * a.cos(), q * b.sin(), q * b.cos()))
}

/// A scene under construction. Faces belong to the object started last.
#[derive(Clone)]
pub struct Pieces {
    soup: Soup,
    light: Option<u32>,
}

impl Pieces {
    /// An empty scene.
    pub fn new() -> Pieces {
        let mut soup = Soup::new("test");
        soup.material(SoupMaterial::diffuse("grey", [0.5; 3]));
        soup.object("things");
        Pieces { soup, light: None }
    }

    fn here(&self) -> u32 {
        self.soup.objects.len() as u32 - 1
    }

    /// Starts an object.
    pub fn object(&mut self, name: &str) -> &mut Pieces {
        self.soup.object(name);
        self
    }

    /// Adds a polygon.
    pub fn polygon(&mut self, corners: &[DVec3]) -> &mut Pieces {
        self.soup.polygon(self.here(), 0, corners);
        self
    }

    /// Adds a parallelogram with edges `u` and `v` around `centre` that faces along `u × v`.
    pub fn quad(&mut self, centre: DVec3, u: DVec3, v: DVec3) -> &mut Pieces {
        let (u, v) = (0.5 * u, 0.5 * v);
        self.polygon(&[centre - u - v, centre + u - v, centre + u + v, centre - u + v])
    }

    /// Adds a closed box with edges `axes` around `centre`.
    pub fn block(&mut self, centre: DVec3, axes: DMat3) -> &mut Pieces {
        let [u, v, w] = [axes.x_axis, axes.y_axis, axes.z_axis];
        let first = self.soup.positions.len() as u32;
        for k in 0..8u32 {
            let sign = |bit: u32| if k >> bit & 1 == 1 { 0.5 } else { -0.5 };
            self.soup.positions.push(centre + sign(0) * u + sign(1) * v + sign(2) * w);
        }
        let here = self.here();
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            self.soup.indexed_polygon(here, 0, face.map(|k| first + k));
        }
        self
    }

    /// Adds a closed axis-aligned box.
    pub fn cuboid(&mut self, min: DVec3, max: DVec3) -> &mut Pieces {
        self.block(0.5 * (min + max), DMat3::from_diagonal(max - min))
    }

    /// Adds an emitting parallelogram that faces along `u × v`.
    pub fn light(&mut self, centre: DVec3, u: DVec3, v: DVec3) -> &mut Pieces {
        let material = match self.light {
            Some(m) => m,
            None => self.soup.material(SoupMaterial::light("light", [1.0; 3])),
        };
        self.light = Some(material);
        let object = self.soup.object(format!("light {}", self.soup.objects.len()));
        let (u, v) = (0.5 * u, 0.5 * v);
        self.soup.polygon(
            object,
            material,
            &[centre - u - v, centre + u - v, centre + u + v, centre - u + v],
        );
        self
    }

    /// Resolves the scene.
    pub fn scene(self) -> Scene {
        resolve(self.soup, &LoadOptions::default()).expect("a scene")
    }
}

/// Closed cubes, or squares if `sheets`, of edge `edge`, at random positions in the box from 0 to `size` with random
/// rotations (a Poisson process).
pub fn cloud(seed: u64, count: usize, edge: f64, size: DVec3, sheets: bool) -> Pieces {
    let mut random = Pcg64Mcg::new(seed.into());
    let mut pieces = Pieces::new();
    for _ in 0..count {
        let (centre, turn) = (in_cube(&mut random) * size, rotation(&mut random) * edge);
        if sheets {
            pieces.quad(centre, turn.x_axis, turn.y_axis);
        } else {
            pieces.block(centre, turn);
        }
    }
    pieces
}
