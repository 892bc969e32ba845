//! What `tests/capi/answers.c` prints, computed by the crate.

use mrvis::metrics::{Fbem, FbemOptions, Image, fbem};
use mrvis::{
    Answers, Cost, Detail, Element, Engine, FormFactorOptions, Grouping, ImageOptions, LoadOptions,
    MeshArrays, Method, Model, PrepareOptions, Scene, SceneBuilder, Segments, Solution, SolveOptions,
    SurfacePoint,
};
use std::fmt::Write;

const BOXES: u32 = 300;
const BUNDLES: usize = 40;
const RAYS: usize = 16;

/// The random numbers of `common.h`.
struct Draw(u32);

impl Draw {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 16_777_216.0
    }
}

/// A floor, a lamp above it, boxes in between.
fn scene() -> Scene {
    const FACES: [u32; 24] = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5];
    let mut builder = SceneBuilder::default();
    let grey = builder.add_material("grey", [0.5; 3], [0.0; 3]).expect("grey");
    let red = builder.add_material("red", [0.75, 0.25, 0.25], [0.0; 3]).expect("red");
    let lamp = builder.add_material("lamp", [0.0; 3], [10.0; 3]).expect("lamp");
    let floor = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    builder
        .add_object(&MeshArrays::new("floor", &floor[..], &[0, 1, 2, 0, 2, 3]).material(grey))
        .expect("floor");
    let above = [[0.4f64, 0.4, 1.0], [0.6, 0.4, 1.0], [0.6, 0.6, 1.0], [0.4, 0.6, 1.0]];
    let mesh = MeshArrays::new("lamp", &above[..], &[3, 2, 1, 0]).polygon_sizes(&[4]).material(lamp);
    builder.add_object(&mesh).expect("lamp");
    let mut draw = Draw(1);
    let (mut positions, mut indices, mut materials) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..BOXES {
        let at = [draw.next(), draw.next(), 0.3 + 0.4 * draw.next()];
        for corner in 0..8 {
            positions.push([0, 1, 2].map(|c| at[c] + if corner >> c & 1 == 1 { 0.02f32 } else { 0.0 }));
        }
        indices.extend(FACES.map(|v| 8 * i + v));
        materials.extend([if i % 2 == 1 { red } else { grey }; 6]);
    }
    let sizes = vec![4; 6 * BOXES as usize];
    let mesh =
        MeshArrays::new("boxes", &positions[..], &indices).polygon_sizes(&sizes).face_materials(&materials);
    builder.add_object(&mesh).expect("boxes");
    builder.finish(&LoadOptions::default()).expect("a scene")
}

pub fn model() -> Model {
    let mut options = PrepareOptions::default();
    options.threads = 1;
    Model::prepare(scene(), &options).expect("a model")
}

/// Answers of all engines, as the C++ program prints them.
pub fn bundles(model: &Model) -> String {
    batches(model, false)
}

fn batches(model: &Model, with_all: bool) -> String {
    let mut draw = Draw(7);
    let (mut origins, mut targets, mut offsets) = (Vec::new(), Vec::new(), vec![0]);
    for _ in 0..BUNDLES {
        let (x, y) = (draw.next(), draw.next());
        for _ in 0..RAYS {
            origins.push([x, y, 0.001f32]);
            targets.push([0.4 + 0.2 * draw.next(), 0.4 + 0.2 * draw.next(), 0.999f32]);
        }
        offsets.push(origins.len() as u64);
    }
    let sizes: Vec<f32> = (0..BUNDLES).map(|k| if k % 2 == 1 { 0.05 } else { 0.4 }).collect();
    let segments =
        Segments::new(&origins[..], &targets[..], &offsets).feature_sizes(&sizes).emitter_size(0.15);
    let mut text = String::new();
    for (number, engine) in
        [Engine::Automatic, Engine::Exact, Engine::MultiResolution, Engine::Average].into_iter().enumerate()
    {
        let (mut t, mut lo, mut hi) = ([0.0; BUNDLES], [0.0; BUNDLES], [0.0; BUNDLES]);
        let (mut methods, mut each) = ([Method::Clear; BUNDLES], [0.0; BUNDLES * RAYS]);
        let mut answers = Answers::new(&mut t).intervals(&mut lo, &mut hi).methods(&mut methods);
        if with_all {
            answers = answers.segments(&mut each);
        }
        let cost =
            model.visibility().with_engine(engine).answer_into(&segments, &mut answers).expect("answers");
        if with_all {
            let Cost { segments, nodes, exact_rays, handed_over, aggregated, certified, .. } = cost;
            writeln!(text, "cost {segments} {nodes} {exact_rays} {handed_over} {aggregated} {certified}")
                .unwrap();
        }
        for k in 0..BUNDLES {
            let [t, lo, hi] = [t[k], lo[k], hi[k]].map(f32::to_bits);
            writeln!(text, "{number} {k} {t:08x} {lo:08x} {hi:08x} {}", methods[k] as u8).unwrap();
        }
        for bundle in each.chunks(RAYS).filter(|_| with_all) {
            let bits: Vec<String> = bundle.iter().map(|t| format!("{:08x}", t.to_bits())).collect();
            writeln!(text, "{}", bits.join(" ")).unwrap();
        }
    }
    text
}

