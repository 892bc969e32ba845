//! Decision which nodes share a mesh, and the resulting scene.
//!
//! Two or more nodes with one mesh become placements of a shared mesh. The triangles of a node are copied into the
//! scene if its mesh emits or becomes an emitter by name (each emitter is a surface of its own), if its transform
//! would falsify measurements of the mesh ([`MAX_STRETCH`]), if faces of it overlap in one plane with those of other nodes, such as
//! the walls of a room that is placed side by side, or if the scene would have no triangles of its own.

use super::{Reader, UniqueNames, lights::Placed, nodes::MeshNode};
use crate::{
    Result,
    math::Aabb,
    scene::{
        LoadOptions, MAX_STRETCH, Placement, Scene, Soup, added,
        keep::MIN_OPACITY,
        moves::move_nodes,
        resolve::{report_transparent, resolve_mesh, resolve_moved},
        stretch,
    },
};
use glam::{DAffine3, DMat3};
use std::collections::{HashMap, HashSet};

/// Largest number of triangles of a file with shared meshes among which faces in one plane are looked for: a quarter of a second (`mrvis
/// info` of what `mrvis generate forest --instances --trees 100 --trunks` writes).
const MAX_CONTACT_TRIANGLES: usize = 250_000;

/// The scene of all nodes.
pub(super) fn scene(
    reader: &mut Reader,
    document: &gltf::Document,
    nodes: &mut [MeshNode],
    options: &LoadOptions,
) -> Result<Scene> {
    move_named(reader, document, nodes, options)?;
    let nodes = &*nodes;
    let mut plan = Plan::of(reader, document, nodes, options);
    plan.copy_in_contact(reader, document, options);
    let shared = shared_meshes(reader, document, &mut plan, options);
    plan.report(reader);
    if !plan.uses.contains(&Use::Own) {
        plan.copy_first();
    }
    let mut placed: Vec<Placed> = Vec::new();
    for m in &shared {
        let same = nodes.iter().zip(&plan.uses).filter(|(n, used)| **used == Use::Shared && n.mesh == m.mesh);
        let from_mesh = DAffine3::from_translation(m.scene.origin);
        placed.extend(same.map(|(node, _)| {
            let to_world = node.world * from_mesh;
            Placed { bounds: m.scene.bounds.transformed(&to_world), mesh: &m.scene, to_world }
        }));
    }
    let own_soup = |reader: &Reader, plan: &Plan| -> Result<Soup> {
        let mut soup = own_soup(reader, document, plan)?;
        let bounds: Vec<Aabb> = placed.iter().map(|of| of.bounds).collect();
        added::add(&mut soup, &options.added, &bounds)?;
        reader.add_lights(&mut soup, &placed, options)?;
        Ok(soup)
    };
    let mut scene = match resolve_moved(own_soup(reader, &plan)?, options) {
        // The scene's own nodes may have no usable face.
        Err(_) if plan.copy_first() => resolve_moved(own_soup(reader, &plan)?, options)?,
        other => other?,
    };
    let number: HashMap<usize, u32> = shared.iter().enumerate().map(|(i, m)| (m.mesh, i as u32)).collect();
    let placed = nodes.iter().zip(&plan.uses).filter(|(_, used)| **used == Use::Shared);
    let placements = placed.map(|(node, _)| Placement {
        mesh: number[&node.mesh],
        transform: node.world,
        name: node.name.clone(),
        material: None,
        visible: true,
    });
    let placements = placements.collect();
    let sheer: Vec<&String> = shared.iter().flat_map(|m| &m.sheer).collect();
    report_transparent(sheer.into_iter(), &mut scene.repairs);
    let messages = shared.iter().flat_map(|m| m.scene.repairs.messages.iter().cloned());
    scene.repairs.messages.extend(messages);
    scene.place(shared.into_iter().map(|m| m.scene).collect(), placements)?;
    Ok(scene)
}

/// Moves the nodes that the options name.
fn move_named(
    reader: &Reader,
    document: &gltf::Document,
    nodes: &mut [MeshNode],
    options: &LoadOptions,
) -> Result<()> {
    let meshes: Vec<usize> = nodes.iter().map(|node| node.mesh).collect();
    let positions = |node: usize| {
        let mut soup = Soup::default();
        if let Some(mesh) = document.meshes().nth(meshes[node]) {
            reader.mesh(&mut soup, "", &mesh, DAffine3::IDENTITY)?;
        }
        Ok(soup.positions)
    };
    let mut placed: Vec<_> = nodes.iter_mut().map(|node| (node.name.as_str(), &mut node.world)).collect();
    move_nodes(&mut placed, positions, &options.moves, options.up)
}

