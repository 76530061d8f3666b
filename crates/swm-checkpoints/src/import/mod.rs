//! Published checkpoints as runs: of stable-worldmodel (folders of `save_pretrained`, files of Lightning, pickled modules), and of the
//! authors of DINO-WM.
//!
//! | file | duty |
//! |---|---|
//! | `source`, `cache`, `yaml` | which files, and what stands in a config |
//! | `config` | a config by name; nothing in it is executed |
//! | `shapes`, `recipe`, `joint`, `tokens`, `tdmpc2` | settings of ours |
//! | `scales` | what no file says: how vectors were scaled |
//! | `notes` | what an export of this program notes of it |
//! | `place`, `load` | model, environment and scales put together |
//!
//! What is missing, such as the scale of actions, is asked for and never guessed.

mod cache;
mod config;
mod joint;
mod load;
mod notes;
mod place;
mod recipe;
mod scales;
mod shapes;
mod source;
mod tdmpc2;
#[cfg(test)]
mod tests;
mod tokens;
mod yaml;

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Map, Value as Json};
use swm_baselines::BaselineError;
use swm_baselines::online::{OnlineConfig, OnlineState};
use swm_baselines::train::{RunFolder, Scale, State};
use swm_core::Registry;
use swm_data::OpenOptions;
use swm_tasks::request::{Fix, Message, Report, Request, TaskError};

pub use load::Loaded;
pub use yaml::read_yaml;

swm_core::settings! {
    /// Make a run of a checkpoint that stable-worldmodel or the authors of DINO-WM published.
    pub struct Import {
        /// Its folder, its file of weights, or hf:USER/REPO in a local cache.
        from: String = String::new() => "must be given",
        /// What it is, where no file says so: lewm, pldm, dino-wm, gcbc, gciql, gcivl, hilp or tdmpc2.
        kind: Option<String> = None => "as its config says",
        /// Of several files of weights in the folder, this one.
        file: Option<String> = None => "the only one",
        /// A file with the weights of its frozen encoder, where it has them not itself.
        encoder: Option<PathBuf> = None => "none",
        /// The environment's id.
        env: Option<String> = None => "the dataset's",
        /// Settings of the environment, by name.
        env_option: Map<String, Json> = Map::new() => "none",
        /// The dataset that it was trained on: it says how vectors were scaled, and which environment it is.
        dataset: Option<PathBuf> = None => "none",
        /// How it is opened, where it is of another program: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
        /// A file of statistics in place of a dataset, such as `swm stats` writes.
        stats: Option<PathBuf> = None => "none",
        /// Means of actions.
        action_mean: Option<Vec<f64>> = None => "the dataset's",
        /// Stds of actions.
        action_std: Option<Vec<f64>> = None => "the dataset's",
        /// Means of `proprio`, or of the vector that an agent observes.
        proprio_mean: Option<Vec<f64>> = None => "the dataset's",
        /// Stds of the same.
        proprio_std: Option<Vec<f64>> = None => "the dataset's",
        /// Side of its images in pixels.
        image: Option<usize> = None => "as its files say",
        /// Settings of the model, by name, such as `model.encoder.heads`.
        set: Map<String, Json> = Map::new() => "none",
        /// The run's folder.
        out: PathBuf = PathBuf::new() => "must be given",
        /// Read and describe it, and write nothing.
        check_only: bool = false,
    }
}

/// What a checkpoint is.
#[derive(Clone, Debug, Default, Serialize)]
#[non_exhaustive]
pub struct Description {
    /// The model: a baseline, or an agent.
    pub model: String,
    /// Tensors of the model that are in the file, and all that it has.
    pub tensors: [usize; 2],
    /// The container: `zip`, `legacy`, `tar`, `pickle`, `safetensors`; empty without weights.
    pub format: String,
    /// Whose names the encoder's tensors have.
    pub names: String,
    /// The side of its images.
    pub image: usize,
    /// D: values of a block of actions.
    pub block: usize,
    /// F: actions of a block, where the environment or a file says it.
    pub frameskip: Option<usize>,
    /// How many observations it sees.
    pub history: usize,
    /// The environment.
    pub env: Option<String>,
    /// How each vector is scaled, and where that is from.
    pub scales: Vec<(String, Scale, String)>,
    /// SHA-256 of the file of weights.
    pub sha256: Option<String>,
    /// A published checkpoint with these weights.
    pub known: Option<String>,
    /// Tensors that the file lacks, which neither plans nor actions need.
    pub lacks: Vec<String>,
    /// Objects in the file that were passed over, and functions that Python would call if it loaded it.
    pub ignored: Vec<String>,
    /// What must still be given to make a run of it.
    pub missing: Vec<Message>,
    /// All settings of the model.
    pub settings: Json,
    /// The run that was made.
    pub run: Option<PathBuf>,
}

