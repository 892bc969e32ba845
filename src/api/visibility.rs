//! Visibility of a model: which engine answers.

use crate::model::Model;
use crate::visibility::{Exact, MultiResolution};
use crate::{Error, Result};

/// How visibility is answered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Engine {
    /// Exact or multi-resolution, whichever is expected to take less time: multi-resolution only where a feature size is given, the model holds
    /// optics, and a sample of the bundles says that it takes clearly less time. Solutions take exact rays: most of theirs are incoherent,
    /// and multi-resolution was measured to take longer (`docs/light.md`).
    #[default]
    Automatic,
    /// One Embree ray a segment, 0 or 1.
    Exact,
    /// Clusters whose shadows have no features of the feature size or larger are averaged by their extinction; the rest is tested
    /// exactly. Needs a feature size and a model with optics.
    MultiResolution,
    /// Extinction only: an estimate without any ray. Needs a feature size and a model with optics.
    Average,
}

/// Visibility of a model: the fraction of light between points that gets through.
///
/// Made by [`Model::visibility`]; cheap to make and to clone. The first multi-resolution query estimates the cost of exact rays
/// in this model once (milliseconds). The first single query to a source makes the tree of the distance cut and measures where it pays
/// (seconds for a million triangles), and decides whether to use it (milliseconds, once for each power of two of feature size and number
/// of segments); the model keeps all that.
#[derive(Clone)]
pub struct Visibility {
    pub(super) model: Model,
    pub(super) engine: Engine,
}

impl Model {
    /// Visibility in this model, with [`Engine::Automatic`].
    pub fn visibility(&self) -> Visibility {
        Visibility { model: self.clone(), engine: Engine::Automatic }
    }
}

impl Visibility {
    /// The same with another engine.
    #[must_use]
    pub fn with_engine(mut self, engine: Engine) -> Visibility {
        self.engine = engine;
        self
    }

    /// The engine that answers. `sized` says whether there is a feature size.
    pub(super) fn chosen(&self, sized: bool) -> Result<Chosen> {
        let need = |engine: Option<MultiResolution>, name: &str| {
            if !sized {
                let problem = format!("the engine ⟨Engine::{name}⟩ needs one, a length above 0");
                return Err(Error::argument("feature_size", "", problem));
            }
            self.model.check_clusters(name)?;
            engine.ok_or_else(|| {
                let cure = "prepare the model with ⟨Detail::Optics⟩";
                Error::argument("engine", format!("⟨Engine::{name}⟩"), "needs optics").with_cure(cure)
            })
        };
        let multi_resolution = || self.model.multi_resolution().cloned();
        match self.engine {
            Engine::Exact => Ok(Chosen::Exact(self.model.exact())),
            Engine::MultiResolution => need(multi_resolution(), "MultiResolution").map(Chosen::Clusters),
            Engine::Average => need(self.model.average(), "Average").map(Chosen::Clusters),
            Engine::Automatic => Ok(match multi_resolution().filter(|_| sized) {
                Some(engine) => Chosen::Either(engine),
                None => Chosen::Exact(self.model.exact()),
            }),
        }
    }
}

/// An engine for a batch.
pub(super) enum Chosen {
    Exact(Exact),
    /// Multi-resolution or average.
    Clusters(MultiResolution),
    /// Multi-resolution where it pays, else exact.
    Either(MultiResolution),
}
