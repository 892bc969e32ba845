//! Neighbours of an element: the nearest elements of about the same plane and orientation.

use crate::math::Aabb;
use crate::math::parallel;
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::Exact;
use glam::Vec3;
use rustc_hash::FxHashMap;
use smallvec::SmallVec;

/// Smallest cosine between the normals of neighbours, that of 45 degrees: a fit accounts for their normals. The error of the elements of
/// a valley is 4.1 % with 0.95 and 3.6 % with 0.7, that of a living room 7.1 to 7.8 % with either (`scenes/room.py`).
const MIN_COSINE: f32 = 0.7;
/// Largest height of a neighbour over the plane of an element: on an arc it is the distance times the sine of half the angle between
/// the normals; facets of an arc can have twice that.
const MAX_BEND: f32 = 2.0;
/// Additional height that is allowed, in radii of the element: planes with a step that is small against the elements. Sheets farther
/// apart than that share no light, because one may be lit and the other not.
const MAX_STEP: f32 = 0.05;
/// Largest distance of a neighbour in radii of the element. In a regular grid 48 neighbours lie within five radii.
const MAX_RADII: f32 = 6.0;

/// An element as an entry of the neighbour search.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// Centre.
    pub centre: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Radius, scene units.
    pub radius: f32,
    /// The side of a surface that it lies on.
    pub side: u32,
    /// Free height above the centre, scene units.
    pub free: f32,
}

impl Place {
    /// Whether another element, `offset` away, lies on a continuation of this one's surface.
    fn continues_at(&self, other: &Place, offset: Vec3) -> bool {
        let cosine = self.normal.dot(other.normal);
        let half_angle = (0.5 * (1.0 - cosine)).max(0.0).sqrt();
        let height = self.normal.dot(offset).abs();
        cosine >= MIN_COSINE && height <= MAX_BEND * half_angle * offset.length() + MAX_STEP * self.radius
    }

    /// A segment to another element that clears the surface between them, if this bends evenly or at one edge, and stays below surfaces
    /// above either: an edge between two planes is at most d/2 tan(θ/2) above the line between points at the distance d with the angle θ
    /// between their normals.
    fn segment_to(&self, other: &Place) -> [Vec3; 2] {
        let cosine = self.normal.dot(other.normal);
        let bend = 0.5 * ((1.0 - cosine) / (1.0 + cosine)).max(0.0).sqrt();
        let height = MAX_STEP * self.radius + bend * (other.centre - self.centre).length();
        [self, other].map(|place| place.centre + height.min(0.5 * place.free) * place.normal)
    }

    /// Whether the line to the centre of another element crosses an edge, as seen along the normal.
    fn is_parted_by(&self, [a, b]: [Vec3; 2], other: &Place) -> bool {
        let turn = |p: Vec3, q: Vec3, r: Vec3| (q - p).cross(r - p).dot(self.normal);
        let (from, to) = (self.centre, other.centre);
        turn(a, b, from) * turn(a, b, to) < 0.0 && turn(from, to, a) * turn(from, to, b) <= 0.0
    }
}

/// Edges along which other surfaces stand, by the number of their element; none for most elements.
pub type Walls = FxHashMap<u32, Vec<[Vec3; 2]>>;

/// Data that decide whether two neighbours receive light from the same room.
#[derive(Default)]
pub struct Sight {
    /// Edges along which other surfaces stand on one side of a surface.
    pub walls: Walls,
    /// The surfaces of the scene; none in tests of elements alone.
    pub blockers: Option<Exact>,
}

