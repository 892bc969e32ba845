//! Repairs and their counts.

use super::*;

/// A cube of edge `a` at `o`, as one OBJ object whose vertices start at number `first`.
fn cube(name: &str, first: usize, a: f64, o: [f64; 3]) -> String {
    let mut text = format!("o {name}\n");
    for i in 0..8u8 {
        let c = |bit: u8, k: usize| o[k] + if i & bit != 0 { a } else { 0.0 };
        text += &format!("v {} {} {}\n", c(1, 0), c(2, 1), c(4, 2));
    }
    for f in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
        text += &format!("f {} {} {} {}\n", f[0] + first, f[1] + first, f[2] + first, f[3] + first);
    }
    text
}

#[test]
fn polygons_keep_their_area() {
    let check = |points: &[[f64; 2]], want: f64, concave: usize| {
        // In a plane that is not parallel to any axis.
        let corners: String =
            points.iter().map(|[x, y]| format!("v {} {} {}\n", x, 0.8 * y, 0.6 * y)).collect();
        let numbers: String = (1..=points.len()).map(|i| format!(" {i}")).collect();
        let s = load(&format!("{corners}f{numbers}\n")).expect("a polygon");
        check_consistent(&s);
        assert!((area(&s) - want).abs() < 1e-5 * want, "{points:?}: {} instead of {want}", area(&s));
        assert_eq!(s.repairs.concave_polygons, concave, "{points:?}");
        // All triangles have the orientation of the polygon.
        let mut normals = (0..s.triangles.len() as u32).map(|t| s.face_normal(t));
        assert!(normals.all(|n| n.dot(Vec3::new(0.0, -0.6, 0.8)) > 0.99), "{points:?}");
    };
    check(&[[0., 0.], [2., 0.], [2., 1.], [0., 1.]], 2.0, 0);
    check(&[[0., 0.], [2., 0.], [2., 2.], [1., 2.], [1., 1.], [0., 1.]], 3.0, 1);
    // An arrow with its reflex corner first.
    check(&[[1., 1.], [0., 3.], [-3., -3.], [3., 0.]], 12.0, 1);
    // Repeated and collinear corners.
    check(&[[0., 0.], [0., 0.], [1., 0.], [2., 0.], [2., 1.], [2., 1.], [0., 1.]], 2.0, 0);
    // A square hole, joined by a double edge.
    let hole =
        [[0., 0.], [3., 0.], [3., 3.], [0., 3.], [0., 0.], [1., 1.], [1., 2.], [2., 2.], [2., 1.], [1., 1.]];
    check(&hole, 8.0, 1);
    // A comb and a star with many corners, as in real furniture.
    let mut comb: Vec<[f64; 2]> = (0..136).map(|i| [f64::from(i), f64::from(i % 2)]).collect();
    comb.extend([[135., -1.], [0., -1.]]);
    comb.reverse();
    check(&comb, 135.0 * 1.5, 1);
    let star: Vec<[f64; 2]> = (0..600)
        .map(|i| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 600.0).sin_cos();
            let r = if i % 2 == 0 { 2.0 } else { 1.0 };
            [r * cos, r * sin]
        })
        .collect();
    check(&star, 300.0 * 2.0 * (std::f64::consts::TAU / 600.0).sin(), 1);
}

#[test]
fn what_has_no_area_or_no_answer_is_dropped_and_counted() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0.5 0.5 0\nv 1 1 0\nf 1 2 3\n";
    let check = |faces: &str, count: fn(&Repairs) -> usize, triangles: usize| {
        let s = load(&format!("{triangle}{faces}")).expect(faces);
        check_consistent(&s);
        assert_eq!((count(&s.repairs), s.triangles.len()), (1, triangles), "{faces}: {:?}", s.repairs);
        assert!(!s.repairs.messages.is_empty());
    };
    check("f 1 1 2\n", |r| r.zero_area_faces, 1);
    check("f 1 2\n", |r| r.zero_area_faces, 1);
    check("f 2 4 3\n", |r| r.zero_area_faces, 1);
    check("f 3 2 1\n", |r| r.duplicate_faces, 1);
    check("f 2 3 1\n", |r| r.duplicate_faces, 1);
    // The two sides of a wall have materials of their own.
    let wall = load(&format!("{triangle}usemtl other\nf 3 2 1\n")).expect("a wall");
    assert_eq!((wall.triangles.len(), wall.repairs.duplicate_faces), (2, 0));
    // Shapes like bow ties, with and without net area.
    check("f 1 2 3 5\n", |r| r.broken_polygons, 1);
    check("v 0 3 0\nv 3 3 0\nf 1 2 6 7\n", |r| r.broken_polygons, 1);
}

