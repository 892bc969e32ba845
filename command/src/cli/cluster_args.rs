//! How the clusters of a scene are built, for commands that build them.

use clap::builder::PossibleValue;
use mrvis::Builder;
use mrvis::internals::BuilderParts;

/// The builder of the clusters.
#[derive(clap::Args, Clone, Debug)]
pub struct ClusterArgs {
    /// Algorithm that builds the clusters.
    #[arg(long, value_enum, default_value = Builder::default().name())]
    builder: BuilderArg,
}

impl ClusterArgs {
    /// The builder.
    pub fn builder(&self) -> Builder {
        self.builder.0
    }
}

/// A value of `--builder`.
#[derive(Clone, Copy, Debug)]
struct BuilderArg(Builder);

impl clap::ValueEnum for BuilderArg {
    fn value_variants<'a>() -> &'a [BuilderArg] {
        const ALL: [BuilderArg; 4] = {
            let [a, b, c, d] = Builder::ALL;
            [BuilderArg(a), BuilderArg(b), BuilderArg(c), BuilderArg(d)]
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()).help(match self.0 {
            Builder::Grids => "hierarchy of uniform grids, as in the paper",
            Builder::KdTree => "halves of space",
            Builder::GoldsmithSalmon => "boxes by insertion",
            Builder::Sah => "divisions by the surface area heuristic",
        }))
    }
}
