use super::*;
use crate::form_factors::testing::{opposed_rectangles, quad, unobstructed};
use crate::scene::testing::{direction, unit};
use glam::{DMat3, DQuat, DVec3, dvec3};
use rand_pcg::Pcg64Mcg;

fn near(got: f64, want: f64, tolerance: f64, what: &str) {
    assert!((got - want).abs() <= tolerance, "{what}: {got} instead of {want}");
}

/// Mean of the point form factor over a rectangle by the midpoint rule: independent of the closed forms of pairs.
fn integrated(corner: DVec3, u: DVec3, v: DVec3, other: &[DVec3], n: usize) -> f64 {
    let normal = u.cross(v).normalize();
    let at = |i: usize| (i as f64 + 0.5) / n as f64;
    let sum: f64 = (0..n * n)
        .map(|k| point_to_polygon(corner + u * at(k % n) + v * at(k / n), normal, other).max(0.0))
        .sum();
    sum / (n * n) as f64
}

#[test]
fn published_rectangles() {
    for (id, [a, b, ..], want) in unobstructed("par-plate") {
        near(opposed_rectangles([a, b], 1.0), want, 1e-9, &id);
    }
    for (id, [y, z, ..], want) in unobstructed("per-plate-sharing") {
        let floor = quad(DVec3::ZERO, y * DVec3::X, DVec3::Y);
        let wall = quad(DVec3::ZERO, DVec3::Y, z * DVec3::Z);
        near(polygon_to_polygon(&floor, &wall), want, 1e-8, &id);
    }
    for (id, [y, offset, z, rise], want) in unobstructed("per-plate-nonsharing") {
        let floor = quad(offset * DVec3::X, y * DVec3::X, DVec3::Y);
        let wall = quad(rise * DVec3::Z, DVec3::Y, z * DVec3::Z);
        near(polygon_to_polygon(&floor, &wall), want, 1e-9, &id);
    }
}

#[test]
fn polygons_with_many_corners_tend_to_the_disc() {
    let corners = 2000;
    let disc: Vec<DVec3> = (0..corners)
        .map(|k| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(corners)).sin_cos();
            dvec3(0.7 * sin, 0.7 * cos, 1.3)
        })
        .collect();
    for offset in [0.0, 0.4, 2.0] {
        let got = point_to_polygon(dvec3(offset, 0.0, 0.0), DVec3::Z, &disc);
        // Hamilton and Morgan 1952; Howell B-13.
        let (g, a, r) = (1.3 * 1.3, offset * offset, 0.7 * 0.7);
        let want = 0.5 * (1.0 - (g + a - r) / f64::sqrt((g + a + r) * (g + a + r) - 4.0 * a * r));
        near(got, want, 1e-6, "disc");
    }
}

#[test]
fn point_factors_average_to_pair_factors() {
    let (u, v) = (dvec3(2.0, 0.0, 0.0), dvec3(0.0, 1.5, 0.0));
    // A general position in which both polygons are clipped.
    let turn = DMat3::from_quat(DQuat::from_rotation_x(2.2) * DQuat::from_rotation_z(0.4));
    let other = quad(dvec3(0.3, 1.9, -0.4), turn * dvec3(1.1, 0.0, 0.0), turn * dvec3(0.0, 1.7, 0.0));
    let first = quad(DVec3::ZERO, u, v);
    let pair = polygon_to_polygon(&first, &other);
    assert!(pair > 0.05, "the second is in sight: {pair}");
    near(pair, integrated(DVec3::ZERO, u, v, &other, 300), 1e-5, "general position");
    let area = |p: &[DVec3]| (p[1] - p[0]).cross(p[3] - p[0]).length();
    near(polygon_to_polygon(&other, &first) * area(&other), pair * area(&first), 1e-9, "reciprocity");
}

