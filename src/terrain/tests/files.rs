use super::*;
use crate::Result;
use crate::files::header;
use std::path::{Path, PathBuf};
use tiff::encoder::{TiffEncoder, colortype};
use tiff::tags::Tag;

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("scratch folder")
}

fn read_as(name: &str, content: &[u8], options: &ReadOptions) -> Result<Loaded> {
    let folder = folder();
    let path = folder.path().join(name);
    std::fs::write(&path, content).expect("written");
    read(&path, options)
}

/// The refusal of a file, from its name on.
fn refusal(name: &str, content: &[u8], options: &ReadOptions) -> String {
    let text = read_as(name, content, options).expect_err("refused").to_string();
    assert!(!text.contains('\n'), "{text}");
    text.split_once(name).map_or(text.clone(), |(_, rest)| rest.to_owned())
}

fn plain() -> ReadOptions {
    ReadOptions::default()
}

const HEADER: &str = "ncols 3\nnrows 2\nxllcorner 1000\nyllcorner 2000.5\ncellsize 10\nNODATA_value -9999\n";

#[test]
fn ascii_grids_are_read() {
    let loaded =
        read_as("a.asc", format!("{HEADER}1 2 3\n4 -9999 6e0\n").as_bytes(), &plain()).expect("read");
    let grid = loaded.grid;
    assert_eq!((grid.columns(), grid.rows(), grid.cell(), grid.holes()), (3, 2, [10.0; 2], 1));
    assert_eq!((grid.height(0, 0), grid.height(2, 1)), (1.0, 6.0));
    assert_eq!(grid.georeference().position(0, 1), [1005.0, 2005.5]);
    assert!(loaded.notes.iter().any(|n| n.starts_with("1 of 6 samples")), "{:?}", loaded.notes);
    let text = "\u{feff}NCOLS 2\r\nNROWS 2\r\nxllcenter 5\r\nyllcenter 6\r\nDX 2\r\nDY 4\r\n1 2 3\r\nnan\r\n";
    let grid = read_as("b.asc", text.as_bytes(), &plain()).expect("read").grid;
    assert_eq!((grid.cell(), grid.georeference().position(0, 0), grid.holes()), ([2.0, 4.0], [5.0, 10.0], 1));
    let feet = ReadOptions { height_scale: Some(0.3048), height_offset: 1.0, ..plain() };
    let grid = read_as("c.asc", format!("{HEADER}1 2 3\n4 5 10\n").as_bytes(), &feet).expect("read").grid;
    assert_eq!(grid.height(2, 1), 4.048);
}

#[test]
fn samples_without_data_are_found_or_named() {
    let header = HEADER.replace("NODATA_value -9999\n", "");
    let read =
        |values: &str| read_as("a.asc", format!("{header}{values}\n").as_bytes(), &plain()).expect("read");
    let loaded = read("1 2 3 4 -9999 6");
    assert_eq!(loaded.grid.holes(), 1);
    // Millimetres.
    let has_cure = |loaded: Loaded| loaded.notes.iter().any(|n| n.contains("set by ⟨height_scale⟩"));
    assert!(has_cure(read("375000 375200 380000 400000 640000 500000")));
    assert!(!has_cure(read("-10900 8848 0 1 2 3")));
    let has_note = |loaded: Loaded| loaded.notes.iter().any(|n| n.contains("far below all others"));
    assert!(has_note(read("1 2 3 4 -32768 6")));
    for plausible in
        ["1 2 3 4 -32 6", "-2000 -1990 -1980 -1970 -1960 -1950", "-2000 -2000 -2000 -2000 -2000 -2000"]
    {
        assert!(!has_note(read(plausible)), "{plausible}");
    }
}