#[test]
fn sides_come_from_connectivity() {
    let check = |obj: &str, closed: usize, sheets: usize| {
        let s = load(obj).expect(obj);
        check_consistent(&s);
        assert_eq!((s.closed_parts, s.sheet_parts), (closed, sheets), "{obj}");
        s
    };
    let one = cube("a", 1, 1.0, [0.0; 3]);
    let s = check(&one, 1, 0);
    assert!(s.triangle_sides.iter().all(|&x| x == 1));
    let open: String = one.lines().take(14).map(|l| format!("{l}\n")).collect();
    let s = check(&open, 0, 1);
    assert!(s.triangle_sides.iter().all(|&x| x == 2));
    // Two solids in contact have common corners and stay two solids; so does a single one.
    let touching = one.clone() + &cube("b", 9, 1.0, [1.0, 0.0, 0.0]);
    let s = check(&touching, 2, 0);
    assert_eq!((s.repairs.welded_vertices, s.repairs.duplicate_faces), (4, 0));
    check(&(touching + &cube("c", 17, 1.0, [5.0, 0.0, 0.0])), 3, 0);
    // A solid in two groups with separate vertices for each face is one solid.
    let halves = one.replace("f 1 2 6 5", "g other\nf 1 2 6 5");
    check(&halves, 1, 0);
    // A corner in the middle of an edge, used by both faces, one of which ear clipping simplifies.
    let extra = one.replace("f 1 3 4 2", "v 0.5 0 0\nf 1 3 4 2 9").replace("f 1 2 6 5", "f 1 9 2 6 5");
    assert!(extra.contains("f 1 9 2"));
    check(&extra, 1, 0);
}

#[test]
fn sides_can_be_overridden() {
    let options = LoadOptions { sides: Some(2), ..Default::default() };
    let s = load_with(&cube("a", 1, 1.0, [0.0; 3]), &[], &options).expect("a cube");
    assert!(s.triangle_sides.iter().all(|&x| x == 2));
    assert_eq!(s.closed_parts, 1);
    assert!(load_with("", &[], &LoadOptions { sides: Some(3), ..Default::default() }).is_err());
}

#[test]
fn scale_and_place_do_not_matter() {
    for scale in [1e-9f64, 1e-3, 1.0, 5e4] {
        for place in [[0.0; 3], [5e6, -4e6, 100.0], [1e3, 1e3, 1e3]] {
            let o = place.map(|p| p * scale.clamp(1e-3, 1.0));
            let s = load(&cube("a", 1, scale, o)).expect("a cube");
            check_consistent(&s);
            // Precision of the edge in f64 at that distance, and in f32 after subtraction of the origin.
            let digits = 1e-6 + 3.0 * f64::EPSILON * o[0].abs() / scale;
            assert_eq!((s.triangles.len(), s.closed_parts), (12, 1), "{scale} at {o:?}");
            assert!(
                (area(&s) / (6.0 * scale * scale) - 1.0).abs() < 10.0 * digits,
                "{scale} at {o:?}: {}",
                area(&s)
            );
        }
    }
    let s = load(&cube("a", 1, 2.0, [10.0, 0.0, 0.0])).expect("a cube");
    assert_eq!(s.origin.x + f64::from(s.bounds.min.x), 10.0);
}

