//! The all-weather sky of Perez from irradiances (R. Perez, R. Seals, J. Michalsky, *All-weather model for sky luminance distribution*,
//! Solar Energy 50, 1993), and its luminous efficacies (R. Perez et al., *Modeling daylight availability and irradiance components from
//! direct and global irradiance*, Solar Energy 44, 1990).

use super::gradation::{Gradation, Shape};
use glam::DVec3;

/// Solar constant of the two papers, W/m².
pub(super) const SOLAR_CONSTANT: f64 = 1367.0;

/// Upper limits of clearness of the eight bins, and x1 to x4 of the coefficients a to e (1993, table 1):
/// x = x1 + x2 Zs + Δ (x3 + x4 Zs), where Zs is the angle of the sun to the zenith in radians and Δ the brightness.
const BINS: [(f64, [[f64; 4]; 5]); 8] = [
    (
        1.065,
        [
            [1.3525, -0.2576, -0.269, -1.4366],
            [-0.767, 0.0007, 1.2734, -0.1233],
            [2.8, 0.6004, 1.2375, 1.0],
            [1.8734, 0.6297, 0.9738, 0.2809],
            [0.0356, -0.1246, -0.5718, 0.9938],
        ],
    ),
    (
        1.23,
        [
            [-1.2219, -0.773, 1.4148, 1.1016],
            [-0.2054, 0.0367, -3.9128, 0.9156],
            [6.975, 0.1774, 6.4477, -0.1239],
            [-1.5798, -0.5081, -1.7812, 0.108],
            [0.2624, 0.0672, -0.219, -0.4285],
        ],
    ),
    (
        1.5,
        [
            [-1.1, -0.2515, 0.8952, 0.0156],
            [0.2782, -0.1812, -4.5, 1.1766],
            [24.7219, -13.0812, -37.7, 34.8438],
            [-5.0, 1.5218, 3.9229, -2.6204],
            [-0.0156, 0.1597, 0.4199, -0.5562],
        ],
    ),
    (
        1.95,
        [
            [-0.5484, -0.6654, -0.2672, 0.7117],
            [0.7234, -0.6219, -5.6812, 2.6297],
            [33.3389, -18.3, -62.25, 52.0781],
            [-3.5, 0.0016, 1.1477, 0.1062],
            [0.4659, -0.3296, -0.0876, -0.0329],
        ],
    ),
    (
        2.8,
        [
            [-0.6, -0.3566, -2.5, 2.325],
            [0.2937, 0.0496, -5.6812, 1.8415],
            [21.0, -4.7656, -21.5906, 7.2492],
            [-3.5, -0.1554, 1.4062, 0.3988],
            [0.0032, 0.0766, -0.0656, -0.1294],
        ],
    ),
    (
        4.5,
        [
            [-1.0156, -0.367, 1.0078, 1.4051],
            [0.2875, -0.5328, -3.85, 3.375],
            [14.0, -0.9999, -7.1406, 7.5469],
            [-3.4, -0.1078, -1.075, 1.5702],
            [-0.0672, 0.4016, 0.3017, -0.4844],
        ],
    ),
    (
        6.2,
        [
            [-1.0, 0.0211, 0.5025, -0.5119],
            [-0.3, 0.1922, 0.7023, -1.6317],
            [19.0, -5.0, 1.2438, -1.9094],
            [-4.0, 0.025, 0.3844, 0.2656],
            [1.0468, -0.3788, -2.4517, 1.4656],
        ],
    ),
    (
        f64::INFINITY,
        [
            [-1.05, 0.0289, 0.426, 0.359],
            [-0.325, 0.1156, 0.7781, 0.0025],
            [31.0625, -14.5, -46.1148, 55.375],
            [-7.2312, 0.405, 13.35, 0.6234],
            [1.5, -0.6426, 1.8564, 0.5636],
        ],
    ),
];