#[test]
fn bad_ascii_grids_are_refused_by_line() {
    let header = |from: &str, to: &str| HEADER.replace(from, to) + "1 2 3 4 5 6\n";
    for (content, want) in [
        (String::new(), ": the header has no `ncols`"),
        ("ncols".into(), ":1: `ncols` has no value"),
        (format!("{HEADER}1 2 3\n4 5\n"), ":8: ends after 5 of 6 values"),
        (format!("{HEADER}1 2 3\n4 5 6\n7\n"), ":9: more than the 6 values"),
        (format!("{HEADER}1 2 3\n4 x5 6\n"), ":8: `x5` is not a finite number"),
        (format!("{HEADER}1 2 3\n4 5,5 6\n"), ":8: `5,5` is not a finite number: write decimal points"),
        (format!("{HEADER}1 2 3\n4 inf 6\n"), ":8: `inf` is not a finite number"),
        (format!("{HEADER}-9999 -9999 -9999 -9999 nan -9999"), ": no sample of the grid has a height"),
        (header("ncols 3", "ncols 0"), ": `ncols` 0: must be a positive whole number"),
        (header("ncols 3", "ncols -3"), ": `ncols` -3: must be"),
        (header("ncols 3", "ncols 2.5"), ": `ncols` 2.5: must be"),
        (header("ncols 3", "ncols 100000"), ": 100000 columns and 2 rows are 200000 values, more than"),
        (header("ncols 3", "ncols 100000000"), ": 100000000 columns and 2 rows: at most"),
        (header("nrows 2", "nrows 1"), ": 3 columns and 1 rows: a terrain needs 2 of each"),
        (header("cellsize 10", "cellsize 0"), ": `cellsize`: the cell size 0 × 0 m must lie in"),
        (header("cellsize 10", "cellsize -1"), ": `cellsize`: the cell size -1"),
        (header("cellsize 10\n", ""), ": does not say how far its samples are apart: set `cell`"),
        (header("cellsize", "cellsice"), ":5: `cellsice` is not a name"),
        (format!("{HEADER}1 2 3 4 5 1e30"), ": the height 1"),
    ] {
        let text = refusal("a.asc", content.as_bytes(), &plain());
        assert!(text.starts_with(want), "{content:?}: {text}");
    }
    let degrees = "ncols 2\nnrows 2\nxllcorner 7.5\nyllcorner 46\ncellsize 0.001\n400 500 600 2000";
    assert!(refusal("a.asc", degrees.as_bytes(), &plain()).contains("in degrees"));
    let told = ReadOptions { cell: Some([80.0, 110.0]), ..plain() };
    assert_eq!(read_as("a.asc", degrees.as_bytes(), &told).expect("read").grid.cell(), [80.0, 110.0]);
    assert!(refusal("a.asc", &[0xff, 0xfe, 0, 1], &plain()).contains("is not text"));
    assert!(refusal("a.xyz", b"1 2 3", &plain()).contains("a terrain is read from .asc"));
    assert!(read(Path::new("/nowhere/a.asc"), &plain()).is_err());
    for options in [
        ReadOptions { cell: Some([0.0, 1.0]), ..plain() },
        ReadOptions { height_scale: Some(f64::NAN), ..plain() },
        ReadOptions { height_offset: 1e9, ..plain() },
    ] {
        assert!(read_as("a.asc", HEADER.as_bytes(), &options).is_err());
    }
}

/// A GeoTIFF of 4 × 3 samples with the numbers 0 to 11 and keys.
fn geotiff(keys: &[u16], scale: [f64; 3], tie: [f64; 6]) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    let mut file = TiffEncoder::new(&mut out).expect("a file");
    let mut image = file.new_image::<colortype::Gray16>(4, 3).expect("an image");
    image.encoder().write_tag(Tag::ModelPixelScaleTag, &scale[..]).expect("a tag");
    image.encoder().write_tag(Tag::ModelTiepointTag, &tie[..]).expect("a tag");
    image.encoder().write_tag(Tag::GeoKeyDirectoryTag, keys).expect("a tag");
    image.encoder().write_tag(Tag::GeoDoubleParamsTag, &[0.1f64, 0.2][..]).expect("a tag");
    image.encoder().write_tag(Tag::GeoAsciiParamsTag, "WGS 84|").expect("a tag");
    image.encoder().write_tag(Tag::GdalNodata, "7").expect("a tag");
    image.write_data(&(0..12).collect::<Vec<u16>>()).expect("data");
    out.into_inner()
}