#[test]
fn materials_and_their_absence() {
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl grün\nf 1 2 3\n";
    let mtl =
        |text: &str| load_with(obj, &[("a.mtl", text.as_bytes())], &LoadOptions::default()).expect(text);
    let s = mtl("newmtl grün\nKd 0.1 0.2 0.3\nKe 0 5 0\n");
    assert_eq!((s.triangle_reflectance[0], s.materials[0].emission), ([0.1, 0.2, 0.3], [0.0, 5.0, 0.0]));
    assert!(s.repairs.messages.is_empty());
    let s = mtl("newmtl grün\nKd 1 2 -1\n");
    assert_eq!(
        s.triangle_reflectance[0],
        [crate::scene::MAX_REFLECTANCE, crate::scene::MAX_REFLECTANCE, 0.0]
    );
    assert_eq!(s.repairs.clamped_reflectances, 1);
    let s = mtl("newmtl blue\nKd 1 0 0\n");
    assert_eq!((s.triangle_reflectance[0], s.repairs.faces_without_material), ([0.5; 3], 1));
    assert_eq!(s.materials[0].name, "grün", "the name of a missing material can still be asked for");
    let s = load(obj).expect("no library");
    assert_eq!((s.repairs.missing_files, s.repairs.faces_without_material), (1, 1));
    let s = load(&obj.replace("usemtl grün\n", "").replace("mtllib a.mtl\n", "")).expect("no material");
    assert_eq!((s.repairs.missing_files, s.repairs.faces_without_material), (0, 1));
    let s = mtl("newmtl grün\nd 0.5\n");
    assert!(s.repairs.messages[0].contains("treated as opaque: `grün`"));
    let s = mtl("newmtl grün\nd 0.4\nKe 1 1 1\n");
    assert_eq!((s.repairs.transparent_faces, s.emitters.len()), (0, 1), "lamps stay");
    let glass = [("a.mtl", "newmtl grün\nd 0.4\n".as_bytes())];
    assert!(
        message(load_with(obj, &glass, &LoadOptions::default()))
            .contains("all 1 faces are transparent (d below 0.5)")
    );
    let both = obj.to_owned() + "usemtl other\nf 1 3 2\nv 0 0 1\nf 1 2 4\n";
    let s = load_with(&both, &glass, &LoadOptions::default()).expect("one is not transparent");
    assert_eq!((s.repairs.transparent_faces, s.triangles.len()), (1, 2));
}

#[test]
fn textures_become_a_mean() {
    let mut png = std::io::Cursor::new(Vec::new());
    let image = image::RgbImage::from_fn(4, 4, |x, _| image::Rgb(if x < 2 { [255; 3] } else { [0, 0, 0] }));
    image.write_to(&mut png, image::ImageFormat::Png).expect("a png");
    let obj = "mtllib a.mtl\nusemtl t\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
               f 1/1 2/2 3/3 4/4\n";
    let check = |mtl: &str, want: f32| {
        let files = [("a.mtl", mtl.as_bytes()), ("b c.png", png.get_ref().as_slice())];
        let s = load_with(obj, &files, &LoadOptions::default()).expect(mtl);
        // Two triangles of the square: the means differ, their sum is one half.
        let mean: f32 = s.triangle_reflectance.iter().map(|r| r[0]).sum::<f32>() / 2.0;
        assert!((mean - want).abs() < 0.07, "{mtl}: {mean}");
        s
    };
    check("newmtl t\nmap_Kd b c.png\n", 0.5);
    check("newmtl t\nKd 0 0 0\nmap_Kd -s 1 1 1 b c.png\n", 0.5);
    check("newmtl t\nKd 0.5 0.5 0.5\nmap_Kd b c.png\n", 0.25);
    let s = check("newmtl t\nKd 0.4 0.4 0.4\nmap_Kd gone.png\n", 0.4);
    assert_eq!(s.repairs.missing_files, 1);
}

