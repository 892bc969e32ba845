//! Cache files are correct or not used.

use super::*;
use crate::optics;
use crate::scene::testing::{Pieces, in_cube};
use glam::DVec3;
use proptest::prelude::*;
use rand_pcg::Pcg64Mcg;
use std::sync::OnceLock;
use tempfile::TempDir;

/// Small triangles in a cube, and a wall.
fn pieces() -> Pieces {
    let mut random = Pcg64Mcg::new(7);
    let mut pieces = Pieces::new();
    for _ in 0..300 {
        let place = 4.0 * in_cube(&mut random);
        pieces.polygon(&[0, 1, 2].map(|_| place + 0.2 * in_cube(&mut random)));
    }
    pieces.polygon(&[DVec3::ZERO, 9.0 * DVec3::X, DVec3::new(9.0, 9.0, 0.0), 9.0 * DVec3::Y]);
    pieces
}

/// The scene in a new folder.
fn scene_in(folder: &TempDir) -> Scene {
    let mut scene = pieces().scene();
    scene.path = folder.path().join("scene.obj");
    scene
}

fn made(scene: &Scene, options: &Options) -> PreparedClusters {
    let hierarchy = clusters::build(scene, &options.clusters);
    let optics = optics::measure(scene, &hierarchy.micro, &options.optics);
    PreparedClusters { hierarchy, optics }
}

/// [`load_or_make`] with clusters that are always made.
fn load_or_made(
    scene: &Scene,
    place: &CacheLocation,
    options: &Options,
    make: impl FnOnce() -> PreparedClusters,
) -> (PreparedClusters, Origin, Option<String>) {
    load_or_make(scene, place, options, || Some(make())).expect("clusters are made")
}

/// The folder of the scene.
fn beside(scene: &Scene) -> CacheLocation {
    CacheLocation::Folder(scene.path.parent().expect("a folder").into())
}

/// Prepared clusters and their origin, cached beside the scene.
fn ask(scene: &Scene) -> (PreparedClusters, Origin, Option<String>) {
    let options = Options::default();
    load_or_made(scene, &beside(scene), &options, || made(scene, &options))
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").path()).collect();
    files.sort();
    files
}

/// A valid file, made once.
fn example() -> &'static (Scene, Vec<u8>, PreparedClusters) {
    static EXAMPLE: OnceLock<(Scene, Vec<u8>, PreparedClusters)> = OnceLock::new();
    EXAMPLE.get_or_init(|| {
        let folder = tempfile::tempdir().expect("scratch folder");
        let scene = scene_in(&folder);
        let (table, origin, _) = ask(&scene);
        assert_eq!(origin, Origin::Made);
        let bytes = std::fs::read(&files(folder.path())[0]).expect("the file");
        (scene, bytes, table)
    })
}

#[test]
fn the_second_time_nothing_is_made() {
    let folder = tempfile::tempdir().expect("scratch folder");
    let scene = scene_in(&folder);
    let (first, origin, note) = ask(&scene);
    assert_eq!((origin, note), (Origin::Made, None));
    let options = Options::default();
    let (second, origin, note) = load_or_made(&scene, &beside(&scene), &options, || panic!("made again"));
    assert_eq!((origin, note), (Origin::Hit, None));
    // Equal bit by bit: the format distinguishes every f32, also −0 and 0.
    assert!(format!("{first:?}") == format!("{second:?}"));
    assert_eq!(files(folder.path()).len(), 1);
    let (_, origin, _) = load_or_made(&scene, &CacheLocation::Off, &options, || made(&scene, &options));
    assert_eq!(origin, Origin::Off);
}

#[test]
fn everything_that_the_table_depends_on_is_in_the_key() {
    let scene = pieces().scene();
    let settings = format!("{:?}", Options::default());
    let mut other: Vec<blake3::Hash> = vec![key(&scene, &settings, CODE)];
    let mut with = |change: &dyn Fn(&mut Scene)| {
        let mut scene = scene.clone();
        change(&mut scene);
        other.push(key(&scene, &settings, CODE));
    };
    with(&|s| s.positions[5].x += 1e-6);
    with(&|s| s.triangles.swap(3, 4));
    with(&|s| s.triangles[7].rotate_left(1));
    with(&|s| s.triangle_sides[2] = 1);
    with(&|s| s.triangle_object[9] += 1);
    with(&|s| s.triangle_component[9] += 1);
    with(&|s| {
        s.triangles.pop();
    });
    let mut options = Options::default();
    options.optics.tolerance *= 1.0 + f32::EPSILON;
    other.push(key(&scene, &format!("{options:?}"), CODE));
    options = Options::default();
    options.clusters.large_surface = 0.1;
    other.push(key(&scene, &format!("{options:?}"), CODE));
    other.push(key(&scene, &settings, "another version"));
    let all = other.len();
    other.sort_by(|a, b| a.as_bytes().cmp(b.as_bytes()));
    other.dedup();
    assert_eq!(other.len(), all);
    // Materials and emitters do not affect clusters.
    let mut painted = scene.clone();
    painted.materials.iter_mut().for_each(|m| m.emission = [1.0; 3]);
    assert_eq!(key(&painted, &settings, CODE), key(&scene, &settings, CODE));
}

