//! Elements that other surfaces cross, such as a floor element with the foot of a thin wall in its middle, and elements that other surfaces
//! partly cover, such as an element of the wall one centimetre behind a cupboard.
//!
//! The irradiance differs between the two sides of such a line, so that the mean over the element is wrong on both. These elements are
//! cut along the line. Those that many surfaces cross, such as the legs of a chair, are split a few times first. Those that other surfaces
//! still cross do not exchange light, and paths that hit them continue from the hit point.

use super::linked_scene::LinkedScene;
use crate::embree::Hits;
use crate::math::Aabb;
use crate::math::parallel;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::{
    CutPlane, Elements, Shape, Side, centres_of_quarters, centroid, inner_radius,
};
use crate::ray::{LANES, Occluder, Packet};
use crate::scene::Scene;
use crate::visibility::Exact;
use glam::Vec3;
use smallvec::SmallVec;

/// Distance of the test segments from the edges and the plane of their element, as a fraction of its diameter: a surface nearer to an edge
/// leaves less than this fraction of the element on its other side.
const INSET: f32 = 1.0 / 128.0;
/// The same fraction for segments that find surfaces ending above the element, such as a sheet a few millimetres above the floor: the two
/// sides of the element have different light if the gap is narrower. With 1/8 or 1/2, light 2 cm behind a lit sheet with a gap of 3 mm is
/// 23 % or 56 % too bright (`cargo test the_bright_foot`).
const INSET_CLEAR: f32 = 1.0 / 4.0;
/// Fractions of an edge at which segments across the rim of an element along it look for surfaces, and fraction of the rim's width at which
/// these begin: of a narrower strip beyond a surface the light is less than 1/1,000 of that of the element.
const RIM_PLACES: [f32; 2] = [0.25, 0.75];
const RIM_START: f32 = 1.0 / 16.0;
/// Largest number of times that an element of the size of the local pass is split: its parts are then an eighth as wide. Four times
/// adds twice as many elements, a tenth of those of the Cornell box.
const MAX_SPLITS: i32 = 3;
/// Number of planes up to which an element that they cross is cut along them at once: the two faces of a wall, or of a corner.
const MAX_PLANES: usize = 2;
/// Largest number of rounds of cuts through the parts of an element that is not split any more: the four faces of two walls that meet.
const MAX_CUTS: usize = 4;
/// Largest number of elements added by these splits and cuts, relative to the number of all elements: time and memory of the local pass
/// at most double. If there are more crossed elements, the largest are split.
const MAX_ADDED_RATIO: f64 = 1.0;
/// Number of elements that may be added to a scene of any size: at 1.4 kB and 40 µs for each (see
/// [`FineGround::MAX_TRIANGLES`](crate::scene::FineGround::MAX_TRIANGLES)) they take 11 MB and 0.3 s.
const ALWAYS_ADDED: usize = 1 << 13;

/// What crosses an element.
struct PlanesAcross {
    /// The plane of a surface that crosses the element from edge to edge; of several, that with the largest smaller part.
    widest: Option<CutPlane>,
    /// Whether nothing else crosses the element than at most [`MAX_PLANES`] such planes.
    nothing_else: bool,
}

