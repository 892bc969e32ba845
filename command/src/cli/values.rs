//! Options with a few values: how the command line names each, its help, and what it stands for.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use mrvis::internals::points::Point;
use mrvis::{Builder, Channels, Engine, Scene, UpAxis};

/// Names, help and meanings of values.
pub type Values<T> = &'static [(&'static str, &'static str, T)];

/// Reads one of these values.
pub fn one_of<T: Copy + Send + Sync + 'static>(all: Values<T>) -> impl TypedValueParser<Value = T> {
    let named = |(name, help, _): &(&'static str, &'static str, T)| match help.is_empty() {
        true => PossibleValue::new(*name),
        false => PossibleValue::new(*name).help(*help),
    };
    let meant = move |name: String| all.iter().find(|(known, ..)| *known == name).map(|(.., value)| *value);
    PossibleValuesParser::new(all.iter().map(named)).map(move |name| meant(name).expect("a possible value"))
}

/// The name of a value.
pub fn name_of<T: PartialEq>(all: Values<T>, value: T) -> &'static str {
    all.iter().find(|(.., known)| *known == value).map_or("", |(name, ..)| name)
}

/// Sets the fields of options of the library to the arguments of the same names.
macro_rules! set_fields {
    ($options:ident = $args:tt: $($name:ident),+ $(,)?) => {
        $($options.$name = Clone::clone(&$args.$name);)+
    };
}
pub(super) use set_fields;

/// The value of a `--tolerance`.
pub fn tolerance(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|t: &f64| t.is_finite() && *t >= 0.0)
        .ok_or_else(|| "must be a finite number not below 0".into())
}

/// Upward axes.
pub const UP: Values<UpAxis> = &[("y", "+y, as in glTF", UpAxis::Y), ("z", "+z", UpAxis::Z)];

/// How channels are luminous.
pub const CHANNELS: Values<Channels> = &[
    ("rgb", "Radiometric channels, weighted", Channels::Rgb),
    ("red", "The red channel alone, in lumens instead of watts", Channels::Red),
    ("green", "The green channel alone, in lumens instead of watts", Channels::Green),
    ("blue", "The blue channel alone, in lumens instead of watts", Channels::Blue),
];

/// Engines of a solve.
pub const ENGINES: Values<Engine> = &[
    ("exact", "Embree rays", Engine::Exact),
    ("mr", "Multi-resolution: clusters with small features are averaged", Engine::MultiResolution),
    ("average", "Extinction only", Engine::Average),
];

/// The builder of the clusters, for commands that build them.
#[derive(clap::Args, Clone, Debug)]
pub struct ClusterArgs {
    /// Algorithm that builds the clusters.
    #[arg(long, value_parser = one_of(BUILDERS), default_value = Builder::default().name())]
    pub builder: Builder,
}

const BUILDERS: Values<Builder> = &[
    ("grids", "hierarchy of uniform grids, as in the paper", Builder::Grids),
    ("kdtree", "halves of space", Builder::KdTree),
    ("goldsmith-salmon", "boxes by insertion", Builder::GoldsmithSalmon),
    ("sah", "divisions by the surface area heuristic", Builder::Sah),
];

/// Lowers points of the map to a scene on the curved earth.
pub fn lower(scene: &Scene, points: &mut [Point]) {
    for point in points {
        (point.position, point.normal) = scene.lowered(point.position, point.normal);
    }
}
