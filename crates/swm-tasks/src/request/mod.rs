//! Requests: what a user asks for is one value that is checked and run, from whatever program it comes.
//!
//! A request is a flat struct of settings, so that it has a default, a reader and a JSON form ([`Settings`]). What is wrong
//! with it is a value too: a [`TaskError`] has the setting, the reason and the remedy, and a front end words them in its own
//! syntax ([`Words`]): the command as options, Python as keyword arguments.

mod bench;
mod board;
mod bundle;
mod clear;
mod copies;
mod defaults;
mod diff;
mod divided;
mod entrant;
mod evaluate;
mod image_choice;
mod inspect;
mod make_manifest;
mod measure;
mod message;
mod plan;
mod policy;
mod preview;
mod record;
mod render;
mod replay;
mod report;
mod scenario;
mod selection;
mod shard;
mod source;
mod stats;
mod stream;
mod sweep;
mod train;
mod training_note;
mod verify;

use serde_json::{Map, Value as Json};
use swm_core::Registry;
use swm_core::settings::{Settings, read_of};

pub(crate) use crate::error::wrong;
pub use crate::error::{FileError, TaskError, cannot};
pub use bench::{Bench, Throughput};
pub use board::{BoardMade, MakeBoard};
pub use bundle::{Bundled, MakeBundle};
pub use copies::{Convert, CopyOptions, DatasetCopy, Merge, Parts, Split, holds_images};
pub use defaults::{MAX_STEPS, NUM_ENVS, envs_at_most};
pub use diff::Diff;
pub use divided::{Divided, DividedKind, Needs};
pub use entrant::{Foreign, RunOn, verify_foreign};
pub use evaluate::{Evaluate, Evaluated};
pub use image_choice::ImageChoice;
pub use inspect::{Extremes, Inspect, Inspection, RecordingRun};
pub use make_manifest::{BUDGET_DATASET, BUDGET_ONLINE, MakeManifest, note_rewards_only};
pub use measure::Measure;
pub use message::{Assignment, Fix, List, Message, Plain, Words, value_text};
pub use plan::{Plan, Planned};
pub use policy::{make_policy, model_image, note_elites, note_images, policy_args, policy_files};
pub use preview::{Preview, PreviewMade};
pub use record::{Count, Record, Recorded};
pub use render::{EpisodeImages, Render};
pub use replay::Replay;
pub use report::{Figures, Progress, Report, Stage, apart};
pub use scenario::{Scenario, factor_values, look_of};
pub use shard::Shard;
pub use source::{
    ManifestSource, check_opening, check_recorded_in, create_parent, make_folder, open_dataset,
    open_dataset_with,
};
pub use stats::Stats;
pub use sweep::{Sweep, Swept};
pub use train::{Learns, Train, Trained, TrainerEntry};
pub use training_note::{Ask, note_training, note_training_of, note_training_on};
pub use verify::{Verified, Verify};

/// A request that can be checked and run.
pub trait Request: Settings {
    /// Its name: `make_manifest`.
    const NAME: &'static str;
    /// What comes out.
    type Outcome;

    /// Finds what is wrong with it before anything is read at length or written.
    ///
    /// # Errors
    ///
    /// [`TaskError::Request`]: a setting is out of bounds, or two of them do not go together.
    fn check(&self, registry: &Registry) -> Result<(), TaskError>;

    /// Checks it, and does what is asked for.
    ///
    /// # Errors
    ///
    /// As of [`Request::check`]; another [`TaskError`]: what the work itself met.
    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Self::Outcome, TaskError>;

    /// Reads a request from JSON; what is not given has its default.
    ///
    /// # Errors
    ///
    /// [`TaskError::Request`]: a setting is unknown, or not what it must be.
    fn from_json(given: &Map<String, Json>) -> Result<Self, TaskError> {
        read_of(given, Self::SETTINGS).map_err(|wrong| {
            let value = given.get(&wrong.name).cloned();
            let setting = Some(Assignment { name: wrong.name, value });
            Message { setting, text: wrong.reason, fix: None }.into()
        })
    }
}

/// Refuses a largest accepted difference that no difference can have.
fn check_tolerance(tolerance: f64) -> Result<(), TaskError> {
    if tolerance >= 0.0 {
        return Ok(());
    }
    // JSON has no NaN.
    let value =
        serde_json::Number::from_f64(tolerance).map_or_else(|| tolerance.to_string().into(), Json::Number);
    Err(Message::about("tolerance", value, "use a number of 0 or more").into())
}

/// Refuses a request that lacks one of these settings, each with whether it is missing.
pub(crate) fn must_be_given(settings: &[(&str, bool)]) -> Result<(), TaskError> {
    settings.iter().find(|(_, is_missing)| *is_missing).map_or(Ok(()), |(name, _)| {
        let setting = Some(Assignment::name(*name));
        Err(Message { setting, text: "must be given".to_owned(), fix: None }.into())
    })
}