#[test]
fn files_are_found_by_content() {
    let (cache, a, b) = (tempfile::tempdir(), tempfile::tempdir(), tempfile::tempdir());
    let place = CacheLocation::Folder(cache.as_ref().expect("scratch folder").path().join("new/folder"));
    let options = Options::default();
    for (want, folder) in [(Origin::Made, &a), (Origin::Hit, &b)] {
        let scene = scene_in(folder.as_ref().expect("scratch folder"));
        assert_eq!(load_or_made(&scene, &place, &options, || made(&scene, &options)).1, want);
    }
}

/// A link of the name of a cache file is neither read nor followed.
#[test]
#[cfg(unix)]
fn links_are_not_followed() {
    let folder = tempfile::tempdir().expect("scratch folder");
    let elsewhere = tempfile::tempdir().expect("scratch folder");
    let victim = elsewhere.path().join("victim");
    let scene = scene_in(&folder);
    ask(&scene);
    let path = files(folder.path()).remove(0);
    std::fs::rename(&path, &victim).expect("moved");
    std::os::unix::fs::symlink(&victim, &path).expect("linked");
    let before = std::fs::read(&victim).expect("read");
    assert_eq!(ask(&scene).1, Origin::Made);
    assert!(path.symlink_metadata().expect("there").is_file());
    std::fs::write(&victim, "mine").expect("written");
    std::fs::remove_file(&path).expect("removed");
    std::os::unix::fs::symlink(&victim, &path).expect("linked");
    assert_eq!(ask(&scene).1, Origin::Made);
    assert_eq!(std::fs::read(&victim).expect("read"), b"mine");
    assert_eq!(std::fs::read(&path).expect("read"), before);
}

#[test]
fn the_oldest_files_are_removed() {
    let folder = tempfile::tempdir().expect("scratch folder");
    let start = std::time::SystemTime::UNIX_EPOCH;
    for (name, age) in [("a.mrvis-cache", 3), ("b.mrvis-cache", 1), ("c.mrvis-cache", 2), ("mine", 9)] {
        let file = std::fs::File::create(folder.path().join(name)).expect("made");
        file.set_len(10).expect("sized");
        file.set_modified(start + std::time::Duration::from_secs(100 - age)).expect("dated");
    }
    remove_oldest(folder.path(), 20);
    let names: Vec<_> =
        files(folder.path()).iter().map(|f| f.file_name().expect("a name").to_owned()).collect();
    assert_eq!(names, ["b.mrvis-cache", "c.mrvis-cache", "mine"]);
}

#[test]
fn what_cannot_be_written_is_said_and_no_error() {
    let folder = tempfile::tempdir().expect("scratch folder");
    let scene = scene_in(&folder);
    let options = Options::default();
    let file = folder.path().join("file");
    std::fs::write(&file, "no folder").expect("written");
    for place in [file.clone(), file.join("below"), PathBuf::from("/proc/nowhere")].map(CacheLocation::Folder)
    {
        let (table, origin, note) = load_or_made(&scene, &place, &options, || made(&scene, &options));
        assert_eq!(origin, Origin::Off, "{place:?}");
        assert!(note.is_some_and(|n| n.contains("could not be kept")), "{place:?}");
        assert!(table == made(&scene, &options));
    }
    // A folder of the same name is not replaced.
    ask(&scene);
    let path = files(folder.path()).into_iter().find(|p| p != &file).expect("the cache");
    std::fs::remove_file(&path).expect("removed");
    std::fs::create_dir(&path).expect("a folder");
    let (_, origin, note) = ask(&scene);
    assert_eq!(origin, Origin::Off);
    assert!(note.is_some() && path.is_dir());
}

