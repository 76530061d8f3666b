//! A model or an agent is trained, or a run is resumed. What trains is an entry of the registry, as it lies in crates above.

#[cfg(test)]
mod tests;
mod trainer;

use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json, json};
use swm_core::Registry;
use swm_core::settings::Settings as _;
use swm_data::OpenOptions;

use super::{Assignment, Fix, Message, Needs, Report, Request, TaskError, must_be_given, wrong};
use crate::threads;

pub use trainer::{Learns, Trained, TrainerEntry};

swm_core::settings! {
    /// Train a baseline on a dataset or an agent in an environment, or resume a run.
    pub struct Train {
        /// The baseline or agent.
        baseline: String = String::new() => "must be given, unless a run is resumed",
        /// The dataset that a baseline learns from, or tdmpc2 instead of an environment; of a resumed run only if it has moved.
        dataset: Option<PathBuf> = None => "none",
        /// How a dataset of another program is opened: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
        /// The run's folder.
        out: PathBuf = PathBuf::new() => "must be given, unless a run is resumed",
        /// Preset, such as paper or small.
        preset: Option<String> = None => "the first of the baseline or agent",
        /// Settings of the baseline or agent, by names with dots, such as `optim.lr`.
        set: Map<String, Json> = Map::new() => "none",
        /// A run to begin with: its model, with its settings and the weights of its last checkpoint, and how its vectors are scaled.
        from_run: Option<PathBuf> = None => "none",
        /// Weights of the encoder: a file (.safetensors, .pt, .ckpt), or a run.
        encoder: Option<PathBuf> = None => "none",
        /// Optimizer steps of the encoder that keypoint-wm trains first where none is given.
        encoder_steps: u64 = 1500,
        /// Resume the run in this folder, possibly with more epochs or steps.
        resume: Option<PathBuf> = None => "none",
        /// Epochs over the clips, in each phase.
        epochs: Option<u64> = None => "10, or the run's",
        /// Optimizer steps, in each phase; of an agent, steps of the environment.
        steps: Option<u64> = None => "as many as the epochs have; of an agent 100000",
        /// Clips per step.
        batch: Option<usize> = None => "the preset's",
        /// Device: cpu; in builds with the feature `cuda` also cuda, cuda:1 ….
        device: String = "cpu".to_owned() => "cpu",
        /// Precision of linear layers and attention: fp32, or bf16 with fp32 weights.
        precision: Option<String> = None => "fp32, or the run's",
        /// Seed of weights, order and noise.
        seed: Option<u64> = None => "42",
        /// Fraction of episodes for training; the others are for validation.
        split: f64 = 0.9,
        /// Fraction of episodes that is held out from both, for manifests with the same share held out.
        held_out: f64 = 0.0,
        /// Steps between logged metrics.
        log_every: Option<u64> = None => "20, of an agent 500; or the run's",
        /// Steps between validations and checkpoints.
        checkpoint_every: Option<u64> = None => "an epoch, or the run's",
        /// Checkpoints to keep in addition to the best.
        keep: Option<usize> = None => "3, or the run's",
        /// Batches from which batch-norm statistics are estimated anew before each validation and checkpoint, without dropout.
        norm_batches: Option<usize> = None => "0: those that training gathers",
        /// Measure the model every so many steps: probes, ranking of plans, open-loop error; 0: never.
        quality_every: Option<u64> = None => "0, or the run's",
        /// Early stopping: validations without improvement after which training stops; 0: never.
        patience: Option<u64> = None => "0, or the run's",
        /// Values of visual factors with which all images of a recording are rendered.
        look: Map<String, Json> = Map::new() => "those of the recording",
        /// Visual factors to sample for every clip, in each epoch anew: names, groups, `*.color`, or `visual` for all of them.
        vary: Vec<String> = Vec::new() => "none",
        /// Probability of each of these factors to be sampled for a clip.
        vary_share: f64 = 1.0,
        /// Probability of a clip to show none of these factors sampled.
        vary_usual: f64 = 0.0,
        /// Factors of the canonical look, which `canonical` learns to draw; without any, the recorded look.
        canonical: Option<Map<String, Json>> = None => "none",
        /// The environment that an agent learns in.
        env: Option<String> = None => "none",
        /// Settings of the environment, by name.
        env_option: Map<String, Json> = Map::new() => "none",
        /// Columns that an agent observes: vectors, and of tdmpc2 also pixels.
        observe: Vec<String> = Vec::new() => "observation, state or proprio, whichever is there; of a dataset its goal, too",
        /// Steps after which an episode of an agent is truncated.
        max_steps: Option<u64> = None => "500",
        /// Steps between evaluations of an agent, each with a checkpoint.
        eval_every: Option<u64> = None => "5000, or the run's",
        /// Episodes of an evaluation.
        eval_episodes: Option<u64> = None => "5, or the run's",
        /// Threads; results do not depend on it.
        threads: Option<usize> = None => "one per core",
    }
}