impl LinkedScene {
    /// Cuts and splits the parts of surfaces that other surfaces cross, the largest first, and marks the remaining ones
    /// ([`ElementState::crossed`](crate::radiosity::elements::ElementState::crossed)). Elements that at most [`MAX_PLANES`] planes cross
    /// from edge to edge, and nothing else, are cut; others are split until they are small.
    pub fn divide_at_crossings(&mut self, scene: &Scene, exact: &Exact, deadline: &Deadline) {
        self.elements.states.iter_mut().for_each(|state| state.crossed = false);
        if deadline.late() {
            return;
        }
        // Repeated passes do not split elements of the smallest size again.
        let smallest = self.elements.min_area / 4f64.powi(MAX_SPLITS - 1);
        let leaves = self.leaves();
        let mut remaining = ((MAX_ADDED_RATIO * leaves.len() as f64) as usize).max(ALWAYS_ADDED);
        let first = self.elements.len();
        self.cut_undivided(scene, exact, &leaves, smallest, remaining / 4, deadline);
        let made: Vec<u32> = (first as u32..self.elements.len() as u32).collect();
        remaining -= made.len();
        let tested = [divided(&self.elements, &leaves), made].concat();
        let mut found = crossed(&self.elements, exact, &tested);
        let mut left = Vec::new();
        for _ in 0..MAX_SPLITS as usize + MAX_CUTS {
            if found.is_empty() || deadline.late() {
                break;
            }
            sort_by_area(&self.elements, &mut found);
            let first = self.elements.len();
            for (e, planes) in found.iter().zip(self.planes_across(scene, exact, &found)) {
                let is_large = area(&self.elements, *e) > smallest && !self.elements.is_part_of_cut(*e);
                let before = self.elements.len();
                match planes.widest {
                    _ if before - first + 4 > remaining => {}
                    Some(plane) if planes.nothing_else || !is_large => _ = self.elements.cut(*e, &plane),
                    _ if is_large => self.elements.split(*e),
                    _ => {}
                }
                self.assign_feature_sizes(before);
                if self.elements.len() == before {
                    left.push(*e);
                }
            }
            remaining -= self.elements.len() - first;
            let made: Vec<u32> = (first as u32..self.elements.len() as u32).collect();
            found = crossed(&self.elements, exact, &made);
        }
        left.into_iter().chain(found).for_each(|e| self.elements.states[e as usize].crossed = true);
    }

    /// Cuts undivided surfaces above this area that at most [`MAX_PLANES`] planes cross from edge to edge, and nothing else: the largest
    /// ones, at most `count` of them. To split or mark the others takes a third more time in a furnished room, and its light changes by
    /// less than its error.
    fn cut_undivided(
        &mut self,
        scene: &Scene,
        exact: &Exact,
        leaves: &[u32],
        min_area: f64,
        count: usize,
        deadline: &Deadline,
    ) {
        let is_whole = |e: &u32| {
            let element = &self.elements.elements[*e as usize];
            element.level == 0 && element.area > min_area
        };
        let whole: Vec<u32> = leaves.iter().copied().filter(is_whole).collect();
        let mut found = crossed(&self.elements, exact, &whole);
        sort_by_area(&self.elements, &mut found);
        let (first, mut left) = (self.elements.len(), count);
        for some in found.chunks(count.max(1)) {
            for (e, planes) in some.iter().zip(self.planes_across(scene, exact, some)) {
                if let Some(plane) = planes.widest.filter(|_| planes.nothing_else && left > 0) {
                    left -= usize::from(self.elements.cut(*e, &plane));
                }
            }
            if left == 0 || deadline.late() {
                break;
            }
        }
        self.assign_feature_sizes(first);
    }

    /// For each leaf, what crosses it.
    fn planes_across(&self, scene: &Scene, exact: &Exact, leaves: &[u32]) -> Vec<PlanesAcross> {
        let hits = [INSET, INSET_CLEAR].map(|inset| {
            [false, true].map(|is_reversed| {
                first_hits(&self.elements, exact, leaves, |packet, first, corners, side| {
                    set_edges(packet, first, corners, side, inset, is_reversed)
                })
            })
        });
        parallel::map(0..leaves.len(), |k| {
            let hits = [0, 1].map(|inset: usize| [0, 1].map(|turn: usize| hits[inset][turn][k]));
            self.planes_of_hits(scene, leaves[k], &hits)
        })
    }

