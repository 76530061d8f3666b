//! Looks of clips: which visual factors are sampled, and how often.

use std::collections::BTreeMap;

use rand::RngExt as _;
use serde::{Deserialize, Serialize};
use swm_core::env::nearest_factor;
use swm_core::error::did_you_mean;
use swm_core::seed::keyed;
use swm_core::{EnvSpec, FactorSpec, Value};

/// Looks of clips: a loader samples visual factors for every clip, anew in every epoch. Which look a clip gets depends on the seed,
/// the epoch and the clip alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct Looks {
    /// Factors to sample: names, groups, `*.color`, or `visual` for all that the environment declares visual. Others are errors.
    pub vary: Vec<String>,
    /// The probability of each of these factors to be sampled for a clip; else it has its usual value.
    pub share: f64,
    /// The probability of a clip to show the usual values of all of them.
    pub usual: f64,
    /// The seed of the looks.
    pub seed: u64,
}

setters!(Looks {
    vary: Vec<String>,
    share: f64,
    usual: f64,
    seed: u64,
});

impl Default for Looks {
    /// No factor; of those that are named, all are sampled for every clip; seed 0.
    fn default() -> Self {
        Self { vary: Vec::new(), share: 1.0, usual: 0.0, seed: 0 }
    }
}

/// Samples looks of one environment.
#[derive(Clone, Debug)]
pub(super) struct LookSampler {
    factors: Vec<FactorSpec>,
    share: f64,
    usual: f64,
    seed: u64,
}

impl LookSampler {
    /// Checks the looks for an environment; the reason where it has none of them.
    pub(super) fn new(looks: &Looks, spec: &EnvSpec) -> Result<Self, String> {
        for (name, share) in [("share", looks.share), ("usual", looks.usual)] {
            if !(0.0..=1.0).contains(&share) {
                return Err(format!("looks.{name} is {share}; use a probability from 0 to 1"));
            }
        }
        let is_asked = |factor: &FactorSpec| {
            let selects = |asked: &String| factor.is_selected_by(asked) || (asked == VISUAL && factor.visual);
            looks.vary.iter().any(selects)
        };
        for asked in &looks.vary {
            let mut selected = spec.factors.iter().filter(|factor| factor.is_selected_by(asked)).peekable();
            if asked == VISUAL && spec.factors.iter().any(|factor| factor.visual) {
                continue;
            }
            if selected.peek().is_none() {
                let near = nearest_factor(asked, spec.factors.iter().map(|factor| factor.name.as_str()));
                let hint = did_you_mean(near.as_deref());
                return Err(format!("`{}` has no factor `{asked}`{hint}", spec.id));
            }
            if let Some(other) = selected.find(|factor| !factor.visual) {
                return Err(not_visual(spec, &other.name));
            }
        }
        let factors = spec.factors.iter().filter(|factor| is_asked(factor)).cloned().collect();
        Ok(Self { factors, share: looks.share, usual: looks.usual, seed: looks.seed })
    }

    /// The factors that it samples.
    pub(super) fn factors(&self) -> impl Iterator<Item = &FactorSpec> {
        self.factors.iter()
    }

    /// The factors that a clip does not show with their usual values. Each has a stream of its own: one more factor changes no other.
    pub(super) fn look(&self, key: [u64; 2]) -> BTreeMap<String, Value> {
        if keyed(self.seed, "looks", key).random::<f64>() < self.usual {
            return BTreeMap::new();
        }
        let sampled = self.factors.iter().filter_map(|factor| {
            let mut stream = keyed(self.seed, &format!("look {}", factor.name), key);
            let is_sampled = stream.random::<f64>() < self.share;
            is_sampled.then(|| (factor.name.clone(), factor.space.sample(&mut stream)))
        });
        sampled.collect()
    }
}

/// All visual factors, as a name in [`Looks::vary`].
const VISUAL: &str = "visual";

/// Why a factor cannot be in a look.
pub(super) fn not_visual(spec: &EnvSpec, name: &str) -> String {
    let visual: Vec<&str> =
        spec.factors.iter().filter(|factor| factor.visual).map(|factor| factor.name.as_str()).collect();
    let fix = match visual.as_slice() {
        [] => "it has no factors that do; record with other values instead".to_owned(),
        names => {
            format!("those that do are {}; record with other values of this one instead", names.join(", "))
        }
    };
    format!(
        "factor `{name}` of `{}` does not change images alone, so that a recorded state cannot be shown with another value; \
             {fix}",
        spec.id
    )
}