impl Sight {
    /// Writes those of the neighbours `found`, with their squared distances, to `kept` that are visible from an element: none behind a
    /// wall at any of them, and none on another side that another surface hides. The inside of a board is close to its outside.
    pub fn visible(&self, places: &[Place], of: u32, found: &[(f32, u32)], kept: &mut Vec<(f32, u32)>) {
        let own = &places[of as usize];
        let edges: SmallVec<[[Vec3; 2]; 8]> =
            found.iter().filter_map(|(_, i)| self.walls.get(i)).flatten().copied().collect();
        let is_parted = |i: u32| edges.iter().any(|edge| own.is_parted_by(*edge, &places[i as usize]));
        kept.clear();
        kept.extend(found.iter().filter(|(_, i)| *i == of || !is_parted(*i)));
        let Some(blockers) = &self.blockers else { return };
        let (mut packet, mut lanes, mut used) = (Packet::EMPTY, [0usize; LANES], 0);
        for k in 0..kept.len() {
            let other = &places[kept[k].1 as usize];
            if other.side != own.side {
                let [from, to] = own.segment_to(other);
                packet.set_between(used, from, to, [0.0, 1.0]);
                lanes[used] = k;
                used += 1;
            }
            if used == LANES || k + 1 == kept.len() && used > 0 {
                let mut blocked = [0];
                blockers.occluded(std::slice::from_ref(&packet), &mut blocked);
                let hidden = lanes[..used].iter().enumerate().filter(|(lane, _)| blocked[0] >> lane & 1 != 0);
                hidden.for_each(|(_, &k)| kept[k].0 = f32::INFINITY);
                (packet, used) = (Packet::EMPTY, 0);
            }
        }
        kept.retain(|(distance, _)| distance.is_finite());
    }
}

/// Buffers of a search: places found, and nodes still to be searched, both with squared distances.
#[derive(Default)]
pub struct Search {
    found: Vec<(f32, u32)>,
    stack: Vec<(f32, u32)>,
}

/// Largest number of places in a node without children: few compared with the 49 neighbours of a search.
const LEAF_PLACES: usize = 8;

/// A node of a tree over places, which halves them along the longest extent of their centres. Its first child is the next node.
struct PlaceNode {
    /// Bounds of the centres.
    bounds: Aabb,
    /// The second child, counted from this node; 0 for a leaf.
    second: u32,
    /// The places of a leaf.
    range: [u32; 2],
}

/// Builds the nodes over `members`, the first of which is number `first` of all, and orders the members by leaf.
fn nodes_over(places: &[Place], members: &mut [u32], first: u32) -> Vec<PlaceNode> {
    let centre = |i: u32| places[i as usize].centre;
    let bounds = Aabb::of(members.iter().map(|&i| centre(i)));
    if members.len() <= LEAF_PLACES {
        return vec![PlaceNode { bounds, second: 0, range: [first, first + members.len() as u32] }];
    }
    let axis = bounds.extent().max_position();
    let half = members.len() / 2;
    let order = |a: &u32, b: &u32| centre(*a)[axis].total_cmp(&centre(*b)[axis]).then(a.cmp(b));
    members.select_nth_unstable_by(half, order);
    let (low, high) = members.split_at_mut(half);
    let (low, high) =
        parallel::join(|| nodes_over(places, low, first), || nodes_over(places, high, first + half as u32));
    let mut nodes = Vec::with_capacity(1 + low.len() + high.len());
    nodes.push(PlaceNode { bounds, second: 1 + low.len() as u32, range: [0; 2] });
    nodes.extend(low);
    nodes.extend(high);
    nodes
}

/// Elements by the axis that is nearest to their normals, each group with a tree over their centres.
pub struct Neighbourhood<'a> {
    places: &'a [Place],
    groups: Vec<Group>,
}

#[derive(Default)]
struct Group {
    /// Its places by number, in the order of the leaves of the tree, and copies of them in that order.
    members: Vec<u32>,
    arranged: Vec<Place>,
    nodes: Vec<PlaceNode>,
}