    /// What crosses a leaf, by the triangles that segments along its edges hit: for both insets, forwards and backwards.
    fn planes_of_hits(&self, scene: &Scene, leaf: u32, hits: &[[[u32; 4]; 2]; 2]) -> PlanesAcross {
        // All triangles of a quad have one plane, so that the cuts of neighbouring elements meet.
        let first_of_quad = |triangle: u32| {
            let sides = self.elements.sides_of_triangle[triangle as usize].into_iter();
            let of_side = |side: u32| Some(self.elements.sides.get(side as usize)?.triangles[0]);
            sides.filter_map(of_side).next().unwrap_or(triangle)
        };
        let element = &self.elements.elements[leaf as usize];
        let near = 2.0 * INSET * element.radius;
        // Planes with the edges of the leaf that meet them, one bit for each edge and inset.
        let mut found: SmallVec<[(CutPlane, u32); 8]> = SmallVec::new();
        for (inset, turns) in hits.iter().enumerate() {
            for (edge, &triangle) in turns.iter().flat_map(|of| of.iter().enumerate()) {
                if triangle == Hits::NO_HIT {
                    continue;
                }
                let plane = CutPlane::of(scene.corners(first_of_quad(triangle)));
                let bit = 1 << (4 * inset + edge);
                match found.iter_mut().find(|(other, _)| other.is_near(&plane, element.centre, near)) {
                    Some((_, edges)) => *edges |= bit,
                    None => found.push((plane, bit)),
                }
            }
        }
        let spans = |edges: u32| [edges & ALL, edges >> 4].iter().any(|of| of.count_ones() > 1);
        let mut across: SmallVec<[(f64, CutPlane); 8]> = SmallVec::new();
        for (plane, edges) in &found {
            let smaller = self.elements.smaller_part(leaf, plane);
            if spans(*edges) && smaller > 0.0 {
                across.push((smaller, *plane));
            }
        }
        across.sort_by(|a, b| b.0.total_cmp(&a.0));
        PlanesAcross {
            widest: across.first().map(|of| of.1),
            nothing_else: across.len() == found.len() && found.len() <= MAX_PLANES,
        }
    }

    /// For each leaf, a bit mask of the edges along which other surfaces stand or end a little above (segments across their middles are
    /// blocked); 0 for undivided surfaces.
    pub fn walls_along(&self, exact: &Exact, leaves: &[u32]) -> Vec<u8> {
        let parts = divided(&self.elements, leaves);
        let [low, high] = [INSET, INSET_CLEAR].map(|height| {
            blocked(&self.elements, exact, &parts, |packet, first, corners, side| {
                set_across(packet, first, corners, side, height)
            })
        });
        let edges = low.into_iter().zip(high).map(|(low, high)| low | high);
        let mut walls = parts.iter().copied().zip(edges).peekable();
        let of = |leaf: &u32| walls.next_if(|(part, _)| part == leaf).map_or(0, |(_, edges)| edges as u8);
        leaves.iter().map(of).collect()
    }

    /// The number of parts of surfaces that other surfaces cross or partly cover.
    pub fn count_crossed(&self, exact: &Exact) -> usize {
        crossed(&self.elements, exact, &divided(&self.elements, &self.leaves())).len()
    }
}

/// Area of an element, scene units squared.
fn area(elements: &Elements, e: u32) -> f64 {
    elements.elements[e as usize].area
}

/// Sorts elements, the largest first.
fn sort_by_area(elements: &Elements, found: &mut [u32]) {
    found.sort_by(|&a, &b| area(elements, b).total_cmp(&area(elements, a)).then(a.cmp(&b)));
}

/// Those of some leaves that other surfaces cross (segments along the edges of the leaf are blocked) or partly cover.
fn crossed(elements: &Elements, exact: &Exact, leaves: &[u32]) -> Vec<u32> {
    let [crossed, clear] = [INSET, INSET_CLEAR].map(|inset| {
        blocked(elements, exact, leaves, |packet, first, corners, side| {
            set_edges(packet, first, corners, side, inset, false)
        })
    });
    let covered = covered_quarters(elements, exact, leaves);
    let in_part = |quarters: u32| quarters != 0 && quarters != ALL;
    let edges = crossed.into_iter().zip(clear).map(|(low, high)| low | high);
    let found = leaves.iter().copied().zip(edges.zip(covered));
    found.filter(|(_, (edges, quarters))| *edges != 0 || in_part(*quarters)).map(|(e, _)| e).collect()
}

/// The leaves among these that are parts of surfaces.
fn divided(elements: &Elements, leaves: &[u32]) -> Vec<u32> {
    leaves.iter().filter(|e| elements.elements[**e as usize].level > 0).copied().collect()
}