/// All that `answers.c` prints.
pub fn all() -> String {
    let model = model();
    let mut text = String::new();
    scene_lines(&mut text, model.scene());
    text.push_str(&batches(&model, true));
    query_lines(&mut text, &model);
    solution_lines(&mut text, &model);
    reference_lines(&mut text, &model);
    fbem_lines(&mut text);
    form_factor_lines(&mut text);
    text.push_str("before 0 0 1 1\ninstance two 3 -1\nafter 1 1 0 0\n");
    text
}

fn scene_lines(text: &mut String, scene: &Scene) {
    let (objects, emitters) = (scene.object_names(), scene.emitter_names());
    writeln!(
        text,
        "scene {} {} {} {} {} {} {}",
        scene.triangle_count(),
        scene.visible_triangle_count(),
        objects.len(),
        scene.material_names().len(),
        emitters.len(),
        scene.repairs().len(),
        scene.unit()
    )
    .unwrap();
    let ([low, high], origin) = (scene.bounds(), scene.origin());
    for i in 0..3 {
        let [low, high, origin] = [low[i], high[i], origin[i]].map(f64::to_bits);
        writeln!(text, "bounds {low:016x} {high:016x} {origin:016x}").unwrap();
    }
    objects.for_each(|name| writeln!(text, "object {name}").unwrap());
    emitters.for_each(|name| writeln!(text, "emitter {name}").unwrap());
}

fn query_lines(text: &mut String, model: &Model) {
    let visibility = model.visibility();
    let automatic = visibility.from_point([0.3, 0.7, 0.0], [0.0, 0.0, 2.0]).feature_size(0.3).rays(48);
    let exact = visibility.clone().with_engine(Engine::Exact);
    let exact = exact.from_point([0.3, 0.7, 0.0], [0.0, 0.0, 2.0]).feature_size(0.3).to_point([0.9; 3]);
    for answer in [automatic.to_source(0).answer(), exact.answer()] {
        let answer = answer.expect("an answer");
        let [t, lo, hi] = [answer.transmittance, answer.lo, answer.hi].map(f32::to_bits);
        writeln!(text, "query {t:08x} {lo:08x} {hi:08x} {}", answer.method as u8).unwrap();
    }
}

fn solution_lines(text: &mut String, model: &Model) {
    let mut options = SolveOptions::default();
    (options.error, options.min_area) = (0.3, 1e-3);
    let light = model.solve(&options).expect("light");
    let report = light.report();
    let mean = report.mean_irradiance[0].to_bits();
    let estimate = report.error_estimate.unwrap_or(-1.0).to_bits();
    writeln!(text, "solution {mean:016x} {estimate:016x} {}", i32::from(report.interrupted)).unwrap();
    let point = |x, y, z| SurfacePoint { position: [x, y, 0.0], normal: [0.0, 0.0, z] };
    let found = light.irradiance(&[point(0.25, 0.25, 1.0), point(0.8, 0.6, 5.0)]).expect("irradiance");
    found.as_flattened().iter().for_each(|e| writeln!(text, "irradiance {:016x}", e.to_bits()).unwrap());
    element_lines(text, &light);
    image_lines(text, &light);
}

/// A number that stands for an array: FNV-1a of its bytes.
fn hash<const N: usize>(numbers: impl IntoIterator<Item = [u8; N]>) -> u64 {
    let step = |number: u64, byte: u8| (number ^ u64::from(byte)).wrapping_mul(1_099_511_628_211);
    numbers.into_iter().flatten().fold(14_695_981_039_346_656_037, step)
}

