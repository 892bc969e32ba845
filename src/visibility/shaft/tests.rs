//! Shafts hold what they must.

use super::*;
use crate::simd::{Isa, Kernel, dispatch};

struct Make<'a>(&'a [Packet], &'a [Vec3]);

impl Kernel for Make<'_> {
    type Output = Shaft;

    fn run<S: Simd>(self, simd: S) -> Shaft {
        Shaft::of(simd, self.0, self.1, 60.0)
    }
}

/// Emitters that are small relative to their distance, off all axes, as polygons, panels and unordered points.
#[test]
fn small_lamps_far_away_are_held_whole() {
    let apex = Vec3::new(0.1, 0.2, 0.3);
    for width in [1.0f32, 0.1, 0.03, 0.01] {
        for (u, v) in [(Vec3::X, Vec3::Y), (Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.48, 0.8, 0.36))] {
            for centre in
                [Vec3::new(33.3, 31.7, 35.1), Vec3::new(-50.0, 3.0, 1.0), Vec3::new(0.3, -7.0, 40.0)]
            {
                let (u, v) = (0.5 * width * u, 0.5 * width * v);
                let quad = [centre - u - v, centre + u - v, centre + u + v, centre - u + v];
                let twice = [quad, quad.map(|p| p + 0.3 * (u + v))].concat();
                for emitter in [&quad[..], &quad[..3], &twice[..]] {
                    let mut packet = Packet::EMPTY;
                    packet.set(0, apex, emitter[0], EndRule::new(60.0));
                    let shaft = dispatch(Isa::Portable, Make(&[packet], emitter));
                    for (normal, offset) in shaft.normals.iter().zip(shaft.offsets).take(shaft.planes) {
                        for &p in emitter {
                            let beyond = normal.as_dvec3().dot(p.as_dvec3()) - f64::from(offset);
                            assert!(beyond <= 0.0, "{width} {centre}: {p} is {beyond} outside of {normal}");
                        }
                    }
                }
            }
        }
    }
}