/// Sets lanes from `first` on to segments above the edges of an element, within it by this fraction of its diameter and as far above it:
/// faces that rise from its edges by up to 135° do not meet them.
fn set_edges(
    packet: &mut Packet,
    first: usize,
    corners: &[Vec3; 4],
    side: &Side,
    inset: f32,
    is_reversed: bool,
) {
    let (count, middle, above) = frame(corners, side, inset);
    let inner = |k: usize| middle + above + (1.0 - 2.0 * inset) * (corners[k % count] - middle);
    for k in 0..count {
        let [from, to] = if is_reversed { [k + 1, k] } else { [k, k + 1] };
        packet.set_between(first + k, inner(from), inner(to), [0.0, 1.0]);
    }
}

/// Sets lanes from `first` on to segments across the middles of the edges of an element, above it by this fraction of twice the smallest
/// distance of an edge from the centre, or by [`INSET`] of that of their edge if that is more. They begin and end twice as far from the
/// edges as those of [`set_edges`] at [`INSET`]: a wall that crosses neither element lies between. At the height [`INSET`], the next face
/// of a bowl counts as a wall from an angle of 27° on.
fn set_across(packet: &mut Packet, first: usize, corners: &[Vec3; 4], side: &Side, height: f32) {
    let (count, middle, _) = frame(corners, side, height);
    let middle_of = |k: usize| 0.5 * (corners[k] + corners[(k + 1) % count]);
    let smallest = (0..count).map(|k| middle_of(k).distance(middle)).fold(f32::INFINITY, f32::min);
    for k in 0..count {
        let edge = middle_of(k);
        let above = (2.0 * INSET * edge.distance(middle)).max(2.0 * height * smallest);
        let above = side.end.height().max(above) * side.normal;
        let inwards = 4.0 * INSET * (middle - edge);
        packet.set_between(first + k, edge + above + inwards, edge + above - inwards, [0.0, 1.0]);
    }
}

/// Sets lanes from `first` on to segments in the rims of an element, above its plane: across each rim at the fraction `along` of its edge.
/// They begin off the edge, where other surfaces stand that do not cross the element.
fn set_rims(packet: &mut Packet, first: usize, corners: &[Vec3; 4], side: &Side, along: f32) {
    let (count, middle, _) = frame(corners, side, 0.0);
    for k in 0..count {
        let edge = corners[k].lerp(corners[(k + 1) % count], along);
        let within = |part: f32| side.end.lifted(edge + 2.0 * INSET * part * (middle - edge), side.normal);
        packet.set_between(first + k, within(RIM_START), within(1.0), [0.0, 1.0]);
    }
}

/// The number of corners of an element, their mean, and the offset of segments from its plane for this fraction of its diameter.
fn frame(corners: &[Vec3; 4], side: &Side, part: f32) -> (usize, Vec3, Vec3) {
    let count = if corners[2] == corners[3] { 3 } else { 4 };
    let middle = centroid(corners);
    let diameter = 2.0 * corners.iter().map(|c| (*c - middle).length()).fold(0.0, f32::max);
    (count, middle, side.end.height().max(part * diameter) * side.normal)
}

// Elements in gaps narrower than themselves, as inside a hollow door or between two cupboards.
//
// Light decays along a gap within a few times its width. A larger element emits its mean light from all of its points, so that light would
// reach deeper into the gap in proportion to the element's size: three times too much in a hollow panel of 3 cm with elements of 12 cm.
// These elements do not exchange light, and paths that hit them continue from the hit point.

/// Width of a gap that counts as narrow, as a fraction of the radius of the element. Over an endless gap of width w, the fraction (w /
/// r)² of diffuse light travels farther than r: half of it.
const MAX_NARROW_GAP: f32 = std::f32::consts::FRAC_1_SQRT_2;
/// The bits of all quarters.
pub const ALL: u32 = 0xf;
/// Elements of one parallel task: each has up to four segments of a packet.
const CHUNK: usize = LANES / 4;