#[test]
fn runs_at_the_same_time_do_not_disturb_each_other() {
    let folder = tempfile::tempdir().expect("scratch folder");
    let scene = scene_in(&folder);
    let want = made(&scene, &Options::default());
    std::thread::scope(|threads| {
        for _ in 0..8 {
            threads.spawn(|| {
                for _ in 0..4 {
                    let (table, _, note) = ask(&scene);
                    assert!(table == want && note.is_none(), "{note:?}");
                }
            });
        }
    });
    assert_eq!(ask(&scene).1, Origin::Hit);
    assert_eq!(files(folder.path()).len(), 1);
}

/// Loads these bytes as the cache file of the example.
fn load_bytes(bytes: &[u8]) -> std::result::Result<PreparedClusters, Unusable> {
    let folder = tempfile::tempdir().expect("scratch folder");
    let path = folder.path().join("file");
    std::fs::write(&path, bytes).expect("written");
    let scene = &example().0;
    load(&path, &key(scene, &format!("{:?}", Options::default()), CODE), scene)
}

/// The payload with a correct key and checksum: a forged file.
fn forged(payload: &[u8]) -> Vec<u8> {
    let head = MAGIC.len() + HASH;
    let mut bytes = [&example().1[..head], payload].concat();
    let sum = blake3::hash(&bytes);
    bytes.extend_from_slice(sum.as_bytes());
    bytes
}

#[test]
fn the_example_itself_is_fine() {
    let (_, bytes, want) = example();
    assert!(load_bytes(bytes).is_ok_and(|t| t == *want));
    let payload = &bytes[MAGIC.len() + HASH..bytes.len() - HASH];
    assert!(load_bytes(&forged(payload)).is_ok_and(|t| t == *want));
    for wrong in [&[][..], &MAGIC[..], &bytes[..bytes.len() - 1], b"mrvis side tabl", &[0; 1 << 20]] {
        assert!(load_bytes(wrong).is_err());
    }
    assert!(load_bytes(&[bytes, &b"x"[..]].concat()).is_err());
}

#[test]
fn forged_tables_that_do_not_fit_are_refused() {
    let (_, _, table) = example();
    let refused = |change: &dyn Fn(&mut PreparedClusters)| {
        let mut table = table.clone();
        change(&mut table);
        let payload = postcard::to_stdvec(&table).expect("serialised");
        assert!(load_bytes(&forged(&payload)).is_err());
    };
    refused(&|t| t.optics.truncate(3));
    refused(&|t| t.optics[1].extinction[0] = -1.0);
    refused(&|t| t.optics[1].extinction[2] = f32::INFINITY);
    refused(&|t| t.optics[1].slope.x = f32::NAN);
    refused(&|t| t.optics[1].blocker_size[1] = 1e9);
    refused(&|t| t.optics[1].gap_size[1] = -0.1);
    refused(&|t| t.optics[1].averaging_width[1] = f32::NAN);
    refused(&|t| t.optics[1].connected_size[1] = 1e9);
    refused(&|t| t.optics[1].coverage[0] = 1.5);
    refused(&|t| t.optics[1].error = 2.0);
    // Other damage of trees: `clusters::tests::validator_finds_every_kind_of_damage`.
    refused(&|t| {
        let last = t.hierarchy.micro.clusters.len() - 1;
        t.hierarchy.micro.clusters[last].first_triangle = u32::MAX - 1;
    });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// A change of any byte is detected.
    #[test]
    fn flipped_bits_are_found(place in 0.0..1.0f64, flip in 1u8..) {
        let mut bytes = example().1.clone();
        let i = (place * bytes.len() as f64) as usize;
        bytes[i] ^= flip;
        prop_assert!(load_bytes(&bytes).is_err());
    }

    /// Forged content with a correct checksum is refused without a panic.
    #[test]
    fn forged_bits_do_no_harm(place in 0.0..1.0f64, flip in 1u8..) {
        let (scene, bytes, _) = example();
        let mut payload = bytes[MAGIC.len() + HASH..bytes.len() - HASH].to_vec();
        let i = (place * payload.len() as f64) as usize;
        payload[i] ^= flip;
        if let Ok(table) = load_bytes(&forged(&payload)) {
            prop_assert!(table.hierarchy.check(scene).is_ok());
            prop_assert_eq!(table.optics.len(), table.hierarchy.micro.clusters.len());
        }
    }
}
