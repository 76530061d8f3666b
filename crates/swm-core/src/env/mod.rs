//! The environment trait and what surrounds it: description, episode options, saved states.

mod episode;
mod factor;
mod state;

use std::collections::BTreeMap;
use std::fmt;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::batch::{Dtype, Field, RowsMut, Slice, Value};
use crate::error::EnvError;
use crate::settings::Setting;
use crate::space::Space;

pub use episode::{Episode, ResetOptions};
pub use factor::{FactorSpec, VARIATION_PREFIX, check_factor_name, nearest_factor, selects};
pub use state::EnvState;

/// An environment: one simulated world, its observations and its images.
///
/// Advancing and observing are apart, so that frame skip and planning pay for neither observations nor images. Only
/// `reset`, `step` and `restore` change it, and all three are deterministic; `dress` changes its images alone.
pub trait Env: Send + Sync {
    /// What it is and what it writes. Constant over its life.
    fn spec(&self) -> &EnvSpec;

    /// Starts an episode: samples factors, start and goal. The returned outcome has no reward (NaN) and says
    /// whether the goal is already reached.
    ///
    /// # Errors
    ///
    /// [`EnvError::Reset`]: unknown names, or values out of range; [`EnvError::Constraint`]: values that violate a constraint;
    /// [`EnvError::Diverged`]: the simulation cannot begin. The environment may be reset again.
    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError>;

    /// Advances by one control step. `action` has the type and dimension of the spec's action space and is finite.
    ///
    /// # Errors
    ///
    /// [`EnvError::Diverged`]: the simulation left the range in which it means something. The episode is over.
    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError>;

    /// Writes the episode fields (factors, goal) into one row. Called once after a reset.
    fn write_episode(&mut self, out: &mut RowsMut<'_>);

    /// Writes the step fields (state, pixels) of the current state into one row.
    fn observe(&mut self, out: &mut RowsMut<'_>);

    /// Saves everything that the future depends on: after `restore`, the same actions give the same bits, in
    /// this or another environment made from the same entry.
    ///
    /// # Errors
    ///
    /// [`EnvError::State`]: the state cannot be written down, which is a fault of the environment.
    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError>;

    /// Returns to a saved state, its factors and goal included.
    ///
    /// # Errors
    ///
    /// [`EnvError::State`]: it was saved by another kind of environment or version, or is damaged. The environment
    /// must then be reset.
    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError>;

    /// Renders images from now on with these values of visual factors in place of the episode's own: a look. An empty table ends
    /// that. States, columns and snapshots stay those of the episode, and a look outlasts `reset` and `restore`.
    ///
    /// # Errors
    ///
    /// [`EnvError::Reset`]: the environment has no looks, a factor is unknown or not visual, or a value is outside of its space.
    /// The look stays as it was.
    fn dress(&mut self, look: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        refuse_look(self.spec(), look)
    }

    /// Whether the episode is cut off now, without the task having ended it: a budget that is the environment's own, such
    /// as energy, is spent. (Limits of steps are the `World`'s.)
    fn is_truncated(&self) -> bool {
        false
    }

    /// How far the task is from done, for planners on the true simulator: lower is better. `None` if the
    /// environment has no such measure.
    fn task_cost(&self) -> Option<f64> {
        None
    }

    /// What renders its images, in words and with its version, for the record: `swm-render 0.1.0 (software)`. `None` if
    /// it renders none, or always in the same way.
    fn renderer(&self) -> Option<String> {
        None
    }

    /// Image coordinates of moving objects, so that their paths can be shown over the image. Always the same objects in the same
    /// order. Default: none.
    fn keypoints(&self) -> Vec<Keypoint> {
        Vec::new()
    }
}

/// What [`Env::dress`] of an environment without visual factors returns: an error, unless the look is empty.
///
/// # Errors
///
/// [`EnvError::Reset`]: the look names a factor.
pub fn refuse_look(spec: &EnvSpec, look: &BTreeMap<String, Value>) -> Result<(), EnvError> {
    if look.is_empty() {
        return Ok(());
    }
    let reason = "it declares no visual factors: its images cannot be rendered in other looks".to_owned();
    Err(EnvError::Reset { env: spec.id.clone(), reason })
}

/// An object's position in the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keypoint {
    /// The object: `agent`.
    pub name: &'static str,
    /// Fractions of the image's width and height, from its top left corner.
    pub at: [f64; 2],
}

/// One step of a world with frame skip: the action is applied `times` times, or until it ends the episode or the
/// episode is cut off. Rewards add up, and any success counts.
///
/// # Errors
///
/// The first one of [`Env::step`].
pub fn step_times(env: &mut dyn Env, action: Slice<'_>, times: u32) -> Result<Outcome, EnvError> {
    let mut total = env.step(action)?;
    for _ in 1..times {
        if total.terminated || env.is_truncated() {
            break;
        }
        let next = env.step(action)?;
        total.reward += next.reward;
        total.terminated = next.terminated;
        total.success = total.success.max(next.success);
    }
    Ok(total)
}

/// What one control step (or a reset) led to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Reward; NaN at reset.
    pub reward: f64,
    /// The task ended the episode. (Time limits are the `World`'s: they truncate.)
    pub terminated: bool,
    /// Whether the goal is reached now; `None` where the task has no success.
    pub success: Option<bool>,
}