impl LinkedScene {
    /// Marks the leaves that have another surface right above all of their quarters
    /// ([`ElementState::narrow`](crate::radiosity::elements::ElementState::narrow)).
    pub fn mark_gaps(&mut self, exact: &Exact) {
        let leaves = self.leaves();
        let covered = covered_quarters(&self.elements, exact, &leaves);
        self.elements.states.iter_mut().for_each(|state| state.narrow = false);
        for (leaf, _) in leaves.into_iter().zip(covered).filter(|(_, quarters)| *quarters == ALL) {
            self.elements.states[leaf as usize].narrow = true;
        }
    }

    /// Sets the [rims](crate::radiosity::elements::ElementState::rim) of leaves that a surface crosses so near to an edge that they are not
    /// cut there.
    pub fn mark_rims(&mut self, exact: &Exact) {
        let leaves = divided(&self.elements, &self.leaves());
        let [first, second] = RIM_PLACES.map(|along| {
            blocked(&self.elements, exact, &leaves, |packet, first, corners, side| {
                set_rims(packet, first, corners, side, along)
            })
        });
        let Elements { elements, states, .. } = &mut self.elements;
        states.iter_mut().for_each(|state| state.rim = 0.0);
        let edges = first.into_iter().zip(second).map(|(first, second)| first | second);
        for (leaf, _) in leaves.into_iter().zip(edges).filter(|(_, edges)| *edges != 0) {
            if let Shape::Surface { corners, .. } = &elements[leaf as usize].shape {
                states[leaf as usize].rim = 2.0 * INSET * inner_radius(corners);
            }
        }
    }
}

/// For each leaf, a bit mask of the quarters that have another surface right above their centres.
pub fn covered_quarters(elements: &Elements, exact: &Exact, leaves: &[u32]) -> Vec<u32> {
    blocked(elements, exact, leaves, |packet, first, corners, side| {
        let radius = 0.5 * Aabb::of(*corners).diagonal();
        for (k, at) in centres_of_quarters(corners).into_iter().enumerate() {
            let from = side.end.lifted(at, side.normal);
            packet.set_between(first + k, from, from + MAX_NARROW_GAP * radius * side.normal, [0.0, 1.0]);
        }
    })
}

/// For each leaf, a bit mask of the blocked segments; `set` writes up to four segments into a packet, from a given lane on.
pub fn blocked(
    elements: &Elements,
    exact: &Exact,
    leaves: &[u32],
    set: impl Fn(&mut Packet, usize, &[Vec3; 4], &Side) + Sync,
) -> Vec<u32> {
    let of_chunk = |leaves: &[u32]| {
        let mut blocked = [0];
        exact.occluded(&[packet(elements, leaves, &set)], &mut blocked);
        (0..leaves.len()).map(move |k| blocked[0] >> (4 * k) & ALL)
    };
    parallel::flat_map(parallel::at_least(256, parallel::chunks(leaves, CHUNK)), of_chunk)
}

/// For each leaf, the first triangle that each of its segments hits.
fn first_hits(
    elements: &Elements,
    exact: &Exact,
    leaves: &[u32],
    set: impl Fn(&mut Packet, usize, &[Vec3; 4], &Side) + Sync,
) -> Vec<[u32; 4]> {
    let of_chunk = |leaves: &[u32]| {
        let mut hits = [Hits::NONE];
        exact.scene.first_hits(exact.traversal, &[packet(elements, leaves, &set)], &mut hits);
        (0..leaves.len()).map(move |k| std::array::from_fn(|lane| hits[0].triangle[4 * k + lane]))
    };
    parallel::flat_map(parallel::at_least(256, parallel::chunks(leaves, CHUNK)), of_chunk)
}

/// The segments of up to [`CHUNK`] leaves.
fn packet(
    elements: &Elements,
    leaves: &[u32],
    set: &impl Fn(&mut Packet, usize, &[Vec3; 4], &Side),
) -> Packet {
    let mut packet = Packet::EMPTY;
    for (k, &e) in leaves.iter().enumerate() {
        let Shape::Surface { side, corners } = elements.elements[e as usize].shape else { continue };
        set(&mut packet, 4 * k, &corners, &elements.sides[side as usize]);
    }
    packet
}
