//! Reflectances of materials.

use mrvis::Scene;
use mrvis::internals::SceneParts;
use mrvis::internals::error::quote;
use std::fmt::Write;

/// Reflectances, the materials of the largest area first.
pub(super) fn list_materials(out: &mut String, s: &Scene, limit: usize) -> std::fmt::Result {
    let materials = reflectances(s);
    writeln!(out, "materials by area: reflectance, mean and RGB")?;
    for (material, [r, g, b]) in materials.iter().take(limit) {
        let mean = (r + g + b) / 3.0;
        writeln!(
            out,
            "  {mean:>12.3}  {r:.3} {g:.3} {b:.3}  {}",
            quote(&s.parts().materials[*material].name)
        )?;
    }
    left_out(out, materials.len(), limit)
}

/// The last line of a list of `limit` things if there are more.
pub(super) fn left_out(out: &mut String, all: usize, limit: usize) -> std::fmt::Result {
    if all > limit { writeln!(out, "  and {} more (--all)", all - limit) } else { Ok(()) }
}

/// Materials that faces have, with the reflectance of these faces in the mean over their area, that of textures included; by area in
/// descending order. Faces of shared meshes count once.
pub(super) fn reflectances(s: &Scene) -> Vec<(usize, [f64; 3])> {
    let mut sums = vec![[0.0; 4]; s.parts().materials.len()];
    for mesh in std::iter::once(s).chain(s.parts().shared.iter().map(|mesh| mesh.as_ref())) {
        for t in 0..mesh.parts().triangles.len() {
            let [a, b, c] = mesh.corners(t as u32).map(|p| p.as_dvec3());
            let area = (b - a).cross(c - a).length();
            // Shared meshes have the materials of the scene that places them.
            let [r, g, b] = mesh.parts().triangle_reflectance[t].map(f64::from);
            if let Some(sum) = sums.get_mut(mesh.parts().triangle_material[t] as usize) {
                sum.iter_mut().zip([area, area * r, area * g, area * b]).for_each(|(sum, part)| *sum += part);
            }
        }
    }
    let mut order: Vec<usize> = (0..sums.len()).filter(|&m| sums[m][0] > 0.0).collect();
    order.sort_by(|&a, &b| sums[b][0].total_cmp(&sums[a][0]));
    order.into_iter().map(|m| (m, [1, 2, 3].map(|c| sums[m][c] / sums[m][0]))).collect()
}
