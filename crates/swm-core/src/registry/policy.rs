//! The entry of a policy: how it is made, and what a command asks of the model behind it.

use std::path::{Path, PathBuf};

use serde_json::Value as Json;

use super::described::described;
use super::{Entry, EnvEntry, PolicyArgs, PolicyContext, Setting, TrainedIn};
use crate::env::{Env, ImageSize};
use crate::error::PolicyError;
use crate::policy::Policy;

/// Makes a policy for an environment from its arguments.
pub type MakePolicy = fn(&PolicyContext<'_>, &PolicyArgs) -> Result<Box<dyn Policy>, PolicyError>;
/// The image size that the model of these arguments was trained on, if it sees images.
pub type ImageOf = fn(&PolicyArgs) -> Option<ImageSize>;
/// The environment that the model of these arguments was trained in, if its run says so.
pub type TrainedOf = fn(&PolicyArgs) -> Option<TrainedIn>;
/// The files that a policy with these arguments depends on.
pub type FilesOf = fn(&PolicyArgs) -> Result<Vec<PathBuf>, PolicyError>;
/// These arguments with the dataset that an evaluation is on, if the policy takes from it what nothing else says.
pub type OnDataset = fn(&PolicyArgs, &Path) -> Option<PolicyArgs>;
/// The planner on the true dynamics that a policy with these arguments is compared with.
pub type OracleOf = fn(&PolicyContext<'_>, &PolicyArgs) -> Option<PolicyArgs>;

/// One policy of a table.
///
/// A policy that plans on a model says more of it, so that every command treats it like those of this project:
///
/// ```
/// # use swm_core::policies;
/// use swm_core::{ImageSize, PolicyArgs, PolicyEntry};
///
/// const MODEL: PolicyEntry = PolicyEntry::new("my-model", "plans on my model", |_, _| Ok(Box::new(policies::random())))
///     .image(|_| ImageSize::new(64, 64).ok())
///     .files(|args| Ok(args.positional.iter().filter_map(|file| file.as_str()).map(Into::into).collect()))
///     .oracle(|_, _| PolicyArgs::parse("cem:horizon=10").ok());
/// let args = PolicyArgs::parse("my-model:weights.bin")?;
/// assert_eq!(MODEL.image_size(&args).map(|size| size.height), Some(64));
/// assert_eq!(MODEL.model_files(&args)?.len(), 1);
/// # Ok::<(), swm_core::PolicyError>(())
/// ```
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct PolicyEntry {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it does, in one line.
    pub summary: &'static str,
    /// Its arguments.
    pub settings: &'static [Setting],
    /// Whether it plans on the environment's own dynamics: nothing that plans on a model can be better informed.
    pub on_true_dynamics: bool,
    suits: fn(&dyn Env) -> bool,
    make: MakePolicy,
    image: ImageOf,
    trained: TrainedOf,
    files: FilesOf,
    companions: FilesOf,
    on_dataset: OnDataset,
    oracle: OracleOf,
    pub(super) fits: Option<fn(&EnvEntry) -> bool>,
}

impl PolicyEntry {
    /// A policy without arguments, and without a model.
    pub const fn new(name: &'static str, summary: &'static str, make: MakePolicy) -> Self {
        Self {
            name,
            summary,
            settings: &[],
            on_true_dynamics: false,
            suits: |_| true,
            make,
            image: |_| None,
            trained: |_| None,
            files: named_files,
            companions: |_| Ok(Vec::new()),
            on_dataset: |_, _| None,
            oracle: |_, _| None,
            fits: None,
        }
    }

    /// Its arguments.
    #[must_use]
    pub const fn settings(mut self, settings: &'static [Setting]) -> Self {
        self.settings = settings;
        self
    }

    /// It plans on the environment's own dynamics.
    #[must_use]
    pub const fn on_true_dynamics(mut self) -> Self {
        self.on_true_dynamics = true;
        self
    }

    /// It can act only in environments of which `suits` is true; it is not on offer in others.
    #[must_use]
    pub const fn suits_if(mut self, suits: fn(&dyn Env) -> bool) -> Self {
        self.suits = suits;
        self
    }

    /// Whether it can act in an environment.
    pub fn suits(&self, env: &dyn Env) -> bool {
        (self.suits)(env)
    }

    /// It is offered for environments of which `fits` is true, before the policies for all.
    #[must_use]
    pub const fn only_for(mut self, fits: fn(&EnvEntry) -> bool) -> Self {
        self.fits = Some(fits);
        self
    }

    /// What images its model was trained on.
    #[must_use]
    pub const fn image(mut self, image: ImageOf) -> Self {
        self.image = image;
        self
    }

    /// What environment its model was trained in.
    #[must_use]
    pub const fn trained(mut self, trained: TrainedOf) -> Self {
        self.trained = trained;
        self
    }

    /// Which files its model is made of. Default: those that its arguments name.
    #[must_use]
    pub const fn files(mut self, files: FilesOf) -> Self {
        self.files = files;
        self
    }

    /// Which files it takes beside those of its model to make it in another place, such as the description of a checkpoint. Results do not
    /// depend on them. Default: none.
    #[must_use]
    pub const fn companions(mut self, companions: FilesOf) -> Self {
        self.companions = companions;
        self
    }

    /// What it takes from the dataset that it is evaluated on, such as how a model's vectors are scaled. Default: nothing.
    #[must_use]
    pub const fn on_dataset(mut self, on_dataset: OnDataset) -> Self {
        self.on_dataset = on_dataset;
        self
    }

    /// The same planner on the true dynamics: the most that a better model could bring.
    #[must_use]
    pub const fn oracle(mut self, oracle: OracleOf) -> Self {
        self.oracle = oracle;
        self
    }
}

/// What an entry answers.
impl PolicyEntry {
    /// Makes one. Where its description is the name alone, the settings that differ from their defaults are added, as records and
    /// results tell policies apart by it.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Argument`]: an unknown or misfit argument, a model that cannot be loaded; and whatever keeps the
    /// policy from working in the environment.
    pub fn make(
        &self,
        context: &PolicyContext<'_>,
        args: &PolicyArgs,
    ) -> Result<Box<dyn Policy>, PolicyError> {
        Ok(described((self.make)(context, args)?, args, self.settings))
    }

    /// The image size that the model of these arguments was trained on. `None`: it sees no images, or is not there.
    pub fn image_size(&self, args: &PolicyArgs) -> Option<ImageSize> {
        (self.image)(args)
    }

    /// The environment that the model of these arguments was trained in. `None`: it has no model, or its run does not say.
    pub fn trained_in(&self, args: &PolicyArgs) -> Option<TrainedIn> {
        (self.trained)(args)
    }

    /// The files that a policy with these arguments depends on, to be hashed into the receipt of an evaluation.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Argument`]: the model is not there.
    pub fn model_files(&self, args: &PolicyArgs) -> Result<Vec<PathBuf>, PolicyError> {
        (self.files)(args)
    }

    /// The files that a policy with these arguments is made from in another place, beside [`PolicyEntry::model_files`].
    ///
    /// # Errors
    ///
    /// [`PolicyError::Argument`]: the model is not there.
    pub fn companion_files(&self, args: &PolicyArgs) -> Result<Vec<PathBuf>, PolicyError> {
        (self.companions)(args)
    }

    /// The arguments with the dataset that it is evaluated on, if it takes from it what nothing else says.
    pub fn args_on_dataset(&self, args: &PolicyArgs, dataset: &Path) -> Option<PolicyArgs> {
        (self.on_dataset)(args, dataset)
    }

    /// The planner on the true dynamics that a policy with these arguments is compared with, if it names one.
    pub fn oracle_args(&self, context: &PolicyContext<'_>, args: &PolicyArgs) -> Option<PolicyArgs> {
        (self.oracle)(context, args)
    }
}

impl Entry for PolicyEntry {
    const KIND: &'static str = "policy";
    const COMMAND: &'static str = "envs";

    fn name(&self) -> &'static str {
        self.name
    }
}

/// The files and folders that arguments name.
fn named_files(args: &PolicyArgs) -> Result<Vec<PathBuf>, PolicyError> {
    let texts = args.named.values().chain(&args.positional).filter_map(Json::as_str);
    Ok(texts.map(Path::new).filter(|path| path.exists()).map(Path::to_owned).collect())
}
