//! Objects, and nodes of glTF files, that are moved before a scene is checked: variants of one file.

use super::{Soup, UpAxis, names::some_names, size::ends};
use crate::{
    Error, Result,
    error::{figure, quote},
};
use glam::{DAffine3, DMat3, DVec3};
use std::collections::HashMap;

/// A rigid motion of all objects or nodes of one name.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    /// Name of the objects or nodes.
    name: String,
    /// Displacement, scene units, in the coordinates of the file.
    by: DVec3,
    /// Rotation about the upward axis through the centre of the bounding box, degrees, counterclockwise seen from above.
    degrees: f64,
}

impl Move {
    /// Parses `NAME=X,Y,Z` or `NAME=X,Y,Z,DEGREES`; the name may contain `=`.
    ///
    /// # Errors
    /// [`Error::Argument`] for another form, or for numbers that are not finite.
    pub fn parse(text: &str) -> Result<Move> {
        let wrong = || {
            let form = "write NAME=X,Y,Z or NAME=X,Y,Z,DEGREES, as in chair=0.5,0,0 or chair=0.5,0,0,90";
            Error::argument("move", quote(text), form)
        };
        let (name, numbers) = text.rsplit_once('=').ok_or_else(wrong)?;
        let numbers: Option<Vec<f64>> = numbers.split(',').map(|n| n.trim().parse().ok()).collect();
        let numbers = numbers.filter(|list| list.iter().all(|n| n.is_finite())).ok_or_else(wrong)?;
        let (x, y, z, degrees) = match numbers[..] {
            [x, y, z] if !name.is_empty() => (x, y, z, 0.0),
            [x, y, z, degrees] if !name.is_empty() => (x, y, z, degrees),
            _ => return Err(wrong()),
        };
        Ok(Move { name: name.to_owned(), by: DVec3::new(x, y, z), degrees })
    }

    /// The motion, for something with its centre there.
    fn transform(&self, centre: DVec3, up: Option<UpAxis>) -> Result<DAffine3> {
        let turn = match up {
            _ if self.degrees == 0.0 => DMat3::IDENTITY,
            Some(up) => DMat3::from_axis_angle(up.vector().as_dvec3(), self.degrees.to_radians()),
            None => {
                let turn = format!("{} by {} degrees", quote(&self.name), figure(self.degrees));
                let problem = "the upward axis of this scene is not stated";
                return Err(Error::argument("move", turn, problem).with_cure("state it with ⟨up⟩"));
            }
        };
        Ok(DAffine3 { matrix3: turn, translation: centre + self.by - turn * centre })
    }
}

/// Moves the named objects of the soup, in the order of the moves.
///
/// # Errors
/// No object has such a name, or a rotation is asked for and the upward axis `up` is not stated.
pub(super) fn move_objects(soup: &mut Soup, moves: &[Move], up: Option<UpAxis>) -> Result<()> {
    for motion in moves {
        let objects = soup.objects.iter().zip(0..).filter(|(name, _)| **name == motion.name);
        let objects: Vec<u32> = objects.map(|(_, number)| number).collect();
        if objects.is_empty() {
            return Err(unknown(motion, soup.objects.iter()));
        }
        for object in objects {
            move_object(soup, object, motion, up)?;
        }
    }
    Ok(())
}

/// Moves one object. Its vertices become its own, because others may use them too.
fn move_object(soup: &mut Soup, object: u32, motion: &Move, up: Option<UpAxis>) -> Result<()> {
    let polygons = (0..soup.polygons()).filter(|&polygon| soup.polygon_object[polygon] == object);
    let corners: Vec<usize> = polygons.flat_map(|polygon| soup.span(polygon)).collect();
    let position = |&corner: &usize| soup.positions[soup.corners[corner] as usize];
    let transform = motion.transform(centre(corners.iter().map(position)), up)?;
    if let Some(ground) = &mut soup.ground {
        ground.transform(object, &transform);
    }
    let mut copies = HashMap::new();
    for corner in corners {
        let vertex = soup.corners[corner];
        let copy = *copies.entry(vertex).or_insert_with(|| {
            soup.positions.push(transform.transform_point3(soup.positions[vertex as usize]));
            soup.positions.len() as u32 - 1
        });
        soup.corners[corner] = copy;
    }
    Ok(())
}

/// Moves the named nodes of a glTF file: names and transforms of all nodes, and the positions of a node's mesh by its number. +y is the
/// upward axis unless `up` states another.
///
/// # Errors
/// No node has such a name, or as `positions`.
pub(super) fn move_nodes(
    nodes: &mut [(&str, &mut DAffine3)],
    positions: impl Fn(usize) -> Result<Vec<DVec3>>,
    moves: &[Move],
    up: Option<UpAxis>,
) -> Result<()> {
    for motion in moves {
        let mut found = false;
        for (number, (name, world)) in nodes.iter_mut().enumerate() {
            if **name == *motion.name {
                found = true;
                let placed = positions(number)?.into_iter().map(|p| world.transform_point3(p));
                **world = motion.transform(centre(placed), up.or(Some(UpAxis::Y)))? * **world;
            }
        }
        if !found {
            return Err(unknown(motion, nodes.iter().map(|(name, _)| *name)));
        }
    }
    Ok(())
}

fn unknown<'a, S: AsRef<str> + ?Sized + 'a>(motion: &Move, names: impl Iterator<Item = &'a S>) -> Error {
    let (name, known) = (quote(&motion.name), some_names(names));
    let problem = format!("no object or node is called `{name}`");
    Error::argument("move", "", problem).with_cure(format!("there are {known}"))
}

/// Centre of the bounding box; the origin without points.
fn centre(points: impl Iterator<Item = DVec3>) -> DVec3 {
    let (low, high) = ends(points);
    if low.x <= high.x { (low + high) / 2.0 } else { DVec3::ZERO }
}
