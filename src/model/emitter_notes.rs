//! Notes from rays of the emitters: emitters whose front faces away from all surfaces, most often because the corners of their faces are
//! in the wrong order or a luminaire is aimed wrongly, or whose light ends on the outside of a space.

use super::Model;
use crate::embree::Hits;
use crate::error::quote;
use crate::math::parallel;
use crate::math::sampling::{cosine_direction, mix, numbers, on_triangle};
use crate::math::{Aabb, triangle_normal};
use crate::ray::{LANES, Packet};
use crate::scene::Emitter;
use glam::Vec3;

/// Largest number of emitters that are tested, evenly spread: limits the time to 0.5 million rays, some 0.1 s.
const MAX_TESTED: usize = 4096;
/// Packets of rays from each side of an emitter: 64 rays all miss what covers a tenth of the hemisphere with a probability of
/// 0.9⁶⁴ = 0.1 %. What covers less is found by [`MAX_COMPARED_FACES`].
pub(super) const PACKETS: usize = 4;
/// Largest number of faces, evenly spread, whose centres are compared with the plane of an emitter: limits the time to that of
/// as many products of vectors.
const MAX_COMPARED_FACES: usize = 4096;
/// Largest number of names that a note lists: it stays a sentence.
const MAX_NAMES: usize = 3;
/// Fraction of an emitter's rays that must meet surfaces for a note that it lies outside of a space: some rays pass beside a ceiling.
const MIN_MET_SHARE: f64 = 0.5;
/// Fraction of the rays that meet surfaces that must meet the outside of one: some rays from below a ceiling leave through windows.
const MIN_OUTSIDE_SHARE: f64 = 0.8;

/// Advice if the light of luminaires, or of emissive faces, meets no surface.
const AIM: &str = "check `at` and `aim` of its luminaire in the file of luminaires (of glTF, place and turn of the light's node)";
const TURN: &str =
    "set ⟨LoadOptions::two_sided_emission⟩, or reverse the order of the corners of their faces";

impl Model {
    /// Notes of emitters that are turned, or outside of a space.
    #[doc(hidden)]
    pub fn notes_of_lost_light(&self) -> Vec<String> {
        let mut notes = self.notes_of_turned_emitters();
        notes.extend(self.note_of_outside_emitters());
        notes.extend(self.note_of_dome());
        notes.extend(self.note_of_enclosed_emitters());
        notes
    }

    /// Notes of coordinates that are too coarse.
    #[doc(hidden)]
    pub fn notes_of_coarseness(&self) -> Vec<String> {
        let coarse = self.note_of_coarse_coordinates().into_iter().chain(self.note_of_small_things());
        coarse.chain(self.note_of_rounded_emitters()).collect()
    }

    /// A note if the light of emitters ends on the outside of a space, as that of luminaires above a ceiling does.
    fn note_of_outside_emitters(&self) -> Option<String> {
        let outside = |emitter| self.outside_of_space(emitter).map(|found| (emitter, found));
        let found: Vec<(&Emitter, (u32, f32))> =
            parallel::flat_map(&self.tested_emitters(), |emitter| outside(*emitter));
        let &(first, (triangle, distance)) = found.first()?;
        let scene = self.scene();
        let object =
            scene.object_names().nth(scene.triangle_object[triangle as usize] as usize).unwrap_or_default();
        let more =
            if found.len() > 1 { format!(" (and of {} more)", found.len() - 1) } else { String::new() };
        Some(format!(
            "the light of the emitter `{}`{more} is blocked by `{}`, {distance:.2} {} in front of it, and leaves the scene from there: the \
             emitter is probably behind that surface by mistake, such as a luminaire above a ceiling; move it to the other side",
            quote(&first.name),
            quote(object),
            scene.unit
        ))
    }