/// Projected, UTM zone 32 north, pixels as areas, heights in `unit`.
fn utm(unit: u16) -> Vec<u16> {
    vec![1, 1, 0, 4, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 32632, 4099, 0, 1, unit]
}

const TIE: [f64; 6] = [0.0, 0.0, 0.0, 4e5, 5.2e6, 0.0];

#[test]
fn geotiffs_keep_their_georeference() {
    let loaded = read_as("a.tif", &geotiff(&utm(9001), [30.0, 20.0, 0.0], TIE), &plain()).expect("read");
    let grid = &loaded.grid;
    assert_eq!((grid.columns(), grid.rows(), grid.cell(), grid.holes()), (4, 3, [30.0, 20.0], 1));
    assert_eq!((grid.height(3, 2), grid.georeference().position(0, 0)), (11.0, [400_015.0, 5_199_990.0]));
    let folder = folder();
    let values: Vec<f32> = (0..12).map(|i| if i == 7 { f32::NAN } else { i as f32 * 0.25 }).collect();
    let layers = [Layer { name: "sky view <factor>", values: &values }, Layer { name: "b", values: &values }];
    for count in [1, 2] {
        let path = folder.path().join("b.tif");
        write_geotiff(&path, grid, &layers[..count]).expect("written");
        let again = match count {
            1 => read(&path, &plain()).expect("read").grid,
            _ => {
                assert!(read(&path, &plain()).expect_err("two bands").to_string().contains("has 2 bands"));
                continue;
            }
        };
        assert_eq!(again.georeference(), grid.georeference());
        let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(again.heights()), bits(&values));
    }
    assert!(write_geotiff(&folder.path().join("c.tif"), grid, &[]).is_err());
    assert!(
        write_geotiff(&folder.path().join("c.tif"), grid, &[Layer { name: "a", values: &[1.0] }]).is_err()
    );
}

#[test]
fn units_of_geotiffs_are_used() {
    let feet = read_as("a.tif", &geotiff(&utm(9002), [30.0, 20.0, 0.0], TIE), &plain()).expect("read");
    assert_eq!(feet.grid.height(1, 1), 5.0 * 0.3048);
    assert!(feet.notes.iter().any(|n| n.contains("0.304800 m")), "{:?}", feet.notes);
    let lengths = [1, 1, 0, 2, 1024, 0, 1, 1, 3076, 0, 1, 9003];
    let half = read_as("a.tif", &geotiff(&lengths, [30.0, 20.0, 0.0], TIE), &plain()).expect("read");
    assert!(half.notes.iter().any(|n| n.contains("no unit of heights")), "{:?}", half.notes);
    let bare = geotiff(&[1, 1, 0, 0], [1e-4, 1e-4, 0.0], [0.0, 0.0, 0.0, 7.0, 46.0, 0.0]);
    assert!(refusal("a.tif", &bare, &plain()).contains("in degrees"));
    let unknown = geotiff(&utm(9999), [30.0, 20.0, 0.0], TIE);
    assert!(refusal("a.tif", &unknown, &plain()).contains("EPSG:9999: set `height_scale`"));
    let degrees = [1, 1, 0, 2, 1024, 0, 1, 2, 1025, 0, 1, 1];
    let at =
        |latitude: f64, size: f64| geotiff(&degrees, [size, size, 0.0], [0.0, 0.0, 0.0, 7.0, latitude, 0.0]);
    let near = read_as("a.tif", &at(46.0, 0.001), &plain()).expect("read");
    // Lengths of a degree at 46°: 77.46 km and 111.15 km.
    assert!((near.grid.cell()[0] - 77.46).abs() < 0.01 && (near.grid.cell()[1] - 111.15).abs() < 0.01);
    assert!(near.notes.iter().any(|n| n.starts_with("is in degrees")), "{:?}", near.notes);
    assert!(refusal("a.tif", &at(60.0, 2.0), &plain()).contains("EPSG:32633"));
    assert!(refusal("a.tif", &at(500.0, 1.0), &plain()).contains("latitudes"));
    assert!(
        refusal("a.tif", &geotiff(&utm(9001), [0.0, 20.0, 0.0], TIE), &plain()).contains("must be positive")
    );
    assert!(refusal("a.tif", &geotiff(&utm(9001), [f64::NAN, 20.0, 0.0], TIE), &plain()).contains("finite"));
}

