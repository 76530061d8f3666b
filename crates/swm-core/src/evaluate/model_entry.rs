//! World models by name, for measures of their quality: a line of a table in the registry.

use super::quality::WorldModel;
use crate::env::ImageSize;
use crate::error::PolicyError;
use crate::registry::{Entry, ImageOf, PolicyArgs, PolicyContext, TrainedIn, TrainedOf};

/// Makes a world model for an environment from its arguments.
pub type MakeModel = fn(&PolicyContext<'_>, &PolicyArgs) -> Result<Box<dyn WorldModel>, PolicyError>;

/// One kind of world model whose quality can be measured: `lewm:RUN`.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct ModelEntry {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it is, in one line.
    pub summary: &'static str,
    /// The policy that plans with it, if it has another name: `mpc:RUN`.
    pub planned_by: Option<&'static str>,
    make: MakeModel,
    image: ImageOf,
    trained: TrainedOf,
}

impl ModelEntry {
    /// A model that sees no images.
    pub const fn new(name: &'static str, summary: &'static str, make: MakeModel) -> Self {
        Self { name, summary, planned_by: None, make, image: |_| None, trained: |_| None }
    }

    /// What images it was trained on.
    #[must_use]
    pub const fn image(mut self, image: ImageOf) -> Self {
        self.image = image;
        self
    }

    /// What environment it was trained in.
    #[must_use]
    pub const fn trained(mut self, trained: TrainedOf) -> Self {
        self.trained = trained;
        self
    }

    /// The policy that plans with it: who takes the model's name for a policy is told.
    #[must_use]
    pub const fn planned_by(mut self, policy: &'static str) -> Self {
        self.planned_by = Some(policy);
        self
    }

    /// Makes one.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Argument`]: an unknown or misfit argument, or a model that cannot be loaded.
    pub fn make(
        &self,
        context: &PolicyContext<'_>,
        args: &PolicyArgs,
    ) -> Result<Box<dyn WorldModel>, PolicyError> {
        (self.make)(context, args)
    }

    /// The image size that the model of these arguments was trained on.
    pub fn image_size(&self, args: &PolicyArgs) -> Option<ImageSize> {
        (self.image)(args)
    }

    /// The environment that the model of these arguments was trained in, if its run says so.
    pub fn trained_in(&self, args: &PolicyArgs) -> Option<TrainedIn> {
        (self.trained)(args)
    }
}

impl Entry for ModelEntry {
    const KIND: &'static str = "world model";
    const COMMAND: &'static str = "quality --help";

    fn name(&self) -> &'static str {
        self.name
    }
}
