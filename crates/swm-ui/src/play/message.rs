//! What the page asks of a live environment.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::{Map, Value as Json};

/// One message of the page.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum Command {
    /// Makes an environment, in place of the last one.
    Open(Open),
    /// Begins an episode.
    Reset(Reset),
    /// Steps at the chosen rate, or stops doing so.
    Play { on: bool },
    /// Steps once.
    Step,
    /// Steps per second.
    Rate { hz: f64 },
    /// Actions by hand, `[A]`, until the next such message.
    Action { values: Vec<f64> },
    /// Where the pointer is, as fractions of the image's width and height; the agent follows it.
    Pointer { at: Option<[f64; 2]> },
    /// Who acts: a policy as on a command line, or nobody: then actions are those by hand.
    Policy { text: Option<String> },
    /// Goes back to a step of this episode.
    Rewind { step: u64 },
    /// Columns to plot.
    Watch { columns: Vec<String> },
    /// Records the episodes to come into a file of the folder that `--save` names.
    Record { file: String, format: Option<String>, image: Option<usize> },
    /// Ends this episode here, and keeps it.
    Keep,
    /// Drops the last kept episode, which is not in the file before the next one is kept.
    Undo,
    /// Ends the recording.
    StopRecording,
    /// Asks for the episode up to here as a video.
    Video,
    /// The page has shown a frame.
    Shown,
}

/// How an environment is made.
#[derive(Clone, Debug, Deserialize)]
pub(super) struct Open {
    pub env: String,
    #[serde(default)]
    pub settings: Map<String, Json>,
    /// Side of the image.
    pub image: usize,
    /// Steps after which an episode ends.
    pub max_steps: Option<u64>,
    /// A pair of start and goal of a manifest or a receipt, in place of a reset of the environment's own.
    #[serde(default)]
    pub pair: Option<Pair>,
    #[serde(flatten)]
    pub reset: Reset,
}

/// One pair of a file of results.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Pair {
    pub id: String,
    pub index: usize,
    /// Who acts in it.
    #[serde(default)]
    pub run: Run,
}

/// One of the policies of a file of results.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Run {
    /// That of the receipt; nobody in a manifest.
    #[default]
    Policy,
    /// A reference policy of the receipt.
    Reference(usize),
    /// The planner on the true dynamics that the policy is compared with, whether or not the receipt holds it.
    Oracle,
}

/// How an episode begins.
#[derive(Clone, Debug, Default, Deserialize)]
pub(super) struct Reset {
    /// The run's seed; none: as before.
    #[serde(default)]
    pub seed: Option<u64>,
    /// The episode of the run; none: the first one after another seed, else the same one again.
    #[serde(default)]
    pub episode: Option<u64>,
    /// Factors to sample; none: the environment's default list.
    #[serde(default)]
    pub vary: Option<Vec<String>>,
    /// Factors to set.
    #[serde(default)]
    pub set: BTreeMap<String, Json>,
}
