//! What is left of an environment with factors when [`FactorEnv`](crate::FactorEnv) is the rest.

use serde::Serialize;
use serde::de::DeserializeOwned;
use swm_core::env::{Episode, ImageSize, Keypoint};
use swm_core::{BatchError, EnvConfig, EnvError, EnvSpec, Outcome, RowsMut, Slice};

use crate::assignment::Fov;
use crate::factor::FovSpace;

/// One simulated world: its factors, how it moves, which columns describe it, how it is rendered.
/// [`FactorEnv`](crate::FactorEnv) makes an environment of it.
///
/// The value itself is what the factors of an episode determine, and memory to step in: it is made anew for every episode.
/// What changes in an episode, and the goal, are [`Scene::State`], which saved states hold behind the factors.
pub trait Scene: Send + Sync + Sized + 'static {
    /// The registered name.
    const ID: &'static str;
    /// Whether there is an image of the goal, besides that of the current state.
    const HAS_GOAL_IMAGE: bool = true;
    /// Constructor settings.
    type Settings: DeserializeOwned + Send + Sync;
    /// What changes in an episode, and the goal.
    type State: Serialize + DeserializeOwned + Send + Sync;
    /// What renders images: the renderer, and what does not move in an episode.
    type Canvas: Send + Sync;

    /// Reads the settings.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit one.
    fn settings(config: &EnvConfig) -> Result<Self::Settings, EnvError> {
        config.parse_settings(Self::ID)
    }

    /// The factor table, with the defaults that the settings ask for.
    ///
    /// # Errors
    ///
    /// A setting has a value that it cannot have.
    fn factors(settings: &Self::Settings) -> Result<FovSpace, SceneError>;

    /// Actions and columns: those of a step, then those of an episode. The frame adds factors and images behind them.
    fn spec() -> EnvSpec;

    /// What renders images of this size. [`Scene::dress`] is called before the first.
    ///
    /// # Errors
    ///
    /// Such images cannot be rendered.
    fn canvas(settings: &Self::Settings, size: ImageSize) -> Result<Self::Canvas, SceneError>;

    /// Samples the factors of an episode.
    ///
    /// # Errors
    ///
    /// As of [`FovSpace::sample`], or a recorded start or goal does not fit.
    fn sample(space: &FovSpace, episode: &Episode<'_>) -> Result<Fov, SceneError> {
        Ok(space.sample(Self::ID, episode)?)
    }

    /// The scene under these factors.
    ///
    /// # Errors
    ///
    /// They do not go together.
    fn new(settings: &Self::Settings, fov: &Fov) -> Result<Self, SceneError>;

    /// The state in which an episode begins: sampled, or of the recorded rows of `episode.options`. `spec` is that of the
    /// environment. It is also called once when the environment is made, without rows, and must succeed then.
    ///
    /// # Errors
    ///
    /// A recorded start or goal does not fit, or the simulation cannot begin.
    fn start(&mut self, spec: &EnvSpec, fov: &Fov, episode: &Episode<'_>) -> Result<Self::State, SceneError>;

    /// Takes over a goal: called when an episode begins, and when a restored state has other factors or another goal.
    fn take_goal(&mut self, _state: &Self::State) {}

    /// Takes over a restored state, where the scene keeps a part of it in another form. Refuses values that cannot be.
    ///
    /// # Errors
    ///
    /// The state holds such values.
    fn restore(&mut self, state: &Self::State) -> Result<(), SceneError>;

    /// Whether two states of the same factors have the same goal, and whatever else of a state [`Scene::dress`] reads.
    fn is_same_goal(_a: &Self::State, _b: &Self::State) -> bool {
        true
    }

    /// Advances by one control step.
    ///
    /// # Errors
    ///
    /// The action is none, or the simulation left the range in which it means something.
    fn step(&mut self, state: &mut Self::State, action: Slice<'_>) -> Result<Outcome, SceneError>;

    /// What a state amounts to. Of a reset, the success counts.
    fn outcome(&self, state: &Self::State) -> Outcome;

    /// As [`swm_core::Env::is_truncated`].
    fn is_truncated(&self, _state: &Self::State) -> bool {
        false
    }

    /// Writes the episode columns of [`Scene::spec`].
    fn write_episode(&self, _state: &Self::State, _out: &mut RowsMut<'_>) {}

    /// Writes the step columns of [`Scene::spec`].
    fn observe(&self, state: &Self::State, out: &mut RowsMut<'_>);

    /// Renders what does not move in an episode. `look` is the assignment as images show it.
    ///
    /// # Errors
    ///
    /// It cannot be rendered.
    fn dress(&self, state: &Self::State, look: &Fov, canvas: &mut Self::Canvas) -> Result<(), SceneError>;

    /// Writes the image of a state, `[H, W, 3]`.
    fn render(&self, state: &Self::State, canvas: &mut Self::Canvas, pixels: &mut [u8]);

    /// Writes the image of the goal, `[H, W, 3]`, where [`Scene::HAS_GOAL_IMAGE`]: once for every goal and look.
    fn render_goal(&self, _state: &Self::State, _canvas: &mut Self::Canvas, _pixels: &mut [u8]) {}

    /// As [`swm_core::Env::task_cost`].
    fn task_cost(&self, _state: &Self::State) -> Option<f64> {
        None
    }

    /// As [`swm_core::Env::keypoints`].
    fn keypoints(&self, _state: &Self::State) -> Vec<Keypoint> {
        Vec::new()
    }
}

/// Why a scene refuses something.
#[derive(Debug)]
pub enum SceneError {
    /// The reason: the frame adds the environment's name, and whether this was a setting, a reset, a step or a saved state.
    Reason(String),
    /// A whole error.
    Env(EnvError),
}

impl SceneError {
    /// As an error of the environment; `of` makes one of its name and a reason.
    pub(crate) fn of<S: Scene>(self, of: impl FnOnce(String, String) -> EnvError) -> EnvError {
        match self {
            Self::Reason(reason) => of(S::ID.to_owned(), reason),
            Self::Env(error) => error,
        }
    }
}

impl From<String> for SceneError {
    fn from(reason: String) -> Self {
        Self::Reason(reason)
    }
}

impl From<&str> for SceneError {
    fn from(reason: &str) -> Self {
        Self::Reason(reason.to_owned())
    }
}

impl From<EnvError> for SceneError {
    fn from(error: EnvError) -> Self {
        Self::Env(error)
    }
}

impl From<BatchError> for SceneError {
    fn from(error: BatchError) -> Self {
        Self::Env(error.into())
    }
}