impl Request for Import {
    const NAME: &'static str = "import";
    type Outcome = Description;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        if self.from.is_empty() {
            return Err(Message::new("a checkpoint to import must be named")
                .fix(source::give("from", ""))
                .into());
        }
        if self.out.as_os_str().is_empty() && !self.check_only {
            let fixes = vec![source::give("out", ""), Fix::set("check_only", true)];
            return Err(Message::new("a folder for the run must be named").fix(Fix::Any(fixes)).into());
        }
        let pairs = [
            ("action_mean", self.action_mean.is_some(), "action_std", self.action_std.is_some()),
            ("proprio_mean", self.proprio_mean.is_some(), "proprio_std", self.proprio_std.is_some()),
        ];
        for (mean, has_mean, std, has_std) in pairs {
            if has_mean != has_std {
                let (has, lacks) = if has_mean { (mean, std) } else { (std, mean) };
                return Err(Message::new(format!("{has} alone scales nothing"))
                    .fix(source::give(lacks, ""))
                    .into());
            }
        }
        if let Some(env) = &self.env {
            registry.env(env).map_err(|error| Message::new(error.to_string()))?;
        }
        if let Some(kind) = &self.kind
            && !config::KNOWN.contains(&kind.as_str())
        {
            let known = config::KNOWN.map(str::to_owned).to_vec();
            return Err(Message::about("kind", kind.clone(), "is no model that this program has")
                .fix(Fix::Choose(known))
                .into());
        }
        Ok(())
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Description, TaskError> {
        self.check(registry)?;
        let (mut description, loaded) = load::load(self, registry)?;
        for ignored in &description.ignored {
            report.note(&Message::new(ignored.clone()));
        }
        let Some(loaded) = loaded.filter(|_| !self.check_only) else { return Ok(description) };
        self.write(loaded)?;
        description.run = Some(self.out.clone());
        Ok(description)
    }
}

impl Import {
    /// The model of the checkpoint, for use without a run.
    ///
    /// # Errors
    ///
    /// As of [`Request::run`].
    pub fn load(&self, registry: &Registry) -> Result<Loaded, TaskError> {
        // Nothing is written, so no folder has to be named.
        Self { check_only: true, ..self.clone() }.check(registry)?;
        let request = Self { check_only: false, ..self.clone() };
        let (_, loaded) = load::load(&request, registry)?;
        Ok(loaded.expect("a model that is not checked alone is loaded or an error"))
    }

    /// What the checkpoint is, and what must still be given; nothing is written.
    pub(crate) fn describe(&self, registry: &Registry) -> Result<Description, TaskError> {
        let request = Self { check_only: true, ..self.clone() };
        Ok(load::load(&request, registry)?.0)
    }

    /// What an export of this program notes.
    pub(crate) fn noted(&self) -> Option<Json> {
        source::find(&self.from, self.file.as_deref()).ok()?.notes
    }

    /// The files of the checkpoint.
    pub(crate) fn files(&self) -> Result<Vec<PathBuf>, TaskError> {
        Ok(source::find(&self.from, self.file.as_deref())?.files())
    }

    fn write(&self, loaded: Loaded) -> Result<(), BaselineError> {
        match loaded {
            Loaded::Model(model) => {
                let (run, _lock) = RunFolder::create(&self.out, &model.config)?;
                let baseline = &model.baseline;
                let training = |path: &Path| baseline.save_training(path);
                run.write_checkpoint(0, |path| baseline.save_weights(path), training, &State::imported())
            }
            Loaded::Agent { agent, config } => {
                let config: Box<OnlineConfig> = config;
                let (run, _lock) = RunFolder::create(&self.out, &config)?;
                let training = |path: &Path| agent.save_training(path);
                run.write_checkpoint(0, |path| agent.save_weights(path), training, &OnlineState::imported())
            }
        }
    }
}

/// The folder of a repository, `USER/REPO@REVISION`, in a local cache.
pub(crate) fn cached(repository: &str) -> Result<Option<PathBuf>, TaskError> {
    cache::look(repository)
}

/// The file of weights of a checkpoint.
pub(crate) fn weights_of(from: &str, file: Option<&str>) -> Result<PathBuf, TaskError> {
    let found = source::find(from, file)?.weights;
    found.ok_or_else(|| Message::about("checkpoint", from, "holds no weights").into())
}