#[test]
fn emitters_are_surfaces() {
    // A rectangle of 3 by 0.5, turned by 30 degrees in the plane x = 0, in two triangles; and a triangle apart.
    let obj = "o lamp\nv 0 0 0\nv 0 2.598076 1.5\nv 0 2.348076 1.933013\nv 0 -0.25 0.433013\n\
               f 1 2 3\nf 1 3 4\nv 9 0 0\nv 9 1 0\nv 9 0 1\nf 5 6 7\no box\nv 20 0 0\nf 5 7 8\n";
    let emitters = vec![("lamp".to_owned(), Strength::Watts(10.0))];
    for two_sided_emission in [false, true] {
        let options = LoadOptions { emitters: emitters.clone(), two_sided_emission, ..Default::default() };
        let s = load_with(obj, &[], &options).expect("emitters");
        check_consistent(&s);
        assert_eq!(s.emitters.iter().map(|e| e.name.as_str()).collect::<Vec<_>>(), ["lamp 1", "lamp 2"]);
        let e = &s.emitters[0];
        assert!((e.min_width - 0.5).abs() < 1e-5 && (e.area - 1.5).abs() < 1e-5, "{e:?}");
        assert!((e.normal - Vec3::X).length() < 1e-5);
        let power: f64 = s.emitters.iter().map(|e| s.power(e)[1]).sum();
        assert!((power - 10.0).abs() < 1e-5, "{power}");
    }
    // In millimetres the same numbers mean a million times less area and a higher radiance.
    let radiance = |unit: &str| {
        let options = LoadOptions { emitters: emitters.clone(), unit: unit.into(), ..Default::default() };
        load_with(obj, &[], &options).expect(unit).emitters[0].emission[0]
    };
    assert!((radiance("mm") / radiance("m") / 1e6 - 1.0).abs() < 1e-5);
    // A power of 0 switches off what emits by its material, and nothing else.
    let lit = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 9 0 0\nv 9 1 0\nv 9 0 1\no a\nusemtl l\nf 1 2 3\no b\nf 4 5 6\n";
    let files: [(&str, &[u8]); 1] = [("m.mtl", b"newmtl l\nKd .3 .3 .3\nKe 5 5 5\n")];
    let off = LoadOptions { emitters: vec![("a".into(), Strength::Watts(0.0))], ..Default::default() };
    let names = |options: &LoadOptions| {
        let s = load_with(lit, &files, options).expect("a scene");
        assert!(s.triangle_reflectance.iter().all(|r| (r[1] - 0.3).abs() < 1e-6));
        s.emitters.iter().map(|e| e.name.clone()).collect::<Vec<_>>()
    };
    assert_eq!(names(&LoadOptions::default()), ["a", "b"]);
    assert_eq!(names(&off), ["b"]);
    let wrong = LoadOptions { emitters: vec![("sun".into(), Strength::Watts(1.0))], ..Default::default() };
    let text = message(load_with(obj, &[], &wrong));
    assert_eq!(
        text,
        "`emitters`: no object, group or material is called `sun`; there are `lamp`, `box`, `(none)`"
    );
}

#[test]
fn a_thin_luminous_box_is_one_emitter() {
    let panel = cube("panel", 1, 1.0, [0.0; 3]).replace(" 1\n", " 0.1\n");
    let options =
        LoadOptions { emitters: vec![("panel".into(), Strength::Watts(5.0))], ..Default::default() };
    let s = load_with(&panel, &[], &options).expect("a panel");
    assert_eq!((s.emitters.len(), s.closed_parts), (1, 1));
    let e = &s.emitters[0];
    assert!(
        (e.area - 2.4).abs() < 1e-5 && e.normal.length() < 1e-6 && (e.min_width - 0.1).abs() < 1e-6,
        "{e:?}"
    );
}

#[test]
fn emitter_arguments() {
    assert_eq!(parse_emitter("a=b=60").expect("a name with ="), ("a=b".to_owned(), Strength::Watts(60.0)));
    assert_eq!(parse_emitter("a=6W").unwrap().1, Strength::Watts(6.0));
    assert_eq!(parse_emitter("a=800 lm").unwrap().1, Strength::Lumens(800.0));
    assert_eq!(parse_emitter("a=5e3cd/m2").unwrap().1, Strength::Luminance(5e3));
    for wrong in ["lamp", "lamp=", "=3", "lamp=-1", "lamp=nan", "lamp=inf", "lamp=-0.1", "lamp=6V", "lamp=lm"]
    {
        assert!(parse_emitter(wrong).is_err(), "{wrong}");
    }
}