    /// The surface nearest to an emitter, and its distance in scene units, if the surfaces that its light meets see nothing on that side
    /// but other surfaces on their other side. Under a sky surfaces have light on either side.
    fn outside_of_space(&self, emitter: &Emitter) -> Option<(u32, f32)> {
        if self.scene().environment.is_some() || self.meets_others(emitter, -1.0) {
            return None;
        }
        let (packets, hits) = self.rays_of_emitter(emitter, 1.0);
        let is_other = |triangle: u32| emitter.triangles.binary_search(&triangle).is_err();
        let (mut met, mut outside, mut nearest) = (0.0, 0.0, None::<(u32, f32)>);
        for (k, (packet, hits)) in packets.iter().zip(&hits).enumerate() {
            // The first instance holds the scene's own faces.
            let own = |lane: &usize| hits.triangle[*lane] != Hits::NO_HIT && hits.instance[*lane] == 0;
            for lane in (0..LANES).filter(own).filter(|&lane| is_other(hits.triangle[lane])) {
                let (triangle, at) = (hits.triangle[lane], packet.point(lane, hits.t[lane]));
                let way = at - packet.point(lane, 0.0);
                let normal = triangle_normal_towards(self.scene().corners(triangle), -way);
                let [here, beyond] = self.sides_meet(at, normal, triangle, (k * LANES + lane) as u64);
                met += 1.0;
                outside += f64::from(u8::from(!here.is_some_and(is_other) && beyond.is_some()));
                if nearest.is_none_or(|(_, distance)| way.length() < distance) {
                    nearest = Some((triangle, way.length()));
                }
            }
        }
        let enough = met >= MIN_MET_SHARE * (PACKETS * LANES) as f64 && outside >= MIN_OUTSIDE_SHARE * met;
        nearest.filter(|_| enough)
    }

    /// Triangles that a cosine-weighted ray from a point of a face hits, on the side of this normal and on the other side.
    fn sides_meet(&self, at: Vec3, normal: Vec3, triangle: u32, number: u64) -> [Option<u32>; 2] {
        let length = 1.01 * self.bounds().diagonal();
        let [u, v, ..] = numbers(mix(u64::from(triangle)), number);
        let mut packet = Packet::EMPTY;
        for (lane, side) in [normal, -normal].into_iter().enumerate() {
            let from = self.end_on(0, triangle).lifted(at, side);
            packet.set_between(lane, from, from + length * cosine_direction(side, u, v), [0.0, 1.0]);
        }
        let mut hits = [Hits::NONE];
        self.traced().first_hits(self.widest_packets(), &[packet], &mut hits);
        [0, 1].map(|lane| Some(hits[0].triangle[lane]).filter(|&t| t != Hits::NO_HIT))
    }

    /// Emitters that are tested: all, or at most [`MAX_TESTED`] evenly spread ones.
    pub(super) fn tested_emitters(&self) -> Vec<&Emitter> {
        let emitters = &self.scene().emitters;
        emitters.iter().step_by(emitters.len().div_ceil(MAX_TESTED).max(1)).collect()
    }

    /// Reason why no surface receives light, with advice.
    #[doc(hidden)]
    pub fn cause_of_darkness(&self) -> String {
        let emitters = &self.scene().emitters;
        let lamps = emitters.iter().filter(|emitter| self.is_luminaire(emitter)).count();
        let mut causes = Vec::new();
        if emitters.is_empty() {
            causes.push("the sky and the sun have no light (place and time give a sun light only together with a sky such as clear:3 or its irradiance), or all surfaces face away from them".to_owned());
        }
        if lamps < emitters.len() {
            causes.push(format!("the emitters face away from everything; {TURN}"));
        }
        if lamps > 0 {
            causes.push(format!("the light of each luminaire leaves the scene; {AIM}"));
        }
        causes.join("; ")
    }

    /// Whether an emitter has a distribution of directions, of a photometric file or a light of glTF.
    fn is_luminaire(&self, emitter: &Emitter) -> bool {
        let scene = self.scene();
        scene.materials[scene.triangle_material[emitter.triangles[0] as usize] as usize].profile.is_some()
    }

