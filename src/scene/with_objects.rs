//! Parts of scenes.

use super::Scene;

impl Scene {
    /// The scene with some of its objects.
    pub(crate) fn with_objects(&self, kept: &[bool]) -> Scene {
        let is_kept = |t: &usize| kept[self.triangle_object[*t] as usize];
        let faces: Vec<usize> = (0..self.triangles.len()).filter(is_kept).collect();
        let mut number = vec![u32::MAX; self.triangles.len()];
        faces.iter().zip(0u32..).for_each(|(&t, new)| number[t] = new);
        let mut part = self.clone();
        part.triangles = pick(&self.triangles, &faces);
        part.triangle_object = pick(&self.triangle_object, &faces);
        part.triangle_material = pick(&self.triangle_material, &faces);
        part.triangle_polygon = pick(&self.triangle_polygon, &faces);
        part.triangle_reflectance = pick(&self.triangle_reflectance, &faces);
        part.triangle_sides = pick(&self.triangle_sides, &faces);
        part.triangle_component = pick(&self.triangle_component, &faces);
        part.triangle_emitter = pick(&self.triangle_emitter, &faces);
        part.triangle_texcoords = match self.triangle_texcoords.is_empty() {
            true => Vec::new(),
            false => pick(&self.triangle_texcoords, &faces),
        };
        for emitter in &mut part.emitters {
            emitter.triangles.iter_mut().for_each(|t| *t = number[*t as usize]);
        }
        part
    }
}

fn pick<T: Copy>(values: &[T], places: &[usize]) -> Vec<T> {
    places.iter().map(|&place| values[place]).collect()
}