/// Treatment of a node.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Use {
    /// The triangles become the scene's own.
    Own,
    /// The node becomes a placement of a shared mesh.
    Shared,
    /// An earlier node places the same mesh with the same transform.
    Omitted,
}

struct Plan<'a> {
    nodes: &'a [MeshNode],
    uses: Vec<Use>,
    /// Nodes copied because of their transform.
    stretched: usize,
    /// Nodes copied because of faces in the plane of others.
    in_contact: usize,
    /// Omitted nodes.
    repeated: usize,
}

impl<'a> Plan<'a> {
    fn of(
        reader: &Reader,
        document: &gltf::Document,
        nodes: &'a [MeshNode],
        options: &LoadOptions,
    ) -> Plan<'a> {
        let named: HashSet<&str> = options.emitters.iter().map(|(name, _)| name.as_str()).collect();
        let emits = |mesh: gltf::Mesh| {
            mesh.primitives().any(|p| {
                let material = &reader.materials[reader.material_of(&p)];
                material.emission != [0.0; 3] || named.contains(material.name.as_str())
            })
        };
        let emits: Vec<bool> = document.meshes().map(emits).collect();
        let mut total = vec![0; emits.len()];
        nodes.iter().for_each(|n| total[n.mesh] += 1);
        let mut plan =
            Plan { nodes, uses: Vec::with_capacity(nodes.len()), stretched: 0, in_contact: 0, repeated: 0 };
        for node in nodes {
            let used = if total[node.mesh] < 2 || emits[node.mesh] || named.contains(node.name.as_str()) {
                Use::Own
            } else if stretch(node.world.matrix3) > MAX_STRETCH {
                plan.stretched += 1;
                Use::Own
            } else {
                Use::Shared
            };
            plan.uses.push(used);
        }
        plan.omit_repeated();
        plan.copy_single();
        plan
    }

    /// Copies the node of each mesh that a single node shares.
    fn copy_single(&mut self) {
        let mut shared = HashMap::<usize, u32>::new();
        let sharing = self.uses.iter().zip(self.nodes).filter(|(used, _)| **used == Use::Shared);
        sharing.for_each(|(_, node)| *shared.entry(node.mesh).or_default() += 1);
        for (used, node) in self.uses.iter_mut().zip(self.nodes) {
            if *used == Use::Shared && shared[&node.mesh] < 2 {
                *used = Use::Own;
            }
        }
    }

    /// Copies the nodes with faces in the plane of faces of other nodes: only faces of the scene's own are put in order.
    fn copy_in_contact(&mut self, reader: &Reader, document: &gltf::Document, options: &LoadOptions) {
        let shared = |used: &Use| *used == Use::Shared;
        if !self.uses.iter().any(shared) || triangles(document, self.nodes) > MAX_CONTACT_TRIANGLES {
            return;
        }
        let own = |used: &Use| if shared(used) { Use::Own } else { *used };
        let all = Plan { uses: self.uses.iter().map(own).collect(), ..*self };
        let resolved = own_soup(reader, document, &all).and_then(|mut soup| {
            added::add(&mut soup, &options.added, &[])?;
            resolve_moved(soup, options)
        });
        let Ok(scene) = resolved else { return };
        let objects =
            scene.contacts.iter().flatten().map(|&object| scene.objects[object as usize].name.as_str());
        let in_contact: HashSet<&str> = objects.collect();
        for (used, node) in self.uses.iter_mut().zip(self.nodes) {
            if shared(used) && in_contact.contains(node.name.as_str()) {
                *used = Use::Own;
                self.in_contact += 1;
            }
        }
        self.copy_single();
    }

    /// Omits nodes that share a mesh and have the transform of an earlier one.
    fn omit_repeated(&mut self) {
        // Adding zero converts −0 to +0.
        let key = |i: u32| {
            let node = &self.nodes[i as usize];
            (node.mesh, node.world.to_cols_array().map(|x| (x + 0.0).to_bits()))
        };
        let sharing = (0..self.nodes.len()).filter(|&i| self.uses[i] == Use::Shared);
        let mut order: Vec<u32> = sharing.map(|i| i as u32).collect();
        order.sort_unstable_by_key(|&i| (key(i), i));
        let repeated: Vec<u32> = order.windows(2).filter(|w| key(w[0]) == key(w[1])).map(|w| w[1]).collect();
        self.repeated = repeated.len();
        repeated.into_iter().for_each(|i| self.uses[i as usize] = Use::Omitted);
    }

    /// Copies every node of `mesh`.
    fn copy_all(&mut self, mesh: usize) {
        let of_mesh = self.uses.iter_mut().zip(self.nodes).filter(|(_, n)| n.mesh == mesh);
        of_mesh.for_each(|(used, _)| *used = Use::Own);
    }

    /// Copies the first node that shares a mesh and does not shrink it to a point; whether there is one.
    fn copy_first(&mut self) -> bool {
        let first = (0..self.nodes.len())
            .find(|&i| self.uses[i] == Use::Shared && self.nodes[i].world.matrix3 != DMat3::ZERO);
        first.map(|i| self.uses[i] = Use::Own).is_some()
    }

    /// Writes counts and messages of these decisions.
    fn report(&self, reader: &mut Reader) {
        let repairs = &mut reader.repairs;
        repairs.copied_placements += self.stretched + self.in_contact;
        if self.in_contact > 0 {
            let what = "place a shared mesh with faces in the plane of those of other nodes: their triangles were copied";
            repairs.messages.push(format!("{} nodes {what}", self.in_contact));
        }
        if self.stretched > 0 {
            let what = "place a shared mesh with shear or unequal scale: their triangles were copied";
            repairs.messages.push(format!("{} nodes {what}", self.stretched));
        }
        if self.repeated > 0 {
            let what = "place a mesh exactly where another node places it: left out";
            repairs.messages.push(format!("{} nodes {what}", self.repeated));
        }
    }
}

