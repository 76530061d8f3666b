//! The trainers of the registry: a request [`Train`](swm_tasks::request::Train) at work.
//!
//! | file | duty |
//! |---|---|
//! | `clips` | baselines, on clips of a dataset |
//! | `agents` | agents, in environments or on the steps of a dataset |
//! | `looks`, `quality` | images that are rendered anew; measurements on the way |
//! | `memory`, `shown` | what a training takes of memory; its progress |

mod agents;
mod clips;
mod looks;
mod memory;
mod quality;
mod shown;

use std::path::Path;

use swm_core::WorldError;
use swm_tasks::request::{Learns, Message, TaskError, TrainerEntry};

use crate::error::BaselineError;
use crate::models::table::BASELINES;
use crate::online::{AGENTS, online_agent};
use crate::train::{RunConfig, RunFolder};

pub use shown::short;

/// All trainers: those of baselines, then those of agents.
pub const TRAINERS: &[TrainerEntry] = &TABLE;

const TABLE: [TrainerEntry; BASELINES.len() + AGENTS.len()] = {
    let none = TrainerEntry::new("", "", &[], Learns::FromClips, began, clips::train);
    let mut table = [none; BASELINES.len() + AGENTS.len()];
    let mut at = 0;
    while at < BASELINES.len() {
        let of = &BASELINES[at];
        table[at] = TrainerEntry::new(of.name, of.about, of.presets, Learns::FromClips, began, clips::train);
        at += 1;
    }
    while at < table.len() {
        let of = &AGENTS[at - BASELINES.len()];
        let learns = if of.learns_from_datasets { Learns::OnlineOrFromSteps } else { Learns::Online };
        table[at] = TrainerEntry::new(of.name, of.about, of.presets, learns, began, agents::train);
        at += 1;
    }
    table
};

/// The baseline or agent that a run trains.
fn began(run: &Path) -> Result<String, TaskError> {
    let name = |run: &Path| {
        let run = RunFolder::open(run)?;
        match online_agent(&run)? {
            Some(agent) => Ok(agent),
            None => Ok(RunConfig::read(&run)?.model_config.baseline),
        }
    };
    name(run).map_err(failed)
}

/// The error of a request: wrong settings and folders are wrong requests.
pub fn failed(error: BaselineError) -> TaskError {
    match error {
        BaselineError::UnknownBaseline { .. }
        | BaselineError::UnknownPreset { .. }
        | BaselineError::Settings { .. }
        | BaselineError::Training { .. }
        | BaselineError::Columns { .. }
        | BaselineError::Device { .. }
        | BaselineError::Run { .. } => Message::new(error.to_string()).into(),
        BaselineError::World(error) => error.into(),
        BaselineError::Dataset(error) => error.into(),
        error => TaskError::Failed(error.into()),
    }
}

/// The error of a training that was asked to stop.
fn interrupted() -> TaskError {
    WorldError::Cancelled.into()
}

#[cfg(test)]
mod tests {
    use swm_core::settings::Settings as _;
    use swm_tasks::request::Train;

    use crate::online::OnlineSettings;
    use crate::train::FitSettings;

    #[test]
    fn the_request_names_the_defaults_of_trainings() {
        let (fit, online) = (FitSettings::default(), OnlineSettings::default());
        let default = |name: &str| {
            let setting = Train::SETTINGS.iter().find(|setting| setting.name == name);
            setting.unwrap_or_else(|| panic!("no setting {name}")).default
        };
        for (name, value) in [
            ("epochs", fit.epochs),
            ("seed", fit.seed),
            ("seed", online.seed),
            ("keep", fit.keep as u64),
            ("keep", online.keep as u64),
            ("norm_batches", fit.norm_batches as u64),
            ("quality_every", fit.quality_every),
            ("patience", fit.patience),
            ("max_steps", online.max_episode_steps),
            ("eval_every", online.eval_every),
            ("eval_episodes", online.eval_episodes),
        ] {
            assert_eq!(default(name).split([',', ':']).next(), Some(value.to_string().as_str()), "{name}");
        }
        let logs = format!("{}, of an agent {}; or the run's", fit.log_every, online.log_every);
        assert_eq!(default("log_every"), logs);
        assert!(default("steps").ends_with(&format!("of an agent {}", online.steps)));
    }
}