#[test]
fn a_point_in_a_box_sees_all_of_it() {
    let corner = |k: usize| dvec3((k & 1) as f64, (k >> 1 & 1) as f64 * 2.0, (k >> 2) as f64 * 0.5);
    // The fronts of the faces point inwards.
    let faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    for normal in [dvec3(1.0, 2.0, 3.0), dvec3(-1.0, 0.2, 0.1), DVec3::Z, dvec3(0.0, -1.0, 1.0)] {
        let normal = normal.normalize();
        let parts = faces.map(|f| point_to_polygon(dvec3(0.3, 0.7, 0.2), normal, &f.map(corner)));
        assert!(parts.iter().all(|&f| f >= 0.0), "{parts:?}");
        near(parts.iter().sum(), 1.0, 1e-12, "sum over a closed box");
    }
    let outside = point_to_polygon(dvec3(0.3, 0.7, -1.0), DVec3::Z, &faces[0].map(corner));
    assert!(outside < -0.1, "a back side counts as negative: {outside}");
    // The row of a face that touches its neighbours in a closed box.
    let floor = faces[0].map(corner);
    let row: f64 = faces[1..].iter().map(|f| polygon_to_polygon(&floor, &f.map(corner))).sum();
    near(row, 1.0, 1e-8, "row sum of a box");
}

#[test]
fn degenerate_input_is_zero() {
    let square = quad(DVec3::ZERO, DVec3::X, DVec3::Y);
    assert_eq!(point_to_polygon(dvec3(0.5, 0.5, 0.0), DVec3::Z, &square), 0.0);
    assert_eq!(point_to_polygon(dvec3(5.0, 0.5, 0.0), DVec3::X, &square), 0.0);
    assert_eq!(point_to_polygon(DVec3::Z, DVec3::Z, &square), 0.0);
    assert_eq!(point_to_polygon(DVec3::Z, -DVec3::Z, &[]), 0.0);
    assert_eq!(polygon_to_polygon(&square, &square), 0.0);
    assert_eq!(polygon_to_polygon(&square, &square[..2]), 0.0);
    // One polygon behind the other, fronts in the same direction.
    let behind = quad(-DVec3::Z, DVec3::X, DVec3::Y);
    assert_eq!(polygon_to_polygon(&square, &behind), 0.0);
}

#[test]
fn concave_polygons_are_differences() {
    let at = |x: f64, y: f64| dvec3(x, y, 1.0);
    // An L, clockwise seen from above so that its front faces down.
    let l = [at(0., 0.), at(0., 2.), at(1., 2.), at(1., 1.), at(2., 1.), at(2., 0.)];
    let whole = [at(0., 0.), at(0., 2.), at(2., 2.), at(2., 0.)];
    let notch = [at(1., 1.), at(1., 2.), at(2., 2.), at(2., 1.)];
    for normal in [DVec3::Z, dvec3(1.0, 0.0, 0.3).normalize(), dvec3(0.9, 0.8, -0.2).normalize()] {
        let f = |p: &[DVec3]| point_to_polygon(dvec3(0.9, 0.6, 0.0), normal, p);
        near(f(&l), f(&whole) - f(&notch), 1e-12, "L");
        assert!(f(&l) > 0.0);
    }
}

/// Random triangles and quadrilaterals, from both sides, some across the horizon, some near.
#[test]
fn far_polygons_have_the_closed_form() {
    let mut random = Pcg64Mcg::new(3);
    let (mut found, mut rejected) = (0, 0);
    for round in 0..20_000 {
        let normal = direction(&mut random).as_dvec3();
        let [u, v, plane] = [(); 3].map(|()| direction(&mut random).as_dvec3());
        let (u, v) = (u.cross(plane), v.cross(plane));
        let centre = direction(&mut random).as_dvec3() * (1.0 + 40.0 * unit(&mut random));
        let mut polygon = vec![centre, centre + u, centre + v];
        if round % 2 == 0 {
            polygon.push(centre + v - 0.5 * u);
        }
        let exact = point_to_polygon(DVec3::ZERO, normal, &polygon);
        let Some(far) = point_to_far_polygon(DVec3::ZERO, normal, &polygon) else {
            rejected += 1;
            continue;
        };
        found += 1;
        // Faces seen at a grazing angle have a small factor: the error is relative to that of a face turned to the point.
        let area = 0.5 * u.cross(v).length();
        let scale = exact.abs().max(0.02 * area / centre.length_squared());
        assert!((far - exact).abs() < 2e-3 * scale, "{far} instead of {exact}");
    }
    assert!(found > 4000 && rejected > 4000, "{found} far, {rejected} not");
}