/// A mesh that nodes share.
struct SharedMesh {
    /// Index of the mesh in the document.
    mesh: usize,
    scene: Scene,
    /// Names of its materials that are partly transparent.
    sheer: Vec<String>,
}

/// Resolves each shared mesh and adds its counts of repairs to the reader's. Nodes of a mesh without a usable face
/// are copied.
fn shared_meshes(
    reader: &mut Reader,
    document: &gltf::Document,
    plan: &mut Plan,
    options: &LoadOptions,
) -> Vec<SharedMesh> {
    let used: HashSet<usize> =
        plan.nodes.iter().zip(&plan.uses).filter(|(_, u)| **u == Use::Shared).map(|(n, _)| n.mesh).collect();
    let (mut found, mut names) = (Vec::new(), UniqueNames::default());
    for mesh in document.meshes().filter(|m| used.contains(&m.index())) {
        let soup = mesh_soup(reader, &mesh, &mut names);
        let resolved = soup.and_then(|soup| {
            let sheer = soup.materials.iter().filter(|m| (MIN_OPACITY..1.0).contains(&m.opacity));
            let sheer = sheer.map(|m| m.name.clone()).collect();
            Ok(SharedMesh { mesh: mesh.index(), scene: resolve_mesh(soup, options)?, sheer })
        });
        match resolved {
            Ok(shared) => {
                reader.repairs.add_counts(&shared.scene.repairs);
                found.push(shared);
            }
            Err(_) => plan.copy_all(mesh.index()),
        }
    }
    found
}

/// About how many triangles the nodes have in all: corners of their meshes, which strips and fans use more than once.
fn triangles(document: &gltf::Document, nodes: &[MeshNode]) -> usize {
    let corners = |p: gltf::Primitive| {
        p.indices().or_else(|| p.get(&gltf::Semantic::Positions)).map_or(0, |corners| corners.count())
    };
    let of_mesh: Vec<usize> =
        document.meshes().map(|m| m.primitives().map(corners).sum::<usize>() / 3).collect();
    nodes.iter().map(|node| of_mesh[node.mesh].max(1)).fold(0, usize::saturating_add)
}

/// The polygons of a mesh in its own coordinates, with the materials that it uses.
fn mesh_soup(reader: &Reader, mesh: &gltf::Mesh, names: &mut UniqueNames) -> Result<Soup> {
    let name = mesh.name().map_or(format!("mesh {}", mesh.index()), str::to_owned);
    // The fragment distinguishes the meshes of a file; it must not contain path separators.
    let fragment = names.of(&name.replace(['/', '\\'], "_"));
    let mut path = reader.path.as_os_str().to_owned();
    path.push(format!("#{fragment}"));
    let mut soup = Soup::new(path);
    reader.mesh(&mut soup, &name, mesh, DAffine3::IDENTITY)?;
    soup.copy_materials(&reader.materials);
    Ok(soup)
}

/// The scene's own polygons, with all materials and cameras of the file.
fn own_soup(reader: &Reader, document: &gltf::Document, plan: &Plan) -> Result<Soup> {
    let mut soup = Soup {
        materials: reader.materials.clone(),
        cameras: reader.cameras.clone(),
        repairs: reader.repairs.clone(),
        ..Soup::new(reader.path)
    };
    for (node, _) in plan.nodes.iter().zip(&plan.uses).filter(|(_, used)| **used == Use::Own) {
        if let Some(mesh) = document.meshes().nth(node.mesh) {
            reader.mesh(&mut soup, &node.name, &mesh, node.world)?;
        }
    }
    Ok(soup)
}