impl<'a> Neighbourhood<'a> {
    /// Builds the trees. `None` if `late` returned true before all were begun: a tree of a million elements takes .1 s.
    pub fn new(places: &'a [Place], late: impl Fn() -> bool + Sync) -> Option<Neighbourhood<'a>> {
        let group = |k: usize| {
            if late() {
                return Group::default();
            }
            let mut members: Vec<u32> =
                (0..places.len() as u32).filter(|&i| axis(places[i as usize].normal) == k).collect();
            let nodes = nodes_over(places, &mut members, 0);
            let arranged = members.iter().map(|&i| places[i as usize]).collect();
            Group { members, arranged, nodes }
        };
        let groups = parallel::map(0..6usize, group);
        (!late()).then_some(Neighbourhood { places, groups })
    }

    /// Marks all places in each run of `count` places of a tree, which lie together, if one of the run is marked.
    pub fn spread(&self, marked: &mut [bool], count: usize) {
        for run in self.groups.iter().flat_map(|group| group.members.chunks(count)) {
            if run.iter().any(|&i| marked[i as usize]) {
                run.iter().for_each(|&i| marked[i as usize] = true);
            }
        }
    }

    /// The nearest `count` neighbours of an element with their squared distances, nearest first; the first one is itself.
    pub fn nearest<'s>(&self, of: u32, count: usize, search: &'s mut Search) -> &'s [(f32, u32)] {
        let Search { found, stack } = search;
        let own = self.places[of as usize];
        found.clear();
        stack.clear();
        let Group { members, arranged, nodes } = &self.groups[axis(own.normal)];
        let limit = (MAX_RADII * own.radius).powi(2);
        if !nodes.is_empty() {
            stack.push((0.0, 0));
        }
        let farthest = |found: &Vec<(f32, u32)>| if found.len() < count { limit } else { found[count - 1].0 };
        while let Some((distance, at)) = stack.pop() {
            if distance > farthest(found) {
                continue;
            }
            let node = &nodes[at as usize];
            if node.second == 0 {
                let range = node.range[0] as usize..node.range[1] as usize;
                for (place, &i) in arranged[range.clone()].iter().zip(&members[range]) {
                    let offset = place.centre - own.centre;
                    let d2 = offset.length_squared();
                    let entry = (d2, if i == of { 0 } else { i + 1 });
                    let later = |other: &(f32, u32)| (other.0, other.1) > entry;
                    let is_nearer =
                        d2 <= farthest(found) && (found.len() < count || later(&found[count - 1]));
                    if !is_nearer || !own.continues_at(place, offset) {
                        continue;
                    }
                    let place = found.partition_point(|other| !later(other));
                    found.insert(place, entry);
                    found.truncate(count);
                }
                continue;
            }
            let first = stack.len();
            for child in [at + 1, at + node.second] {
                let bounds = &nodes[child as usize].bounds;
                let d2 = (own.centre.clamp(bounds.min, bounds.max) - own.centre).length_squared();
                if d2 <= farthest(found) {
                    stack.push((d2, child));
                }
            }
            // The nearest child is searched first.
            stack[first..].sort_by(|a, b| b.0.total_cmp(&a.0));
        }
        for entry in found.iter_mut() {
            entry.1 = if entry.1 == 0 { of } else { entry.1 - 1 };
        }
        found
    }
}

