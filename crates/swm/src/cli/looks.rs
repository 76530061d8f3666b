//! Looks of recordings: which visual factors are set or sampled where images are rendered when they are read.

use clap::Args;
#[cfg(feature = "baselines")]
use {
    super::args::assignment,
    super::{Failure, Output, usage},
    serde_json::{Map, Value as Json},
    std::collections::BTreeMap,
    swm_core::{Registry, Value},
    swm_data::Dataset,
    swm_tasks::request::{self, TaskError},
};

/// How the images of a training are rendered.
#[derive(Args, Clone)]
#[command(next_help_heading = "Looks of a recording of this program")]
pub(super) struct LookArgs {
    /// Render all images with this value of a visual factor, `NAME=VALUE`, such as `background.color=black`; may be repeated.
    #[arg(long, value_name = "NAME=VALUE", conflicts_with = "resume")]
    pub(super) look: Vec<String>,
    /// Visual factors to sample for every clip, in each epoch anew: names, groups, `*.color`, or `visual` for all of them, separated
    /// by commas.
    #[arg(long, value_name = "NAMES", value_delimiter = ',', conflicts_with = "resume")]
    pub(super) vary: Vec<String>,
    /// Probability of each of these factors to be sampled for a clip; else it is as in the recording or --look.
    #[arg(long, value_name = "P", default_value_t = 1.0, requires = "vary")]
    pub(super) vary_share: f64,
    /// Probability of a clip to show none of these factors sampled.
    #[arg(long, value_name = "P", default_value_t = 0.0, requires = "vary")]
    pub(super) vary_usual: f64,
    /// A factor of the canonical look, `NAME=VALUE`, which `canonical` learns to draw; may be repeated. `recorded`: the recorded look.
    #[arg(long, value_name = "NAME=VALUE", conflicts_with = "resume")]
    pub(super) canonical: Vec<String>,
}

#[cfg(feature = "baselines")]
impl LookArgs {
    /// How images of a dataset are rendered; `seed` is that of the looks.
    pub(super) fn looks(
        &self,
        dataset: &dyn Dataset,
        registry: &Registry,
        seed: u64,
        output: &Output,
    ) -> Result<swm_baselines::train::ImageLooks, Failure> {
        let looks = swm_baselines::train::ImageLooks::new();
        if self.look.is_empty() && self.vary.is_empty() && self.canonical.is_empty() {
            return Ok(looks);
        }
        let values = |option, given: &[String]| values(dataset, registry, (option, given), output);
        let recorded = self.canonical.iter().any(|given| given == "recorded");
        let canonical = match &self.canonical[..] {
            [] => None,
            [_] if recorded => Some(BTreeMap::new()),
            _ if recorded => return Err(usage("--canonical recorded stands alone: it is the recorded look")),
            given => Some(values("--canonical", given)?),
        };
        let names: Vec<String> = self.vary.iter().map(|name| name.trim().to_owned()).collect();
        let vary =
            swm_data::Looks::default().vary(names).share(self.vary_share).usual(self.vary_usual).seed(seed);
        let vary = (!self.vary.is_empty()).then_some(vary);
        Ok(looks.set(&values("--look", &self.look)?).vary(vary).canonical(canonical.as_ref()))
    }
}

/// The values of an option `NAME=VALUE` that is about factors of the environment of a recording.
#[cfg(feature = "baselines")]
fn values(
    dataset: &dyn Dataset,
    registry: &Registry,
    (option, given): (&str, &[String]),
    output: &Output,
) -> Result<BTreeMap<String, Value>, Failure> {
    if given.is_empty() {
        return Ok(BTreeMap::new());
    }
    let mut set = Map::new();
    for one in given {
        let (name, text) = assignment(one, option)?;
        set.insert(name.to_owned(), Json::from(text));
    }
    request::look_of(dataset, registry, &set, &mut &*output).map_err(|error| match error {
        TaskError::Request(message) => usage(format!("{option}: {}", message.text)),
        error => error.into(),
    })
}
