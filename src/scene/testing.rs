//! Small scenes for tests, resolved like files.

pub use super::generate::shapes::{rotation, unit};
use super::generate::{Spec, build};
use super::{LoadOptions, Scene, Soup, SoupMaterial, resolve};
use glam::{DMat3, DVec3, Vec3};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::ops::Range;

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

/// A scene under construction. Faces belong to the object started last.
#[derive(Clone)]
pub struct Pieces {
    soup: Soup,
    material: u32,
    light: Option<u32>,
}

impl Pieces {
    /// A grey object without faces.
    pub fn new() -> Pieces {
        let mut pieces = Pieces::empty();
        pieces.grey("things", 0.5);
        pieces
    }

    /// A scene without objects.
    pub fn empty() -> Pieces {
        Pieces { soup: Soup::new("test"), material: 0, light: None }
    }

    fn here(&self) -> u32 {
        self.soup.objects.len() as u32 - 1
    }

    /// Starts an object of the same material.
    pub fn object(&mut self, name: &str) -> &mut Pieces {
        self.soup.object(name);
        self
    }

    /// Starts a grey object.
    pub fn grey(&mut self, name: &str, reflectance: f32) -> &mut Pieces {
        self.made_of(name, SoupMaterial::diffuse("grey", [reflectance; 3]))
    }

    /// Starts a black object that emits this radiance.
    pub fn glowing(&mut self, name: &str, radiance: f32) -> &mut Pieces {
        self.made_of(name, SoupMaterial::light("light", [radiance; 3]))
    }

    /// Starts an object. Objects of equal reflectance and emission share a material.
    pub fn made_of(&mut self, name: &str, material: SoupMaterial) -> &mut Pieces {
        let look = |m: &SoupMaterial| (m.reflectance, m.emission);
        let known = self.soup.materials.iter().position(|m| look(m) == look(&material));
        self.material = known.map_or_else(|| self.soup.material(material), |known| known as u32);
        self.object(name)
    }

    /// Adds a polygon.
    pub fn polygon(&mut self, corners: &[DVec3]) -> &mut Pieces {
        self.soup.polygon(self.here(), self.material, corners);
        self
    }

    /// Adds a parallelogram with this corner and edges `u` and `v` that faces along `u × v`.
    pub fn rectangle(&mut self, corner: DVec3, u: DVec3, v: DVec3) -> &mut Pieces {
        self.polygon(&[corner, corner + u, corner + u + v, corner + v])
    }

    /// Adds the faces of a box, wound inward; outward if `low` and `high` are exchanged along one axis.
    pub fn room(&mut self, low: DVec3, high: DVec3) -> &mut Pieces {
        for (_, corners) in walls(low, high) {
            self.polygon(&corners);
        }
        self
    }

    /// Adds the faces of a box but one.
    pub fn room_without(&mut self, wall: Wall, low: DVec3, high: DVec3) -> &mut Pieces {
        for (of, corners) in walls(low, high) {
            if of != wall {
                self.polygon(&corners);
            }
        }
        self
    }

    /// Adds a rectangle like [`Pieces::rectangle`] around a hole, which reaches from `low` to `high`, distances from the corner along `u`
    /// and `v`.
    pub fn pierced(&mut self, corner: DVec3, [u, v]: [DVec3; 2], [low, high]: [[f64; 2]; 2]) -> &mut Pieces {
        let ([along, across], [width, height]) = ([u.normalize(), v.normalize()], [u.length(), v.length()]);
        let parts = [
            [[0.0, 0.0], [width, low[1]]],
            [[0.0, high[1]], [width, height]],
            [[0.0, low[1]], [low[0], high[1]]],
            [[high[0], low[1]], [width, high[1]]],
        ];
        for [from, to] in parts {
            let [x, y] = [to[0] - from[0], to[1] - from[1]];
            if x > 0.0 && y > 0.0 {
                self.rectangle(corner + from[0] * along + from[1] * across, x * along, y * across);
            }
        }
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
        let here = self.here();
        self.soup.closed_box(here, self.material, |k| {
            let sign = |bit: u32| if k >> bit & 1 == 1 { 0.5 } else { -0.5 };
            centre + sign(0) * u + sign(1) * v + sign(2) * w
        });
        self
    }

    /// Adds a closed axis-aligned box.
    pub fn cuboid(&mut self, min: DVec3, max: DVec3) -> &mut Pieces {
        self.block(0.5 * (min + max), DMat3::from_diagonal(max - min))
    }