/// An archive with one array, as `numpy.savez_compressed` writes it.
fn compressed(npy: &[u8]) -> Vec<u8> {
    let mut archive = rawzip::ZipArchiveWriter::new(Vec::new());
    let file = archive.new_file("z.npy").compression_method(rawzip::CompressionMethod::DEFLATE);
    let (mut entry, sums) = file.start().expect("an entry");
    let mut out = sums.wrap(flate2::write::DeflateEncoder::new(&mut entry, flate2::Compression::default()));
    std::io::Write::write_all(&mut out, npy).expect("written");
    let (encoder, sums) = out.finish().expect("sums");
    encoder.finish().expect("finished");
    entry.finish(sums).expect("finished");
    archive.finish().expect("an archive")
}

/// Cut off or changed files are refused or read, and never end the program.
#[test]
fn damaged_files_are_errors() {
    let folder = folder();
    let grid = read_as("a.tif", &geotiff(&utm(9001), [30.0, 20.0, 0.0], TIE), &plain()).expect("read").grid;
    let path = |name: &str| -> PathBuf { folder.path().join(name) };
    let layer = Layer { name: "heights", values: grid.heights() };
    write_npz(&path("a.npz"), &grid, &[layer]).expect("written");
    let mut npy = header("<f4", &[3, 4]);
    npy.extend(bytemuck::cast_slice::<f32, u8>(grid.heights()));
    let options = ReadOptions { cell: Some([1.0; 2]), height_scale: Some(1.0), ..plain() };
    for (name, bytes) in [
        ("b.tif", geotiff(&utm(9001), [30.0, 20.0, 0.0], TIE)),
        ("b.npz", std::fs::read(path("a.npz")).expect("bytes")),
        ("c.npz", compressed(&npy)),
        ("b.npy", npy),
        ("b.asc", format!("{HEADER}1 2 3\n4 5 6\n").into_bytes()),
        ("b.png", grey(&[0, 1, 2, 3, 4, 5], 3)),
    ] {
        assert!(read_as(name, &bytes, &options).is_ok(), "{name}");
        for cut in 0..bytes.len() {
            let _ = read_as(name, &bytes[..cut], &options);
        }
        assert!(read_as(name, &bytes[..bytes.len() / 2], &options).is_err(), "{name}");
        for i in 0..bytes.len() {
            for value in [0, 0xff, bytes[i] ^ 0x10] {
                let mut bad = bytes.clone();
                bad[i] = value;
                let _ = read_as(name, &bad, &options);
            }
        }
    }
}

/// A PNG of 16 bits.
fn grey(values: &[u16], columns: u32) -> Vec<u8> {
    let image = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(
        columns,
        values.len() as u32 / columns,
        values.to_vec(),
    );
    let mut out = std::io::Cursor::new(Vec::new());
    image.expect("a picture").write_to(&mut out, image::ImageFormat::Png).expect("encoded");
    out.into_inner()
}

#[test]
fn pictures_have_a_scale() {
    let bytes = grey(&[0, 1000, 65535, 3], 2);
    let options = ReadOptions {
        cell: Some([2.0; 2]),
        height_scale: Some(0.1),
        height_offset: -5.0,
        no_data: Some(3.0),
    };
    let grid = read_as("a.png", &bytes, &options).expect("read").grid;
    assert_eq!((grid.height(0, 0), grid.height(1, 0), grid.height(0, 1)), (-5.0, 95.0, 6548.5));
    assert_eq!(grid.holes(), 1);
    let text = refusal("a.png", &bytes, &ReadOptions { cell: Some([2.0; 2]), ..plain() });
    assert!(text.contains("set `height_scale`"), "{text}");
    let text = refusal("a.png", &bytes, &ReadOptions { height_scale: Some(1.0), ..plain() });
    assert!(text.contains("set `cell`"), "{text}");
}

