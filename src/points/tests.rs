use super::*;
use std::path::PathBuf;

fn scratch(content: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("scratch folder");
    let path = folder.path().join("points.csv");
    std::fs::write(&path, content).expect("written");
    (folder, path)
}

fn refusal(content: impl AsRef<[u8]>) -> String {
    let (_folder, path) = scratch(content.as_ref());
    let text = read_points(&path).expect_err("refused").to_string();
    let start = text.find("points.csv").expect("names the file");
    text[start + "points.csv".len()..].to_owned()
}

fn sample(errors: bool) -> Irradiance {
    let point = |x: f64| Point { position: DVec3::new(x, 1.0 / 3.0, -2e5), normal: DVec3::Z };
    Irradiance {
        points: vec![point(0.0), point(0.1)],
        values: vec![[1.0, 2.0, 3.0], [0.1, 1e-20, -0.5]],
        standard_errors: if errors { vec![[0.1; 3]; 2] } else { vec![] },
    }
}

#[test]
fn irradiance_files_read_back_bit_by_bit() {
    for errors in [false, true] {
        let (folder, _) = scratch(b"");
        let path = folder.path().join("irradiance.csv");
        write_irradiance(&path, &sample(errors), None).expect("written");
        assert_eq!(read_irradiance(&path).expect("read"), sample(errors));
        // An irradiance file is a point file.
        assert_eq!(read_points(&path).expect("points"), sample(errors).points);
        let text = std::fs::read_to_string(&path).expect("text");
        let header = text.lines().next().expect("a line");
        assert!(header.starts_with("x,y,z,nx,ny,nz,Er,Eg,Eb"), "{header}");
    }
}

#[test]
fn what_spreadsheets_write_is_read() {
    let (_folder, path) = scratch(b"\xef\xbb\xbfx, y, z, nx, ny, nz\r\n1, 2, 3, 0, 0.6, 0.8004\r\n\r\n");
    let points = read_points(&path).expect("points");
    assert_eq!(points.len(), 1);
    assert_eq!(points[0].position, DVec3::new(1.0, 2.0, 3.0));
    assert!((points[0].normal.length() - 1.0).abs() < 1e-15);
}

#[test]
fn bad_files_are_refused_by_line() {
    let good = "x,y,z,nx,ny,nz\n0,0,0,0,0,1\n";
    for (content, want) in [
        (String::new(), ":1: the header must begin with `x,y,z,nx,ny,nz`"),
        ("0,0,0,0,0,1\n".into(), ":1: the header must begin with"),
        ("x,y,z,nx,ny,nz\n".into(), ": holds no point"),
        (format!("{good}0,0,nan,0,0,1\n"), ":3: column 3: `nan` is not a finite number"),
        (format!("{good}0,0,0,0,inf,1\n"), ":3: column 5: `inf` is not a finite number"),
        (format!("{good}0,0,0,0,0,\n"), ":3: column 6: `` is not a finite number"),
        (format!("{good}0,0,0,0,0,2\n"), ":3: the normal has the length 2.000000, it must be 1"),
        (format!("{good}0,0,0,0,0,0\n"), ":3: the normal has the length 0.000000"),
        (format!("{good}1e30,0,0,0,0,1\n"), ":3: a coordinate is beyond 1e18"),
        (format!("{good}0,0,0\n"), ":3: 3 fields where the header has 6"),
    ] {
        let text = refusal(&content);
        assert!(text.starts_with(want), "{content:?}: {text}");
    }
    let text = refusal([0xff, 0xfe, 0x00, 0x81].repeat(50));
    assert!(text.contains("UTF-8") || text.contains("header"), "{text}");
    assert!(read_points(std::path::Path::new("/nowhere/p.csv")).is_err());
    let (_folder, path) = scratch(good.as_bytes());
    assert!(read_irradiance(&path).expect_err("no values").to_string().contains("Er,Eg,Eb"));
}

#[test]
fn comparisons_state_rms_bias_and_percentiles() {
    let points = vec![Point { position: DVec3::X, normal: DVec3::Z }; 100];
    let reference = Irradiance {
        points: points.clone(),
        values: vec![[2.0; 3]; 100],
        standard_errors: vec![[0.02; 3]; 100],
    };
    let mut test = Irradiance { standard_errors: vec![], ..reference.clone() };
    let same = compare(&reference, &test).expect("compared");
    assert_eq!((same.rms, same.bias, same.percentiles), (0.0, 0.0, [0.0; 4]));
    test.values[0] = [4.0; 3];
    let one = compare(&reference, &test).expect("compared");
    // One point of a hundred differs by the mean: rms √(1/100), bias 1/100.
    assert!((one.rms - 0.1).abs() < 1e-12 && (one.bias - 0.01).abs() < 1e-12, "{one:?}");
    assert_eq!(one.percentiles, [0.0, 0.0, 0.0, 1.0]);
    assert!((one.reference_noise - 0.01).abs() < 1e-12);
    assert!(one.rms_by_channel.iter().all(|r| (r - 0.1).abs() < 1e-12));
    test.points[3].position = DVec3::Y;
    assert!(compare(&reference, &test).expect_err("moved").to_string().starts_with("point 4 is at"));
    test.points.pop();
    assert!(compare(&reference, &test).expect_err("fewer").to_string().contains("100 points, the test 99"));
    let black = Irradiance { values: vec![[0.0; 3]; 100], ..reference.clone() };
    assert_eq!(compare(&black, &black).expect("compared").rms, 0.0);
    assert!(compare(&black, &reference).expect("compared").rms.is_infinite());
}