    /// Adds squares in columns and rows of these numbers, each as two triangles; `at` gives their corners.
    pub fn field(&mut self, numbers: Range<i32>, at: impl Fn(i32, i32) -> DVec3) -> &mut Pieces {
        for (i, j) in numbers.clone().flat_map(|j| numbers.clone().map(move |i| (i, j))) {
            self.polygon(&[at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            self.polygon(&[at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
        self
    }

    /// Adds a half sphere around the origin of `around` by `up` emitting quads, which face inwards.
    pub fn dome(&mut self, radius: f64, [around, up]: [i32; 2]) -> &mut Pieces {
        let shell = |turn: f64, rise: f64| {
            radius * DVec3::new(turn.cos() * rise.cos(), turn.sin() * rise.cos(), rise.sin())
        };
        for (i, j) in (0..around * up).map(|k| (k % around, k / around)) {
            let [a, b] = [i, i + 1].map(|i| TAU * f64::from(i) / f64::from(around));
            let [c, d] = [j, j + 1].map(|j| FRAC_PI_2 * f64::from(j) / f64::from(up));
            let (turn, rise) = (0.5 * (a + b), 0.5 * (c + d));
            // Wide enough to leave no gap to the next.
            let u = (shell(b, c) - shell(a, c)) * 1.02;
            let v = (shell(turn, d) - shell(turn, c)) * 1.02;
            let centre = shell(turn, rise);
            self.light(centre, u, if u.cross(v).dot(centre) < 0.0 { v } else { -v });
        }
        self
    }

    /// Adds an emitting parallelogram that faces along `u × v`.
    pub fn light(&mut self, centre: DVec3, u: DVec3, v: DVec3) -> &mut Pieces {
        let material = match self.light {
            Some(m) => m,
            None => self.soup.material(SoupMaterial::light("light", [1.0; 3])),
        };
        self.light = Some(material);
        let kept = std::mem::replace(&mut self.material, material);
        self.object(&format!("light {}", self.soup.objects.len())).quad(centre, u, v);
        self.material = kept;
        self
    }

    /// Turns all positions.
    pub fn turned(mut self, turn: DMat3) -> Pieces {
        self.soup.positions.iter_mut().for_each(|p| *p = turn * *p);
        self
    }

    /// Reverses the order of the faces.
    pub fn reversed(mut self) -> Pieces {
        let soup = &mut self.soup;
        let spans: Vec<Range<usize>> = (0..soup.polygons()).rev().map(|i| soup.span(i)).collect();
        soup.corners = spans.iter().flat_map(|span| soup.corners[span.clone()].to_vec()).collect();
        let mut end = 0;
        for (span, into) in spans.iter().zip(&mut soup.ends) {
            end += span.len() as u32;
            *into = end;
        }
        soup.polygon_object.reverse();
        soup.polygon_material.reverse();
        self
    }

    /// Resolves the scene.
    pub fn scene(self) -> Scene {
        self.scene_with(&LoadOptions::default())
    }

    /// Resolves the scene with these options.
    pub fn scene_with(self, options: &LoadOptions) -> Scene {
        resolve(self.soup, options).expect("a scene")
    }
}

/// A face of a box, by the end of the axis at which it lies.
#[derive(Clone, Copy, PartialEq)]
pub enum Wall {
    Floor,
    Ceiling,
    LowY,
    HighY,
    LowX,
    HighX,
}

/// The faces of a box, wound inward; outward if `low` and `high` are exchanged along one axis.
pub fn walls(low: DVec3, high: DVec3) -> [(Wall, [DVec3; 4]); 6] {
    let at = |k: usize| DVec3::select(glam::BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), high, low);
    [
        (Wall::Floor, [0, 1, 3, 2]),
        (Wall::Ceiling, [4, 6, 7, 5]),
        (Wall::LowY, [0, 4, 5, 1]),
        (Wall::HighY, [2, 3, 7, 6]),
        (Wall::LowX, [0, 2, 6, 4]),
        (Wall::HighX, [1, 5, 7, 3]),
    ]
    .map(|(wall, corners)| (wall, corners.map(at)))
}

/// A level rectangle that faces up.
pub fn facing_up([x0, x1]: [f64; 2], [y0, y1]: [f64; 2], z: f64) -> [DVec3; 4] {
    [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(|[x, y]| DVec3::new(x, y, z))
}

/// The same, facing down.
pub fn facing_down([x0, x1]: [f64; 2], [y0, y1]: [f64; 2], z: f64) -> [DVec3; 4] {
    let [a, b, c, d] = facing_up([x0, x1], [y0, y1], z);
    [a, d, c, b]
}

/// Runs `work` on this number of threads.
pub fn on_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(work)
}

/// A generated forest of `trees` trees with `leaves` leaves each.
pub fn forest(trees: usize, leaves: usize) -> Scene {
    build(&Spec { trees, leaves, ..Spec::new("forest") }).expect("a forest")
}

/// The generated scene of this name, of its usual size.
pub fn generated(name: &str) -> Scene {
    build(&Spec::new(name)).expect("a scene")
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
