//! Rooms seen from outside.

use super::*;

/// A wall hides what is behind it from its dark side, unless the picture looks inside.
#[test]
fn walls_are_opaque_from_outside_unless_pictures_look_inside() {
    let above = |look_inside| {
        let (_, mut two) = square(|_| 2.0);
        let count = two.vertices.len() as u32;
        let under: Vec<Vec3> = two.vertices.iter().map(|p| *p - Vec3::Z).collect();
        two.vertices.extend(under);
        let fronts = two.elements.clone();
        for (element, front) in two.elements.iter_mut().zip(&fronts) {
            // Turned over: lit from below.
            let [a, b, c, d] = front.corners;
            element.corners = [a, d, c, b];
        }
        let below = fronts.iter().map(|e| Element { corners: e.corners.map(|v| v + count), ..*e });
        two.elements.extend(below);
        let mesh = Mesh::new(&two);
        let stage = Stage::new(&mesh, &two).expect("a stage").looking_inside(look_inside);
        render(&stage, &camera(1.0), [21, 15], 1, &()).first[7 * 21 + 10].map(|f| f.distance)
    };
    assert!(above(false).is_none() && above(true).is_some_and(|t| (t - 2.0).abs() < 0.01));
}
