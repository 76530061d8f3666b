//! Looks of recordings: which visual factors are set or sampled where images are rendered when they are read.

use clap::Args;
use serde_json::{Map, Value as Json, json};

use super::args::assignments;
use super::{Failure, usage};

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

impl LookArgs {
    /// The factors of the canonical look; none of them: that of the recording.
    pub(super) fn canonical_look(&self) -> Result<Option<Map<String, Json>>, Failure> {
        let recorded = self.canonical.iter().any(|given| given == "recorded");
        match &self.canonical[..] {
            [] => Ok(None),
            [_] if recorded => Ok(Some(Map::new())),
            _ if recorded => Err(usage("--canonical recorded stands alone: it is the recorded look")),
            given => assignments(given, "--canonical", |text| json!(text)).map(Some),
        }
    }
}