/// The signed axis nearest to a vector.
pub(super) fn axis(normal: Vec3) -> usize {
    let k = normal.abs().max_position();
    2 * k + usize::from(normal[k] < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PrepareOptions;
    use crate::math::sampling::numbers;
    use crate::model::Model;
    use crate::scene::testing::{Pieces, facing_down, facing_up};
    use glam::DVec3;

    /// A sheet above another one does not share its light, however far away; the facets of a cylinder do.
    #[test]
    fn sheets_are_told_from_bends() {
        let place = |centre, normal: Vec3| Place {
            centre,
            normal: normal.normalize(),
            radius: 1.0,
            side: 0,
            free: 1.0,
        };
        let own = place(Vec3::ZERO, Vec3::Z);
        let continues = |other: Place| own.continues_at(&other, other.centre);
        assert!(continues(place(Vec3::new(5.0, 0.0, 0.04), Vec3::Z)));
        assert!(!continues(place(Vec3::new(5.0, 0.0, 0.2), Vec3::Z)));
        let on_cylinder = |angle: f32| {
            let (sin, cos) = angle.sin_cos();
            place(10.0 * Vec3::new(sin, 0.0, cos - 1.0), Vec3::new(sin, 0.0, cos))
        };
        assert!(continues(on_cylinder(0.1)) && continues(on_cylinder(0.3)));
        assert!(!continues(on_cylinder(0.9)));
    }

    /// Of elements beside a sheet that stands between two boards, those on the board behind it are hidden; those around a convex edge are
    /// not.
    #[test]
    fn neighbours_behind_a_sheet_are_hidden() {
        let mut pieces = Pieces::empty();
        pieces.grey("boards", 0.5);
        pieces.polygon(&facing_up([-2.0, 0.0], [-1.0, 1.0], 0.0)).polygon(&facing_up(
            [0.0, 2.0],
            [-1.0, 1.0],
            0.0,
        ));
        pieces.rectangle(DVec3::new(2.0, -1.0, 0.0), 2.0 * DVec3::Y, DVec3::new(1.0, 0.0, -0.7));
        pieces.rectangle(DVec3::new(0.0, -1.0, 0.0), 2.0 * DVec3::Y, 0.5 * DVec3::Z);
        // A sheet above the first board, lower than segments would be raised.
        pieces.polygon(&facing_down([-2.0, 0.0], [-1.0, 1.0], 0.004));
        let model = Model::prepare(pieces.scene(), &PrepareOptions::default()).expect("a model");
        let sight = Sight { walls: Walls::default(), blockers: Some(model.exact()) };
        let place = |x: f32, z: f32, normal: Vec3, side: u32, free: f32| {
            let (centre, normal) = (Vec3::new(x, 0.0, z), normal.normalize());
            Place { centre, normal, radius: 0.2, side, free }
        };
        let places = [
            place(-0.3, 0.0, Vec3::Z, 0, 0.004),
            place(0.3, 0.0, Vec3::Z, 1, 1.0),
            place(1.8, 0.0, Vec3::Z, 2, 1.0),
            place(2.2, -0.14, Vec3::new(0.7, 0.0, 1.0), 3, 1.0),
        ];
        let all: Vec<(f32, u32)> = (0..4).map(|i| (0.0, i)).collect();
        let seen = |of: u32| {
            let mut kept = Vec::new();
            sight.visible(&places, of, &all, &mut kept);
            kept.into_iter().map(|(_, i)| i).collect::<Vec<u32>>()
        };
        assert_eq!([0, 1, 3].map(seen), [vec![0], vec![1, 2, 3], vec![1, 2, 3]]);
    }

    /// The nearest elements of random places, against a search through all of them.
    #[test]
    fn nearest_places_are_those_of_an_exhaustive_search() {
        let places: Vec<Place> = (0..2000u64)
            .map(|k| {
                let [x, y, z, w] = numbers(9, k);
                let normal = Vec3::new(0.2 * (w - 0.5), 0.1 * (x - 0.5), if k % 3 == 0 { -1.0 } else { 1.0 });
                Place {
                    centre: Vec3::new(x, y, 0.02 * z),
                    normal: normal.normalize(),
                    radius: 0.02,
                    side: 0,
                    free: 1.0,
                }
            })
            .collect();
        let around = Neighbourhood::new(&places, || false).expect("there is time");
        assert!(Neighbourhood::new(&places, || true).is_none());
        let mut search = Search::default();
        let mut many = 0;
        for of in 0..places.len() as u32 {
            let own = &places[of as usize];
            let mut all: Vec<(f32, u32)> = (0..places.len() as u32)
                .filter(|&i| {
                    let (place, offset) = (&places[i as usize], places[i as usize].centre - own.centre);
                    axis(place.normal) == axis(own.normal)
                        && own.continues_at(place, offset)
                        && offset.length() <= MAX_RADII * own.radius
                })
                .map(|i| {
                    (
                        (places[i as usize].centre - own.centre).length_squared(),
                        if i == of { 0 } else { i + 1 },
                    )
                })
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            all.truncate(25);
            let want: Vec<u32> = all.iter().map(|a| if a.1 == 0 { of } else { a.1 - 1 }).collect();
            let found: Vec<u32> = around.nearest(of, 25, &mut search).iter().map(|f| f.1).collect();
            assert_eq!(found[0], of);
            assert_eq!(found, want);
            many += usize::from(found.len() > 9);
        }
        assert!(many > 500, "{many}");
    }
}
