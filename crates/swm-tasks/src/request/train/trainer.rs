//! What trains: entries of the registry, which crates with models supply.

use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};
use serde_json::Value as Json;
use swm_core::Registry;
use swm_core::error::{did_you_mean, nearest};
use swm_core::registry::Entry;

use super::Train;
use crate::request::{Report, TaskError, wrong};

/// What trains one kind of model or agent.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct TrainerEntry {
    /// The baseline or agent.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// Its presets, the default first.
    pub presets: &'static [&'static str],
    /// From what it learns.
    pub learns: Learns,
    /// The name of the trainer that began the run in a folder.
    pub began: fn(&Path) -> Result<String, TaskError>,
    /// Trains as a request that was checked asks for.
    pub train: fn(&Train, &Registry, &mut dyn Report) -> Result<Trained, TaskError>,
}

/// From what a model or agent learns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Learns {
    /// From clips of a dataset.
    FromClips,
    /// An agent, from episodes that it collects in an environment.
    Online,
    /// An agent, from episodes that it collects, or from the steps of a dataset.
    OnlineOrFromSteps,
}

/// Where a training ended.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Trained {
    /// The run's folder.
    pub run: PathBuf,
    /// Names and values for people.
    pub summary: Vec<(&'static str, String)>,
    /// The state of the last checkpoint, which is the JSON form of this.
    pub state: Json,
}

impl Trained {
    /// Where the training in `run` ended.
    pub fn new(run: &Path, summary: Vec<(&'static str, String)>, state: Json) -> Self {
        Self { run: run.to_owned(), summary, state }
    }
}

impl Serialize for Trained {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.state.serialize(serializer)
    }
}

impl Entry for TrainerEntry {
    const KIND: &'static str = "baseline or agent";
    const COMMAND: &'static str = "train --list";

    fn name(&self) -> &'static str {
        self.name
    }
}

impl TrainerEntry {
    /// What a program without any trainer lacks, by the name of an absent entry.
    pub const TRAINING: &'static str = "training";

    /// A trainer.
    pub const fn new(
        name: &'static str,
        about: &'static str,
        presets: &'static [&'static str],
        learns: Learns,
        began: fn(&Path) -> Result<String, TaskError>,
        train: fn(&Train, &Registry, &mut dyn Report) -> Result<Trained, TaskError>,
    ) -> Self {
        Self { name, about, presets, learns, began, train }
    }

    /// All trainers.
    ///
    /// # Errors
    ///
    /// [`TaskError::Request`]: there are none, as of a build without training.
    pub fn all(registry: &Registry) -> Result<Vec<&'static Self>, TaskError> {
        let trainers: Vec<&'static Self> = registry.all().collect();
        if trainers.is_empty() {
            let brings = registry.find::<Self>(Self::TRAINING).err().and_then(|unknown| unknown.fix);
            return Err(wrong(brings.unwrap_or_else(|| "this program has nothing that trains".to_owned())));
        }
        Ok(trainers)
    }

    /// That of this name.
    pub(super) fn named(trainers: &[&'static Self], name: &str) -> Result<&'static Self, TaskError> {
        trainers.iter().find(|trainer| trainer.name == name).copied().ok_or_else(|| {
            let names: Vec<&str> = trainers.iter().map(|trainer| trainer.name).collect();
            let meant = did_you_mean(nearest(name, names.iter().copied()).as_deref());
            wrong(format!("unknown {} `{name}`{meant}; there are: {}", Self::KIND, names.join(", ")))
        })
    }

    /// That which began the run in a folder.
    pub(super) fn of_run(trainers: &[&'static Self], run: &Path) -> Result<&'static Self, TaskError> {
        let mut unknown = String::new();
        for trainer in trainers {
            unknown = (trainer.began)(run)?;
            if unknown == trainer.name {
                return Ok(trainer);
            }
        }
        Err(wrong(format!("run {}: it trained `{unknown}`, which this program cannot train", run.display())))
    }
}