#[test]
fn arrays_are_read_in_all_orders() {
    let options = ReadOptions { cell: Some([1.0; 2]), ..plain() };
    let file = |kind: &str, order: &str, shape: &str, data: &[u8]| {
        let mut text = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}, }}");
        text.push('\n');
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes.extend(data);
        bytes
    };
    let doubles: Vec<u8> = (0..6).flat_map(|i| f64::from(i).to_le_bytes()).collect();
    let grid = read_as("a.npy", &file("<f8", "False", "(2, 3)", &doubles), &options).expect("read").grid;
    assert_eq!((grid.columns(), grid.rows(), grid.height(1, 1)), (3, 2, 4.0));
    let grid = read_as("a.npy", &file("<f8", "True", "(2, 3)", &doubles), &options).expect("read").grid;
    assert_eq!((grid.columns(), grid.rows(), grid.height(1, 0), grid.height(0, 1)), (3, 2, 2.0, 1.0));
    for (bytes, want) in [
        (file("<f8", "False", "(2, 4)", &doubles), "2 × 4 needs other than its 48 bytes"),
        (file("<f8", "False", "(99999999999, 99999999999)", &doubles), "needs other than"),
        (file("<f8", "False", "(6,)", &doubles), "an array of 1 dimensions"),
        (file("<c16", "False", "(1, 3)", &doubles), "of the kind `<c16`"),
        (file("|O", "False", "(2, 3)", &doubles), "of the kind `|O`"),
        (file("<f8", "False", "(2, -3)", &doubles), "not of whole numbers"),
    ] {
        let text = refusal("a.npy", &bytes, &options);
        assert!(text.contains(want), "{text}");
    }
    assert!(refusal("a.npy", &file("<f8", "False", "(2, 3)", &doubles), &plain()).contains("set `cell`"));
}

#[test]
fn archives_hold_all_layers() {
    let folder = folder();
    let grid = plane(5, 2.0, 0.3, 1.0).expect("a grid");
    let path = folder.path().join("a.npz");
    let other = vec![1.0; 25];
    let layers = [Layer { name: "sky", values: &other }, Layer { name: "heights", values: grid.heights() }];
    write_npz(&path, &grid, &layers).expect("written");
    let options = ReadOptions { cell: Some([2.0; 2]), ..plain() };
    assert_eq!(read(&path, &options).expect("read").grid.heights(), grid.heights());
    let mut npy = header("<f4", &[5, 5]);
    npy.extend(bytemuck::cast_slice::<f32, u8>(grid.heights()));
    assert_eq!(read_as("b.npz", &compressed(&npy), &options).expect("read").grid.heights(), grid.heights());
    write_npz(&path, &grid, &[layers[0], Layer { name: "other", values: &other }]).expect("written");
    assert!(read(&path, &options).expect_err("two arrays").to_string().contains("holds 2 arrays"));
}

#[test]
fn pictures_show_ranges() {
    let folder = folder();
    let path = folder.path().join("a.png");
    let grid = plane(5, 2.0, 0.3, 1.0).expect("a grid");
    let values: Vec<f32> = (0..25).map(|i| if i == 0 { f32::NAN } else { i as f32 }).collect();
    let layer = Layer { name: "a", values: &values };
    write_png(&path, &grid, layer, [0.0, 24.0]).expect("written");
    let picture = image::open(&path).expect("a picture").to_rgb8();
    assert_eq!((picture.dimensions(), picture.get_pixel(0, 0).0), ((5, 5), [255; 3]));
    assert_ne!(picture.get_pixel(1, 0), picture.get_pixel(4, 4));
    assert!(write_png(&path, &grid, layer, [1.0, 1.0]).is_err());
}
