//! The tree of nodes: meshes and their transforms.

use super::{GPU_INSTANCING, Reader, StoredCamera, UniqueNames};
use crate::{Result, error::quote, scene::MAX_PLACEMENTS};
use glam::{DAffine3, DMat4, DQuat, DVec3};
use gltf::Node;

/// A node that places a mesh, or one instance of a node.
pub(super) struct MeshNode {
    /// Index of the mesh in the document.
    pub mesh: usize,
    /// Unique name.
    pub name: String,
    /// Transform from the mesh's coordinates to those of the file, finite.
    pub world: DAffine3,
}

/// The transforms of all nodes of a document, by index, from its JSON text: the crate reads numbers in 32 bits, which places meshes far
/// from the origin off by rounding. Empty if the text is not that of a glTF file (reported elsewhere).
pub(super) fn transforms(json: &[u8]) -> Vec<DMat4> {
    #[derive(serde::Deserialize)]
    struct Root {
        #[serde(default)]
        nodes: Vec<Transform>,
    }
    #[derive(serde::Deserialize)]
    struct Transform {
        matrix: Option<[f64; 16]>,
        translation: Option<[f64; 3]>,
        rotation: Option<[f64; 4]>,
        scale: Option<[f64; 3]>,
    }
    let matrix = |of: &Transform| {
        let turn = of.rotation.map_or(DQuat::IDENTITY, DQuat::from_array);
        let turn = if turn.length_squared() > 0.0 { turn.normalize() } else { DQuat::IDENTITY };
        let [scale, to] =
            [of.scale.unwrap_or([1.0; 3]), of.translation.unwrap_or_default()].map(DVec3::from_array);
        of.matrix.map_or_else(
            || DMat4::from_scale_rotation_translation(scale, turn, to),
            |columns| DMat4::from_cols_array(&columns),
        )
    };
    serde_json::from_slice(json).map_or(Vec::new(), |root: Root| root.nodes.iter().map(matrix).collect())
}

impl Reader<'_> {
    /// Visits the default scene, or the first, or all nodes if there is none, whose root has the transform `root`, with the transforms of
    /// the nodes. Each node is visited once, so that cycles end.
    pub fn nodes(
        &mut self,
        document: &gltf::Document,
        transforms: &[DMat4],
        root: DMat4,
    ) -> Result<Vec<MeshNode>> {
        let (mut found, mut names, mut camera_names) =
            (Vec::new(), UniqueNames::default(), UniqueNames::default());
        let mut entered = vec![false; document.nodes().count()];
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let mut stack: Vec<(Node, DMat4)> = match scene {
            Some(scene) => scene.nodes().map(|n| (n, root)).collect(),
            None => document.nodes().map(|n| (n, root)).collect(),
        };
        stack.reverse();
        while let Some((node, parent)) = stack.pop() {
            if std::mem::replace(&mut entered[node.index()], true) {
                continue;
            }
            let rounded = || DMat4::from_cols_array_2d(&node.transform().matrix().map(|c| c.map(f64::from)));
            let world = parent * transforms.get(node.index()).copied().unwrap_or_else(rounded);
            if let Some(mesh) = node.mesh() {
                let name =
                    node.name().or(mesh.name()).map_or(format!("object {}", node.index()), str::to_owned);
                let places = match self.instances(document, &node)? {
                    None => vec![world],
                    Some(list) => list.into_iter().map(|within| world * within).collect(),
                };
                for world in places {
                    let (name, world) = (names.of(&name), DAffine3::from_mat4(world));
                    if !world.is_finite() {
                        return Err(
                            self.wrong(format!("the matrix of node `{}` is not finite", quote(&name)))
                        );
                    }
                    found.push(MeshNode { mesh: mesh.index(), name, world });
                }
                if found.len() > MAX_PLACEMENTS {
                    let what = "join meshes that belong together or split the scene";
                    return Err(
                        self.wrong(format!("more than {MAX_PLACEMENTS} placements of meshes: {what}"))
                    );
                }
            }
            if let Some(camera) = node.camera() {
                self.camera(&mut camera_names, &camera, node.name(), world);
            }
            if let Some(light) = node.light() {
                self.light(&light, node.name(), world)?;
            }
            let children: Vec<_> = node.children().map(|c| (c, world)).collect();
            stack.extend(children.into_iter().rev());
        }
        Ok(found)
    }

    /// Transforms of the mesh relative to the node for each instance of the extension `EXT_mesh_gpu_instancing`;
    /// `None` without the extension.
    fn instances(&self, document: &gltf::Document, node: &Node) -> Result<Option<Vec<DMat4>>> {
        let Some(extension) = node.extension_value(GPU_INSTANCING) else { return Ok(None) };
        let wrong = |what: &str| self.wrong(format!("{GPU_INSTANCING} of node {}: {what}", node.index()));
        let accessor = |name: &str| {
            let Some(index) = extension.get("attributes").and_then(|a| a.get(name)) else { return Ok(None) };
            let index = index.as_u64().and_then(|i| usize::try_from(i).ok());
            let found = index.and_then(|i| document.accessors().nth(i));
            let found = found.ok_or_else(|| wrong("an accessor that does not exist"))?;
            if found.count() > MAX_PLACEMENTS {
                return Err(wrong(&format!("more than {MAX_PLACEMENTS} instances")));
            }
            Ok(Some(found))
        };
        let moves: Option<Vec<[f64; 3]>> = accessor("TRANSLATION")?.map(|a| self.values(&a)).transpose()?;
        let turns: Option<Vec<[f64; 4]>> = accessor("ROTATION")?.map(|a| self.values(&a)).transpose()?;
        let scales: Option<Vec<[f64; 3]>> = accessor("SCALE")?.map(|a| self.values(&a)).transpose()?;
        let counts =
            [moves.as_ref().map(Vec::len), turns.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)];
        let mut counts = counts.into_iter().flatten();
        let count = counts.next().ok_or_else(|| wrong("it lists no instances"))?;
        if counts.any(|c| c != count) {
            return Err(wrong("its lists have different lengths"));
        }
        let place = |i: usize| {
            let scale = scales.as_ref().map_or(DVec3::ONE, |s| DVec3::from_array(s[i]));
            let turn = turns.as_ref().map_or(DQuat::IDENTITY, |t| DQuat::from_array(t[i]).normalize());
            let to = moves.as_ref().map_or(DVec3::ZERO, |m| DVec3::from_array(m[i]));
            DMat4::from_scale_rotation_translation(scale, turn, to)
        };
        Ok(Some((0..count).map(place).collect()))
    }

    /// Adds a camera; cameras look along −z with y up (glTF 2.0, section 3.10). Orthographic and invalid ones are
    /// omitted.
    fn camera(&mut self, names: &mut UniqueNames, camera: &gltf::Camera, node: Option<&str>, world: DMat4) {
        let gltf::camera::Projection::Perspective(lens) = camera.projection() else { return };
        let name = camera.name().or(node).map_or(format!("camera {}", camera.index()), str::to_owned);
        let (eye, angle) = (world.transform_point3(DVec3::ZERO), f64::from(lens.yfov()));
        let along = |v: DVec3| world.transform_vector3(v).try_normalize();
        let (Some(forward), Some(up)) = (along(DVec3::NEG_Z), along(DVec3::Y)) else { return };
        let upright = eye.is_finite() && forward.cross(up).length() > 1e-6;
        if upright && angle > 0.0 && angle < std::f64::consts::PI {
            let name = names.of(&name);
            self.cameras.push(StoredCamera { name, eye, forward, up, angle });
        }
    }
}