/// Settings that a run keeps from its beginning.
const OF_NEW_RUNS: &[&str] = &[
    "preset",
    "set",
    "from_run",
    "encoder",
    "encoder_steps",
    "batch",
    "seed",
    "split",
    "held_out",
    "norm_batches",
    "look",
    "vary",
    "vary_share",
    "vary_usual",
    "canonical",
    "env",
    "env_option",
    "observe",
    "max_steps",
];

/// From what a run learns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    /// Clips of a dataset.
    Clips,
    /// Episodes that an agent collects.
    Online,
    /// An agent from the steps of a dataset.
    Steps,
}

/// Settings that not every run takes: which do, and what takes its place in the others.
const NOT_OF_ALL: &[(&str, &[Way], Option<&str>)] = &[
    ("dataset", &[Way::Clips, Way::Steps], None),
    ("env", &[Way::Online], None),
    ("env_option", &[Way::Online], None),
    ("max_steps", &[Way::Online], None),
    ("observe", &[Way::Online, Way::Steps], None),
    ("eval_every", &[Way::Online], Some("checkpoint_every")),
    ("eval_episodes", &[Way::Online], None),
    ("checkpoint_every", &[Way::Clips, Way::Steps], Some("eval_every")),
    ("from_run", &[Way::Clips], None),
    ("encoder", &[Way::Clips], None),
    ("epochs", &[Way::Clips], Some("steps")),
    ("batch", &[Way::Clips], None),
    ("norm_batches", &[Way::Clips], None),
    ("quality_every", &[Way::Clips], None),
    ("patience", &[Way::Clips], None),
    ("precision", &[Way::Clips], None),
    ("split", &[Way::Clips], None),
    ("held_out", &[Way::Clips], None),
    ("look", &[Way::Clips], None),
    ("vary", &[Way::Clips], None),
    ("canonical", &[Way::Clips], None),
];

impl Request for Train {
    const NAME: &'static str = "train";
    type Outcome = Trained;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        self.trainer(registry).map(drop)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Trained, TaskError> {
        (self.trainer(registry)?.train)(self, registry, report)
    }
}

impl Train {
    /// The run's folder.
    pub fn folder(&self) -> &Path {
        self.resume.as_deref().unwrap_or(&self.out)
    }

    /// Settings of the baseline or agent as nested objects: `optim.lr` is `lr` in `optim`.
    ///
    /// # Errors
    ///
    /// [`TaskError::Request`]: a setting is a part of one that was set as a whole.
    pub fn changes(&self) -> Result<Json, TaskError> {
        let mut changes = Json::Object(Map::new());
        for (name, value) in &self.set {
            let mut place = &mut changes;
            for part in name.split('.') {
                let Json::Object(fields) = place else {
                    let setting = Some(Assignment::of("set", json!({ name: value })));
                    let text = format!("a part of `{name}` was set as a whole before");
                    return Err(Message { setting, text, fix: None }.into());
                };
                place = fields.entry(part.to_owned()).or_insert_with(|| Json::Object(Map::new()));
            }
            place.clone_from(value);
        }
        Ok(changes)
    }

