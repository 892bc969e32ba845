//! Irradiances of a cloudless sky by turbidity (P. Ineichen and R. Perez, *A new airmass independent formulation for the Linke turbidity
//! coefficient*, Solar Energy 73, 2002). The radiance then has the distribution of the CIE standard clear sky.

/// Normal irradiance of the sun and diffuse horizontal irradiance of the sky, W/m², for a Linke turbidity (2 for very clean cold air, 3 clean warm
/// air, 4 to 6 moist or polluted air), the angle of the sun to the zenith in radians below π/2, the altitude in m and the normal irradiance outside the
/// atmosphere in W/m².
pub(super) fn irradiances(turbidity: f64, zenith_angle: f64, altitude: f64, outside: f64) -> [f64; 2] {
    let cosine = zenith_angle.cos();
    let mass = air_mass(zenith_angle) * pressure(altitude) / pressure(0.0);
    let (f1, f2) = ((-altitude / 8000.0).exp(), (-altitude / 1250.0).exp());
    let (g1, g2) = (5.09e-5 * altitude + 0.868, 3.92e-5 * altitude + 0.0387);
    let global = g1 * outside * cosine * (-g2 * mass * (f1 + f2 * (turbidity - 1.0))).exp();
    let beam = outside * (0.664 + 0.163 / f1) * (-0.09 * mass * (turbidity - 1.0)).exp();
    // Upper limit of the beam from the smallest part that is diffuse.
    let part = 1.0 - (0.1 - 0.2 * (-turbidity).exp()) / (0.1 + 0.882 / f1);
    let direct = beam.min(global * part.max(0.0) / cosine);
    [direct, (global - direct * cosine).max(0.0)]
}

/// Relative optical air mass (F. Kasten and A. Young 1989).
fn air_mass(zenith_angle: f64) -> f64 {
    let degrees = zenith_angle.to_degrees();
    1.0 / (zenith_angle.cos() + 0.50572 * (96.07995 - degrees).powf(-1.6364))
}

/// Pressure of the standard atmosphere at an altitude in m, hPa (as in pvlib's `alt2pres`).
pub(super) fn pressure(altitude: f64) -> f64 {
    ((44331.514 - altitude) / 11880.516).powf(1.0 / 0.190_263_2)
}