    /// Notes if emissive faces, or luminaires, send all their light out of the scene although there are surfaces behind them.
    pub(crate) fn notes_of_turned_emitters(&self) -> Vec<String> {
        let tested = self.tested_emitters();
        let turned: Vec<&Emitter> = parallel::flat_map(&tested, |e| self.is_turned(e).then_some(*e));
        let (lamps, faces): (Vec<&Emitter>, Vec<&Emitter>) =
            turned.into_iter().partition(|emitter| self.is_luminaire(emitter));
        let note = |(turned, why, cure): (Vec<&Emitter>, [&str; 2], &str)| {
            let names: Vec<String> =
                turned.iter().take(MAX_NAMES).map(|e| format!("`{}`", quote(&e.name))).collect();
            let more = if turned.len() > MAX_NAMES { ", ..." } else { "" };
            let (count, of, names) = (turned.len(), tested.len(), names.join(", "));
            let why = why[usize::from(count > 1)];
            let which = if of == 1 { "the only emitter".into() } else { format!("{count} of {of} emitters") };
            (count > 0)
                .then(|| format!("the light of {which} leaves the scene, as {why}: {names}{more}; {cure}"))
        };
        let of_faces =
            (faces, ["its front faces away from everything", "their fronts face away from everything"], TURN);
        let of_lamps = (lamps, ["it shines away from everything", "they shine away from everything"], AIM);
        [of_faces, of_lamps].into_iter().filter_map(note).collect()
    }

    /// Whether nothing is in front of an emitter that emits from its front alone, and something is behind it.
    fn is_turned(&self, emitter: &Emitter) -> bool {
        let one_sided = !self.scene().two_sided_emission || self.is_luminaire(emitter);
        one_sided
            && !self.meets_others(emitter, 1.0)
            && self.meets_others(emitter, -1.0)
            && !self.has_others_in_front(emitter)
    }

    /// Whether rays from one side of an emitter (1 front, −1 back) meet other surfaces.
    fn meets_others(&self, emitter: &Emitter, side: f32) -> bool {
        let (_, hits) = self.rays_of_emitter(emitter, side);
        let other = |hits: &Hits, lane: usize| match hits.triangle[lane] {
            Hits::NO_HIT => false,
            // The first instance holds the scene's own faces.
            t => hits.instance[lane] != 0 || emitter.triangles.binary_search(&t).is_err(),
        };
        hits.iter().any(|hits| (0..LANES).any(|lane| other(hits, lane)))
    }

    /// Cosine-weighted rays from one side of an emitter (1 front, −1 back), and their hits.
    pub(super) fn rays_of_emitter(
        &self,
        emitter: &Emitter,
        side: f32,
    ) -> ([Packet; PACKETS], [Hits; PACKETS]) {
        let scene = self.scene();
        let length = 1.01 * self.bounds().diagonal();
        let seed = mix(u64::from(emitter.triangles[0]));
        let mut packets = [Packet::EMPTY; PACKETS];
        for i in 0..PACKETS * LANES {
            let face = emitter.triangles[i * emitter.triangles.len() / (PACKETS * LANES)];
            let [a, b, c] = scene.corners(face);
            let normal = side * triangle_normal(a, b, c);
            let [u, v, p, q] = numbers(seed, i as u64);
            let from = self.end_on(0, face).lifted(on_triangle([a, b, c], u, v), normal);
            let to = from + length * cosine_direction(normal, p, q);
            packets[i / LANES].set_between(i % LANES, from, to, [0.0, 1.0]);
        }
        let mut hits = [Hits::NONE; PACKETS];
        self.traced().first_hits(self.widest_packets(), &packets, &mut hits);
        (packets, hits)
    }