    /// The files that it reads.
    pub(super) fn needs(&self, registry: &Registry) -> Result<Needs, TaskError> {
        self.check(registry)?;
        Ok(Needs {
            episodes: 0,
            inputs: self.dataset.iter().chain(&self.from_run).chain(&self.encoder).cloned().collect(),
        })
    }

    /// The same in this folder: a run that is there is resumed. The folder has its settings, but not what it is computed on.
    pub(super) fn in_folder(&self, run: PathBuf) -> Self {
        match run.join("config.json").is_file() {
            true => Self {
                resume: Some(run),
                device: self.device.clone(),
                threads: self.threads,
                ..Self::default()
            },
            false => Self { out: run, ..self.clone() },
        }
    }

    /// What trains, once nothing is wrong with the request.
    fn trainer(&self, registry: &Registry) -> Result<&'static TrainerEntry, TaskError> {
        let trainers = TrainerEntry::all(registry)?;
        threads::check(self.threads)?;
        let changed = self.changed();
        self.check_folder(&changed)?;
        let trainer = match (&self.resume, &self.from_run) {
            (Some(run), _) => TrainerEntry::of_run(&trainers, run)?,
            (None, Some(run)) if self.baseline.is_empty() => TrainerEntry::of_run(&trainers, run)?,
            (None, _) => TrainerEntry::named(&trainers, &self.baseline)?,
        };
        let way = match trainer.learns {
            Learns::FromClips => Way::Clips,
            Learns::OnlineOrFromSteps if self.dataset.is_some() && self.resume.is_none() => Way::Steps,
            Learns::Online | Learns::OnlineOrFromSteps => Way::Online,
        };
        self.check_source(trainer, way)?;
        self.check_taken(trainer, way, &changed)?;
        self.check_from(trainer, &trainers, &changed)?;
        self.check_opening()?;
        self.changes()?;
        if self.batch == Some(0) {
            let text = "a step learns from 1 clip or more; leave it out for the preset's";
            return Err(Message::about("batch", 0, text).into());
        }
        if let (Some(epochs), Some(_)) = (self.epochs, self.steps) {
            let message = Message::about("epochs", epochs, "the number of steps is given");
            return Err(message.fix(Fix::Any(vec![Fix::Leave("epochs"), Fix::Leave("steps")])).into());
        }
        for name in ["vary_share", "vary_usual"] {
            if changed.contains_key(name) && self.vary.is_empty() {
                let message = Message::about_setting(name, "is about factors that are sampled, and none are");
                return Err(message.fix(Fix::Any(vec![Fix::give("vary"), Fix::Leave(name)])).into());
            }
        }
        Ok(trainer)
    }

    /// Refuses a run without a name or a folder, and settings that a resumed one has already.
    fn check_folder(&self, changed: &Map<String, Json>) -> Result<(), TaskError> {
        let Some(run) = &self.resume else {
            must_be_given(&[("baseline", self.baseline.is_empty() && self.from_run.is_none())])?;
            if self.out.as_os_str().is_empty() {
                let resume = Fix::Set { setting: Assignment::name("resume"), to: "to continue one" };
                let message = Message::about_setting("out", "name the folder of the new run");
                return Err(message.fix(resume).into());
            }
            return Ok(());
        };
        let (name, text) = match OF_NEW_RUNS.iter().find(|name| changed.contains_key(**name)) {
            Some(&name) => (name, "a run is resumed with the settings that it was begun with"),
            None if !self.baseline.is_empty() => ("baseline", "a run is resumed with what it trains"),
            None if !self.out.as_os_str().is_empty() && self.out != *run => {
                ("out", "a run is resumed in its own folder")
            }
            None => return Ok(()),
        };
        Err(Message::about_setting(name, text).fix(Fix::Leave(name)).into())
    }

    /// Refuses a new run without what it learns from.
    fn check_source(&self, trainer: &TrainerEntry, way: Way) -> Result<(), TaskError> {
        let name = trainer.name;
        match way {
            _ if self.resume.is_some() => Ok(()),
            Way::Clips if self.dataset.is_none() => {
                let text = format!("name the dataset that {name} learns from");
                Err(Message::about_setting("dataset", text).into())
            }
            Way::Online if self.env.is_none() => {
                let mut fixes = vec![Fix::set("env", "swm/CartpoleDMControl-v0")];
                if trainer.learns == Learns::OnlineOrFromSteps {
                    fixes.push(Fix::give("dataset"));
                }
                let text = format!("{name} learns in an environment, and none is named");
                Err(Message::new(text).fix(Fix::Any(fixes)).into())
            }
            _ => Ok(()),
        }
    }

    /// Refuses settings that this run does not take.
    fn check_taken(
        &self,
        trainer: &TrainerEntry,
        way: Way,
        changed: &Map<String, Json>,
    ) -> Result<(), TaskError> {
        let may_have_moved = |name: &str| name == "dataset" && self.resume.is_some();
        let is_refused = |(name, ways, _): &&(&str, &[Way], Option<&str>)| {
            changed.contains_key(*name) && !ways.contains(&way) && !may_have_moved(name)
        };
        let Some(&(name, _, instead)) = NOT_OF_ALL.iter().find(is_refused) else { return Ok(()) };
        let how = match way {
            Way::Clips | Way::Steps => "learns from a dataset",
            Way::Online => "learns in an environment",
        };
        let mut fixes: Vec<Fix> = instead.map(Fix::give).into_iter().collect();
        if name == "batch" {
            fixes.push(Fix::set("set", json!({ "batch": self.batch })));
        }
        fixes.push(Fix::Leave(name));
        let message = Message::about_setting(name, format!("{} {how}, without this setting", trainer.name));
        Err(message.fix(Fix::Any(fixes)).into())
    }

    /// Refuses what a run that begins with another one has from it.
    fn check_from(
        &self,
        trainer: &TrainerEntry,
        trainers: &[&'static TrainerEntry],
        changed: &Map<String, Json>,
    ) -> Result<(), TaskError> {
        let Some(run) = &self.from_run else { return Ok(()) };
        for name in ["preset", "encoder", "encoder_steps"] {
            if changed.contains_key(name) {
                let message = Message::about_setting(name, "the run that it begins with has a model");
                return Err(message.fix(Fix::Any(vec![Fix::Leave(name), Fix::Leave("from_run")])).into());
            }
        }
        let began = TrainerEntry::of_run(trainers, run)?;
        if began.name != trainer.name {
            let text = format!("run {} trained {}, which is another model", run.display(), began.name);
            return Err(Message::about("baseline", trainer.name, text).fix(Fix::Leave("baseline")).into());
        }
        Ok(())
    }

    /// Refuses options of opening a dataset where none is opened with them.
    fn check_opening(&self) -> Result<(), TaskError> {
        self.opening.check().map_err(wrong)?;
        let Some(&option) = self.opening.given().first() else { return Ok(()) };
        // Two have the names of settings of the training.
        let option = match option {
            "split" => "dataset_split",
            "max_steps" => "dataset_max_steps",
            option => option,
        };
        let (text, mut fixes) = match () {
            () if self.resume.is_some() => {
                ("a run is resumed with the dataset as it was opened for it", Vec::new())
            }
            () if self.dataset.is_none() => {
                ("is about a dataset, and none is named", vec![Fix::give("dataset")])
            }
            () => return Ok(()),
        };
        fixes.push(Fix::Leave(option));
        Err(Message::about_setting(option, text).fix(Fix::Any(fixes)).into())
    }
}
