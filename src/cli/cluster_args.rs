//! How the clusters of a scene are built, for commands that build them.

use crate::clusters::Builder;
use clap::builder::PossibleValue;

/// The builder of the clusters.
#[derive(clap::Args, Clone, Debug)]
pub struct ClusterArgs {
    /// Algorithm that builds the clusters.
    #[arg(long, value_enum, default_value = Builder::default().name())]
    pub builder: Builder,
}

impl clap::ValueEnum for Builder {
    fn value_variants<'a>() -> &'a [Builder] {
        &Builder::ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.name()).help(match self {
            Builder::Grids => "hierarchy of uniform grids, as in the paper",
            Builder::KdTree => "halves of space",
            Builder::GoldsmithSalmon => "boxes by insertion",
            Builder::Sah => "divisions by the surface area heuristic",
        }))
    }
}