/// Coefficients of the luminous efficacy of diffuse and of direct light by bin, lm/W (1990, table 4).
const EFFICACY: [[[f64; 4]; 2]; 8] = [
    [[97.24, -0.46, 12.0, -8.91], [57.2, -4.55, -2.98, 117.12]],
    [[107.22, 1.15, 0.59, -3.95], [98.99, -3.46, -1.21, 12.38]],
    [[104.97, 2.96, -5.53, -8.77], [109.83, -4.9, -1.71, -8.81]],
    [[102.39, 5.59, -13.95, -13.9], [110.34, -5.84, -1.99, -4.56]],
    [[100.71, 5.94, -22.75, -23.74], [106.36, -3.97, -1.75, -6.16]],
    [[106.42, 3.83, -36.15, -28.83], [107.19, -1.25, -1.51, -26.73]],
    [[141.88, 1.9, -53.24, -14.03], [105.75, 0.77, -1.26, -34.44]],
    [[152.23, 0.35, -45.27, -7.98], [101.18, 1.58, -1.1, -8.29]],
];

/// Brightness that the measurements behind the model have; others are moved to the nearest, as Radiance's gendaylit does.
const BRIGHTNESS: [f64; 2] = [0.01, 0.6];
/// Smallest brightness in bins 2 to 4: with less the coefficients there give negative radiance (gendaylit and gendaymtx, after the author
/// of the model).
const MIN_PARTLY_CLOUDY_BRIGHTNESS: f64 = 0.2;

/// State of the atmosphere in the variables of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Atmosphere {
    /// Clearness ε, at least 1.
    pub clearness: f64,
    /// Brightness Δ.
    pub brightness: f64,
    /// Angle of the sun to the zenith, radians.
    pub zenith_angle: f64,
}

impl Atmosphere {
    /// From direct normal and diffuse horizontal irradiance, and normal irradiance outside the atmosphere, W/m², with the sun at an angle
    /// to the zenith, radians.
    pub fn new(direct: f64, diffuse: f64, outside: f64, zenith_angle: f64) -> Atmosphere {
        let cubed = 1.041 * zenith_angle.powi(3);
        let clearness = ((diffuse + direct) / diffuse + cubed) / (1.0 + cubed);
        let brightness = diffuse * air_mass(zenith_angle) / outside;
        Atmosphere { clearness, brightness: brightness.clamp(BRIGHTNESS[0], BRIGHTNESS[1]), zenith_angle }
    }

    fn bin(&self) -> usize {
        BINS.iter().position(|(upper, _)| self.clearness < *upper).unwrap_or(BINS.len() - 1)
    }

    /// The sky with the sun in a local direction.
    pub fn shape(&self, sun: DVec3) -> Shape {
        let bin = self.bin();
        let delta = match bin {
            1..=3 => self.brightness.max(MIN_PARTLY_CLOUDY_BRIGHTNESS),
            _ => self.brightness,
        };
        let zs = self.zenith_angle;
        let x = BINS[bin].1;
        let mut values = x.map(|[x1, x2, x3, x4]| x1 + x2 * zs + delta * (x3 + x4 * zs));
        if bin == 0 {
            let ([c1, c2, c3, c4], [d1, d2, d3, d4]) = (x[2], x[3]);
            values[2] = (delta * (c1 + c2 * zs)).powf(c3).exp() - c4;
            values[3] = -(delta * (d1 + d2 * zs)).exp() + d3 + delta * d4;
        }
        Shape::Gradation(Gradation::perez(values, sun))
    }

    /// Luminous efficacy of diffuse and of direct light, lm/W, with a dew point in °C.
    pub fn efficacy(&self, dew_point: f64) -> [f64; 2] {
        // Precipitable water, cm.
        let water = (0.07 * dew_point - 0.075).exp();
        let [[a, b, c, d], [p, q, r, s]] = EFFICACY[self.bin()];
        let zs = self.zenith_angle;
        let diffuse = a + b * water + c * zs.cos() + d * self.brightness.ln();
        let direct = p + q * water + r * (5.73 * zs - 5.0).exp() + s * self.brightness;
        [diffuse, direct].map(|v| v.max(0.0))
    }
}

/// Relative optical air mass (F. Kasten 1965, as in the papers of Perez), at an angle to the zenith of at most 90°, radians.
fn air_mass(zenith_angle: f64) -> f64 {
    let degrees = zenith_angle.to_degrees().min(90.0);
    1.0 / (zenith_angle.cos().max(0.0) + 0.15 * (93.885 - degrees).powf(-1.253))
}