    /// Whether the centre of another face lies in front of the emitter's first face, however small it looks from there.
    fn has_others_in_front(&self, emitter: &Emitter) -> bool {
        let scene = self.scene();
        let [a, b, c] = scene.corners(emitter.triangles[0]);
        let (normal, slack) = (triangle_normal(a, b, c), self.end_rule().height());
        let step = scene.triangles.len().div_ceil(MAX_COMPARED_FACES).max(1);
        (0..scene.triangles.len() as u32).step_by(step).any(|t| {
            let centre = scene.corners(t).iter().sum::<Vec3>() / 3.0;
            normal.dot(centre - a) > slack && emitter.triangles.binary_search(&t).is_err()
        })
    }
}

/// The unit normal of a face on the side that a vector points to.
fn triangle_normal_towards([a, b, c]: [Vec3; 3], towards: Vec3) -> Vec3 {
    let normal = triangle_normal(a, b, c);
    if normal.dot(towards) < 0.0 { -normal } else { normal }
}

// Notes of emitters that an object encloses, and of those that enclose all else.

/// Distance by which surfaces may lie outside the bounds of a dome, relative to their diagonal. Ground at the foot of a dome extends a
/// little beyond it; an emitter that is smaller than the other surfaces by more does not enclose them.
const DOME_MARGIN: f32 = 0.01;

/// Distance up to which an object encloses an emitter as a bulb does, relative to the scene's diagonal: 20 cm in a building of 10 m.
/// The walls of a room are farther from its lamps.
const ENCLOSURE_DISTANCE: f32 = 0.02;

impl Model {
    /// A note if all light of emitters ends on one small object around them, as that of a lamp inside of an opaque bulb does.
    pub(super) fn note_of_enclosed_emitters(&self) -> Option<String> {
        let scene = self.scene();
        let small = ENCLOSURE_DISTANCE * self.bounds().diagonal();
        let enclosed = |emitter: &&Emitter| {
            let (packets, hits) = self.rays_of_emitter(emitter, 1.0);
            let mut around = None;
            for (packet, hits) in packets.iter().zip(&hits) {
                for lane in 0..LANES {
                    let triangle = hits.triangle[lane];
                    let way = hits.t[lane] * (packet.point(lane, 1.0) - packet.point(lane, 0.0)).length();
                    if triangle == Hits::NO_HIT || hits.instance[lane] != 0 || way > small {
                        return None;
                    }
                    let object = scene.triangle_object[triangle as usize];
                    if emitter.triangles.binary_search(&triangle).is_ok()
                        || *around.get_or_insert(object) != object
                    {
                        return None;
                    }
                }
            }
            around
        };
        let found = |emitter| enclosed(&emitter).map(|around| (emitter, around));
        let found: Vec<(&Emitter, u32)> =
            parallel::flat_map(&self.tested_emitters(), |emitter| found(*emitter));
        if found.is_empty() {
            return None;
        }
        let mut bounds = vec![Aabb::EMPTY; scene.objects.len()];
        for (t, &object) in (0..).zip(&scene.triangle_object) {
            let own = &mut bounds[object as usize];
            *own = own.union(Aabb::of(scene.corners(t)));
        }
        // A floor below a lamp is larger than what is that near all around it, and so is one below a luminous ceiling.
        let is_around = |&&(emitter, around): &&(&Emitter, u32)| {
            let lamp = Aabb::of(emitter.triangles.iter().flat_map(|&t| scene.corners(t)));
            lamp.diagonal() <= 2.0 * small
                && bounds[around as usize].diagonal() <= lamp.diagonal() + 2.0 * small
        };
        let found: Vec<&(&Emitter, u32)> = found.iter().filter(is_around).collect();
        let &&(first, around) = found.first()?;
        let object = scene.object_names().nth(around as usize).unwrap_or_default();
        let more = if found.len() > 1 { format!(" (and {} more)", found.len() - 1) } else { String::new() };
        Some(format!(
            "all of {} rays from the emitter `{}`{more} end on `{}`, which is opaque and around it: little or none of its light gets \
             out; if that is not intended, remove that object, make it transparent, or move the emitter",
            PACKETS * LANES,
            quote(&first.name),
            quote(object)
        ))
    }