fn element_lines(text: &mut String, light: &Solution) {
    let all = light.elements();
    let rgb = |of: fn(&Element) -> [f64; 3]| hash(all.iter().flat_map(of).map(|c| (c as f32).to_ne_bytes()));
    let number = |of: fn(&Element) -> u32| hash(all.iter().map(|e| of(e).to_ne_bytes()));
    writeln!(text, "elements {} {}", light.vertices().len(), all.len()).unwrap();
    for (name, value) in [
        ("positions", hash(light.vertices().flatten().map(f64::to_ne_bytes))),
        ("corners", hash(all.iter().flat_map(|e| e.corners).map(u32::to_ne_bytes))),
        ("irradiance", rgb(|e| e.irradiance)),
        ("radiosity", rgb(|e| e.radiosity)),
        ("error", rgb(|e| e.error)),
        ("reflectance", hash(all.iter().flat_map(|e| e.albedo).map(f32::to_ne_bytes))),
        ("area", hash(all.iter().map(|e| e.area.to_ne_bytes()))),
        ("triangle", number(|e| e.triangle)),
        ("object", number(|e| e.object)),
        ("material", number(|e| e.material)),
        ("front", hash(all.iter().map(|e| [u8::from(e.front)]))),
        ("exitance", rgb(|e| e.exitance)),
    ] {
        writeln!(text, "{name} {value:016x}").unwrap();
    }
}

fn image_lines(text: &mut String, light: &Solution) {
    let camera = light.automatic_camera().expect("a camera");
    let mut radiance = vec![0.0; 3 * 32 * 24];
    let mut options = ImageOptions::default();
    options.size = [32, 24];
    light.image(&camera, &options, &mut radiance).expect("an image");
    let (eye, image) =
        (hash(camera.eye.map(f64::to_ne_bytes)), hash(radiance.into_iter().map(f32::to_ne_bytes)));
    writeln!(text, "image {eye:016x} {image:016x}").unwrap();
    let map = light.lightmap(4096).expect("a lightmap");
    let floats = |numbers: Vec<f32>| hash(numbers.into_iter().map(f32::to_ne_bytes));
    let irradiance = floats(map.irradiance.concat());
    writeln!(text, "lightmap {} {} {irradiance:016x}", map.width, map.height).unwrap();
    let positions = hash(map.positions.iter().flatten().map(|p| p.to_ne_bytes()));
    let corners = hash(map.triangles.iter().flatten().map(|v| v.to_ne_bytes()));
    let texcoords = floats(map.texcoords.concat().concat());
    writeln!(text, "positions {positions:016x}\ncorners {corners:016x}\ntexcoords {texcoords:016x}").unwrap();
}

fn reference_lines(text: &mut String, model: &Model) {
    let point = |x, y| SurfacePoint { position: [x, y, 0.0], normal: [0.0, 0.0, 1.0] };
    let found = model.reference(&[point(0.25, 0.25), point(0.8, 0.6)], 16, 9).expect("a reference");
    for (value, error) in found.irradiance.as_flattened().iter().zip(found.standard_errors.as_flattened()) {
        writeln!(text, "reference {:016x} {:016x}", value.to_bits(), error.to_bits()).unwrap();
    }
}

fn fbem_lines(text: &mut String) {
    let inside = |i: usize| i > 8 && i < 24;
    let value = |x, y| match (inside(x) && inside(y), x == 16 && y == 16) {
        (true, true) => 0.75,
        (true, false) => 0.25,
        _ => 1.0,
    };
    let reference = Image::from_fn(32, 32, 0.25, value).expect("an image");
    let mut draw = Draw(3);
    let noisy = |x, y| value(x, y) + 0.125 * draw.next();
    let approximation = Image::from_fn(32, 32, 0.25, noisy).expect("an image");
    let found = fbem(&reference, &approximation, &[0.0, 0.5, 4.0], &FbemOptions::default()).expect("errors");
    for Fbem { value, masked_fraction, .. } in found {
        writeln!(text, "fbem {:016x} {:016x}", value.to_bits(), masked_fraction.to_bits()).unwrap();
    }
}

fn form_factor_lines(text: &mut String) {
    let mut options = PrepareOptions::default();
    (options.detail, options.threads) = (Detail::Rays, 2);
    let model = Model::prepare(Scene::generate("cornell").expect("a box"), &options).expect("a model");
    let mut options = FormFactorOptions::default();
    (options.grouping, options.rays) = (Grouping::Object, Some(256));
    let factors = model.form_factors(&options).expect("factors");
    let (rows, entries) = (factors.areas.len(), factors.columns.len());
    writeln!(text, "factors {rows} {entries} {} {:016x}", factors.rays, factors.row_sum_error.to_bits())
        .unwrap();
    for row in 0..factors.areas.len() {
        let [escaped, lost] = [factors.escaped[row], factors.lost[row]].map(f32::to_bits);
        let (name, area) = (&factors.names[row], factors.areas[row].to_bits());
        writeln!(text, "row {name} {area:016x} {escaped:08x} {lost:08x}").unwrap();
        let (columns, values) = factors.row(row);
        for (to, factor) in columns.iter().zip(values) {
            writeln!(text, "factor {to} {:08x}", factor.to_bits()).unwrap();
        }
    }
}