/// A description of an environment. Field indices are positions in `fields`.
///
/// ```
/// use swm_core::{Dtype, EnvSpec, Field, Space};
///
/// let action = Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0);
/// let spec = EnvSpec::new("demo/Point-v0", action, vec![Field::step("state", Dtype::F64, &[2])])
///     .time_step_s(0.1)
///     .start_columns(&["state"])
///     .goal_columns(&["state"]);
/// assert_eq!(spec.factors.len(), 0);
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct EnvSpec {
    /// The registered name: `swm/PushT-v1`.
    pub id: String,
    /// What one action may be.
    pub action: Space,
    /// What `write_episode` and `observe` write.
    pub fields: Vec<Field>,
    /// The factors of variation. Factor `f` is the episode field `variation.f`.
    pub factors: Vec<FactorSpec>,
    /// Simulated seconds per control step.
    pub time_step_s: f64,
    /// Step columns from which [`ResetOptions::start`] restores a state. A dataset may lack some; the reset then
    /// says what it cannot do without.
    pub start_columns: &'static [&'static str],
    /// Step columns from which [`ResetOptions::goal`] sets a goal, likewise.
    pub goal_columns: &'static [&'static str],
    /// Step columns that a start takes besides, which are no part of the state: what was computed on the way there, such as
    /// sensors of accelerations. With them the first observation is the recorded one.
    pub start_extras: &'static [&'static str],
    /// Step columns that a goal takes besides. With them the goal's image is that of the recorded step.
    pub goal_extras: &'static [&'static str],
    /// SHA-256 of the libraries and files, besides the program, that it was made from, by name. Recordings and receipts keep
    /// them as `made_from`.
    pub asset_hashes: BTreeMap<String, String>,
}

impl EnvSpec {
    /// An environment with control steps of 1 s, without factors, and without columns to start from.
    pub fn new(id: impl Into<String>, action: Space, fields: Vec<Field>) -> Self {
        let factors = Vec::new();
        Self {
            id: id.into(),
            action,
            fields,
            factors,
            time_step_s: 1.0,
            start_columns: &[],
            goal_columns: &[],
            start_extras: &[],
            goal_extras: &[],
            asset_hashes: BTreeMap::new(),
        }
    }

    /// The factors of variation.
    #[must_use]
    pub fn factors(mut self, factors: Vec<FactorSpec>) -> Self {
        self.factors = factors;
        self
    }

    /// Simulated seconds per control step.
    #[must_use]
    pub fn time_step_s(mut self, seconds: f64) -> Self {
        self.time_step_s = seconds;
        self
    }