    /// A note if an emitter stands around all else under a sky: a dome of faces that stood for a sky before, which hides it.
    pub(super) fn note_of_dome(&self) -> Option<String> {
        let scene = self.scene();
        scene.environment.as_ref()?;
        let bounds = |triangles: &[u32]| Aabb::of(triangles.iter().flat_map(|&t| scene.corners(t)));
        let mut emits = vec![false; scene.triangles.len()];
        scene.emitters.iter().flat_map(|e| &e.triangles).for_each(|&t| emits[t as usize] = true);
        let others: Vec<u32> = (0..emits.len() as u32).filter(|&t| !emits[t as usize]).collect();
        let others = bounds(&others);
        let margin = Vec3::splat(DOME_MARGIN * others.diagonal());
        let encloses = |emitter: &&&Emitter| {
            let Aabb { min, max } = bounds(&emitter.triangles);
            min.cmple(others.min + margin).all() && max.cmpge(others.max - margin).all()
        };
        let flat = others.extent().min_element() <= margin.x;
        let dome = self.tested_emitters();
        let dome = dome.iter().filter(|_| !flat).find(encloses)?;
        Some(format!(
            "the emitter `{}` encloses all other surfaces, as a dome that stands for a sky does: the light of the sky and the sun ends on its \
             outside; remove it, or do without `sky` and `sun`",
            quote(&dome.name)
        ))
    }
}

#[cfg(test)]
mod tests {
    use crate::model::{Detail, Model, testing::model};
    use crate::scene::testing::{Pieces, facing_down, facing_up};
    use crate::scene::{LoadOptions, UpAxis};
    use crate::sky::SkyOptions;
    use glam::DVec3;

    /// The note about lamps (height, whether it faces up) above a floor.
    fn note(lamps: &[(f64, bool)], options: &LoadOptions) -> Option<String> {
        with_lamps(4.0, lamps, options).notes_of_turned_emitters().pop()
    }

    /// Lamps above or below the ceiling of a cellar, 3 deep and open at its sides.
    fn with_cellar(lamps: &[(f64, bool)]) -> Model {
        scene_of(10.0, lamps, &LoadOptions::default(), Some(-3.0))
    }

    #[test]
    fn domes_under_a_sky_get_a_note() {
        let noted = |size: f64, has_sky: bool| {
            let mut pieces = Pieces::empty();
            pieces.grey("house", 0.5).room(DVec3::new(2.0, 2.0, 3.0), DVec3::new(1.0, 1.0, 0.0));
            pieces.grey("ground", 0.5).polygon(&facing_up([0.0, 5.0], [0.0, 5.0], 0.0));
            let [low, high] = [2.5 - size, 2.5 + size];
            pieces.glowing("dome", 1.0).room(DVec3::new(low, low, 0.0), DVec3::new(high, high, 2.0 * size));
            let mut scene = pieces.scene_with(&LoadOptions { up: Some(UpAxis::Z), ..LoadOptions::default() });
            if has_sky {
                scene
                    .set_sky(&SkyOptions::of_texts(Some("uniform:100"), None, None, None).expect("a sky"))
                    .expect("a sky");
            }
            let notes = model(&scene, Detail::Rays).notes_of_lost_light();
            notes.iter().any(|note| note.contains("`dome` encloses all other surfaces"))
        };
        assert_eq!(
            [(3.0, true), (3.0, false), (1.0, true)].map(|(size, sky)| noted(size, sky)),
            [true, false, false]
        );
    }

