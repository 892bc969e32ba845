//! Charts of odd numbers and long names; bars.

use super::*;

fn point(x: f64, y: f64) -> PlotPoint {
    PlotPoint { x, y, label: format!("label {x}") }
}

#[test]
fn any_input_gives_an_svg() {
    let odd = vec![point(f64::NAN, 1.0), point(0.0, 0.0), point(-1.0, 2.0), point(1.0, f64::INFINITY)];
    let inputs = [vec![], odd, vec![point(1.0, 1.0)], vec![point(1e-300, 1e300), point(1e300, 1e-300)]];
    for points in inputs {
        for scale in [Scale::Linear, Scale::Log] {
            let series = vec![Series::new("a < b & c", points.clone(), Marks::Joined)];
            let plot = Plot { series, x_scale: scale, y_scale: scale, ..Default::default() };
            let svg = plot.svg(0, 0).unwrap();
            assert!(svg.starts_with("<svg ") && svg.contains("a &lt; b &amp; c") && !svg.contains("NaN"));
        }
    }
}

/// Bars of two series stand side by side on the axis, also those of 0.
#[test]
fn bars_stand_side_by_side() {
    let series = |y: f64| Series {
        points: vec![PlotPoint { x: 1.0, y, ..Default::default() }],
        marks: Marks::Bars,
        ..Default::default()
    };
    let plot = Plot { series: vec![series(1.0), series(0.0)], ..Default::default() };
    let svg = plot.svg(400, 300).unwrap();
    let bars: Vec<Vec<i32>> = svg
        .split("<rect ")
        .skip(1)
        .map(|rect| {
            ["x=\"", "y=\"", "width=\"", "height=\""]
                .map(|name| rect.split(name).nth(1).and_then(|r| r.split('"').next()))
                .map(|n| n.and_then(|n| n.parse().ok()).unwrap_or(0))
                .to_vec()
        })
        .filter(|r| r[2] > 11)
        .collect();
    let [a, b] = &bars[..] else { panic!("{svg}") };
    assert!(a[0] + a[2] < b[0] + 1 && a[1] + a[3] == b[1] + b[3], "{a:?} {b:?}");
    assert!(a[3] > 100 && (1..3).contains(&b[3]), "{a:?} {b:?}");
}

/// Long names of series and axes: shorter or in rows, never beyond the picture.
#[test]
fn names_stay_inside() {
    let plot = Plot {
        x_label: "time of the queries of a very long scene ".repeat(3),
        series: ["exact", "exact with certificates", "multi-res., 16 segments", &"long ".repeat(40)]
            .map(|name| Series::new(name, vec![point(1.0, 2.0)], Marks::Joined))
            .into(),
        ..Default::default()
    };
    let rows: Vec<i32> = plot.legend(352).iter().map(|entry| entry.row).collect();
    assert_eq!(rows, [0, 0, 1, 2]);
    assert!(plot.legend(352).iter().all(|e| e.left + 25 + text_width(&e.name, e.size) <= 352));
    assert_eq!(fitted("short", 14, 100), ("short".into(), 14));
    assert!(fitted(&plot.x_label, 14, 300).0.ends_with('…'));
}

#[test]
fn labels_do_not_cover_each_other() {
    let limits = [0, 0, 400, 400];
    let first = label_place((100, 100), "same", limits, &[]).unwrap();
    let second = label_place((100, 100), "same", limits, &[first]).unwrap();
    assert_ne!(first, second);
    assert_eq!(label_place((100, 100), "same", limits, &[limits]), None);
}