    /// Step columns that a reset can start from.
    #[must_use]
    pub fn start_columns(mut self, columns: &'static [&'static str]) -> Self {
        self.start_columns = columns;
        self
    }

    /// Step columns that a goal can be set from.
    #[must_use]
    pub fn goal_columns(mut self, columns: &'static [&'static str]) -> Self {
        self.goal_columns = columns;
        self
    }

    /// Step columns that a start takes besides.
    #[must_use]
    pub fn start_extras(mut self, columns: &'static [&'static str]) -> Self {
        self.start_extras = columns;
        self
    }

    /// Step columns that a goal takes besides.
    #[must_use]
    pub fn goal_extras(mut self, columns: &'static [&'static str]) -> Self {
        self.goal_extras = columns;
        self
    }

    /// SHA-256 of the libraries and files that it was made from, by name.
    #[must_use]
    pub fn asset_hashes(mut self, hashes: BTreeMap<String, String>) -> Self {
        self.asset_hashes = hashes;
        self
    }

    /// Whether a reset that samples `asked` samples the factor `name`.
    pub fn samples(&self, asked: &[String], name: &str) -> bool {
        let mut factors = self.factors.iter().filter(|factor| factor.name == name);
        factors.any(|factor| asked.iter().any(|asked| factor.is_selected_by(asked)))
    }
}

/// The name of the pixel field.
pub const PIXELS: &str = "pixels";
/// The name of the field of the goal's image.
pub const GOAL_IMAGE: &str = "goal";
/// The pixels that an environment renders: height and width.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ImageSize {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

/// `48x64`: height, then width, as options take it.
impl fmt::Display for ImageSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.height, self.width)
    }
}

impl ImageSize {
    /// The largest side that is accepted: larger ones are mistakes more often than wishes.
    pub const MAX_SIDE: usize = 4096;

    /// Checks that both sides are in `1..=4096`.
    ///
    /// # Errors
    ///
    /// A sentence that names the size and the bounds, for callers that know which option it came from.
    pub fn new(height: usize, width: usize) -> Result<Self, String> {
        let valid = 1..=Self::MAX_SIDE;
        if valid.contains(&height) && valid.contains(&width) {
            Ok(Self { height, width })
        } else {
            Err(format!("image size {height}x{width} is out of range; each side is 1 to {}", Self::MAX_SIDE))
        }
    }

    /// `[H, W, 3]`.
    pub fn shape(self) -> [usize; 3] {
        [self.height, self.width, 3]
    }

    /// The pixel field of this size.
    pub fn field(self, name: &str) -> Field {
        Field::step(name, Dtype::U8, &self.shape())
    }

    /// The pixel field, and the image of an episode's goal.
    pub fn fields_with_goal(self) -> [Field; 2] {
        [self.field(PIXELS), Field::episode(GOAL_IMAGE, Dtype::U8, &self.shape())]
    }
}

/// How to make an environment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EnvConfig {
    /// Image size; `None`: no images are rendered.
    pub image: Option<ImageSize>,
    /// Settings of this kind of environment, by name; see [`crate::registry::EnvEntry::settings`].
    pub settings: serde_json::Map<String, serde_json::Value>,
}

impl EnvConfig {
    /// The settings as the environment's own type.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit one, with the known ones.
    pub fn parse_settings<T: DeserializeOwned>(&self, env: &str) -> Result<T, EnvError> {
        crate::settings::read(&self.settings)
            .map_err(|error| EnvError::Setting { env: env.to_owned(), reason: error.to_string() })
    }

    /// As [`EnvConfig::parse_settings`], where an error lists the settings of a table: those of the environment's entry.
    ///
    /// # Errors
    ///
    /// As of [`EnvConfig::parse_settings`].
    pub fn parse_settings_of<T: DeserializeOwned>(
        &self,
        env: &str,
        known: &[Setting],
    ) -> Result<T, EnvError> {
        crate::settings::read_of(&self.settings, known)
            .map_err(|error| EnvError::Setting { env: env.to_owned(), reason: error.to_string() })
    }
}