    #[test]
    fn lamps_in_opaque_bulbs_get_a_note() {
        let noted = |size: f64| {
            let mut pieces = Pieces::empty();
            pieces.grey("floor", 0.5).polygon(&facing_up([0.0, 5.0], [0.0, 5.0], 0.0));
            pieces.glowing("lamp", 1.0).polygon(&facing_down([2.49, 2.51], [2.49, 2.51], 2.0));
            let (low, high) = (
                DVec3::new(2.5 - size, 2.5 - size, 2.0 - size),
                DVec3::new(2.5 + size, 2.5 + size, 2.0 + size),
            );
            pieces.grey("bulb", 0.5).room(low, high);
            let notes = model(&pieces.scene(), Detail::Rays).notes_of_lost_light();
            notes.iter().any(|note| note.contains("rays from the emitter `lamp` end on `bulb`"))
        };
        assert_eq!([0.02, 1.0].map(noted), [true, false]);
        // A floor of 1 km that all rays of a lamp meet is near it and not around it.
        let notes = with_lamps(1e3, &[(1.0, false)], &LoadOptions::default()).notes_of_lost_light();
        assert!(notes.iter().all(|note| !note.contains("enclosed")), "{notes:?}");
    }

    /// Lamps above a floor of this width.
    fn with_lamps(width: f64, lamps: &[(f64, bool)], options: &LoadOptions) -> Model {
        scene_of(width, lamps, options, None)
    }

    fn scene_of(width: f64, lamps: &[(f64, bool)], options: &LoadOptions, below: Option<f64>) -> Model {
        let mut pieces = Pieces::empty();
        // Of a cellar the lamps are far from the edges.
        let floor = if below.is_some() { [-0.5 * width, 0.5 * width] } else { [0.0, width] };
        pieces.grey("floor", 0.5).polygon(&facing_up(floor, floor, 0.0));
        if let Some(z) = below {
            let cellar = [-width, 2.0 * width];
            pieces.grey("cellar", 0.5).polygon(&facing_up(cellar, cellar, z));
        }
        for (i, &(z, up)) in lamps.iter().enumerate() {
            let faces = if up { facing_up } else { facing_down };
            let x = 0.5 + i as f64;
            pieces.glowing(&format!("lamp {i}"), 10.0).polygon(&faces([x, x + 0.5], [0.0, 0.5], z));
        }
        let scene = pieces.scene_with(options);
        model(&scene, Detail::Rays)
    }

    /// A lamp above a floor with a cellar below is outside of the cellar, however near; one above a floor alone is not.
    #[test]
    fn lamps_outside_of_a_space_are_named() {
        let lamps = |z: f64| with_lamps(10.0, &[(z, false)], &LoadOptions::default());
        assert_eq!(lamps(0.05).note_of_outside_emitters(), None);
        for z in [0.05, 0.4] {
            let found = with_cellar(&[(z, false)]).note_of_outside_emitters().expect("a note");
            assert!(found.contains(&format!("emitter `lamp 0` is blocked by `floor`, {z:.2}")), "{found}");
        }
        // An uplight just below the ceiling of the cellar.
        assert_eq!(with_cellar(&[(-0.05, true)]).note_of_outside_emitters(), None);
    }

    #[test]
    fn one_lamp_of_two_that_faces_away_is_named() {
        let options = LoadOptions::default();
        assert_eq!(note(&[(2.0, false), (2.0, false)], &options), None);
        let found = note(&[(2.0, false), (2.0, true)], &options).expect("a note");
        assert!(found.contains("1 of 2 emitters") && found.contains("`lamp 1`"), "{found}");
        // The upper lamp is in front of the lower one.
        assert_eq!(note(&[(2.1, false), (2.0, true)], &options), None);
        assert_eq!(
            note(&[(2.0, false), (2.0, true)], &LoadOptions { two_sided_emission: true, ..options }),
            None
        );
        // However small the floor looks from there.
        assert_eq!(note(&[(1e4, false)], &LoadOptions::default()), None);
    }
}
