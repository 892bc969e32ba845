//! The mesh with light at its vertices.

use super::*;

#[test]
fn meshes_have_one_light_at_one_place() {
    let (_, mut solution) = square(|p| f64::from(p.x) + 1.0);
    // Light is continuous up to the uncertainty of the elements.
    solution.elements.iter_mut().for_each(|e| e.error = [0.1; 3]);
    let mesh = Mesh::new(&solution);
    let area: f32 = (0..mesh.triangles.len())
        .map(|t| mesh.corners(t))
        .map(|[a, b, c]| 0.5 * (b - a).cross(c - a).z)
        .sum();
    assert!((area - 1.0).abs() < 1e-6, "{area}");
    let place = |v: u32| {
        let p = mesh.positions[v as usize];
        [p.x.to_bits(), p.y.to_bits()]
    };
    let mut light: HashMap<[u32; 2], [f32; 3]> = HashMap::new();
    for (v, e) in mesh.irradiance.iter().enumerate() {
        assert_eq!(*light.entry(place(v as u32)).or_insert(*e), *e, "one light at one place");
        assert_eq!(mesh.radiosity[v], e.map(|x| 0.5 * x));
    }
}

#[test]
fn constant_light_stays_constant() {
    let (_, solution) = square(|_| 3.0);
    assert!(Mesh::new(&solution).irradiance.iter().flatten().all(|e| (e - 3.0).abs() < 1e-6));
}

/// Over each element the mesh has the element's mean light within its uncertainty, also where a shadow ends.
#[test]
fn meshes_keep_the_mean_light_of_elements() {
    for light in [|p: Vec3| f64::from(1.0 + p.x), |p: Vec3| if p.x < 0.3 { 5.0 } else { 0.2 }] {
        let (_, solution) = square(light);
        let mesh = Mesh::new(&solution);
        let mut sums = vec![(0.0, 0.0); solution.elements.len()];
        for (k, &e) in mesh.element.iter().enumerate() {
            let [a, b, c] = mesh.corners(k).map(|p| p.as_dvec3());
            let area = 0.5 * (b - a).cross(c - a).length();
            let light: f64 =
                mesh.triangles[k].iter().map(|&v| f64::from(mesh.irradiance[v as usize][0])).sum();
            sums[e as usize].0 += area;
            sums[e as usize].1 += area * light / 3.0;
        }
        for (element, (area, sum)) in solution.elements.iter().zip(sums) {
            let allowed = element.error[0].max(element.irradiance[0] / 255.0);
            let difference = (sum / area - element.irradiance[0]).abs();
            assert!(difference < 1.001 * allowed, "{difference} for {allowed}");
        }
    }
}

/// A wall stands between elements of the square that are lit and others that are not: no vertex has the light of both sides, also that in the middle of
/// an edge.
#[test]
fn vertices_are_not_shared_across_a_wall() {
    let wall = 0.5;
    let (_, mut solution) = square(|p| if p.x < wall { 1.0 } else { 0.0 });
    let values = |solution: &RadiosityMesh| -> Vec<f32> {
        let mesh = Mesh::new(solution);
        let at_wall = mesh.positions.iter().zip(&mesh.irradiance).filter(|(p, _)| p.x == wall);
        at_wall.map(|(_, e)| e[0]).collect()
    };
    let shared = values(&solution);
    assert!(shared.iter().any(|e| (e * (1.0 - e)).abs() > 1e-3), "{shared:?}");
    for element in &mut solution.elements {
        let x = element.corners.map(|v| solution.vertices[v as usize].x);
        let along = (0..4).filter(|k| x[*k] == wall && x[(k + 1) % 4] == wall);
        element.walls = along.map(|k| 1 << k).sum();
    }
    let apart = values(&solution);
    assert!(apart.iter().any(|e| *e < 0.5) && apart.iter().any(|e| *e > 0.5), "{apart:?}");
    assert!(apart.iter().all(|e| (e * (1.0 - e)).abs() < 1e-5), "{apart:?}");
}
