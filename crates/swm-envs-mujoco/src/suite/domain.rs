//! What a domain of the suite is: a table of constants, and tasks that start, observe and reward.

use swm_core::seed::Stream;
use swm_core::{EnvConfig, EnvEntry, EnvError, EnvTask, PolicyEntry};

use super::effect::Control;
use super::settings::SETTINGS;
use super::{Stage, SuiteEnv, Target};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Spec};

/// A domain: one model and the tasks in it. One `const` per file.
pub struct Domain {
    /// The environment's id: `swm/CheetahDMControl-v0`.
    pub id: &'static str,
    /// What it is, in one line.
    pub summary: &'static str,
    /// When the default task is solved, in a few words; empty: it has rewards only.
    pub success: &'static str,
    /// Its file in the suite: `cheetah.xml`.
    pub model: &'static str,
    /// Physics steps per control step.
    pub substeps: u32,
    /// Simulated seconds after which an episode is cut.
    pub time_limit_s: f64,
    /// Index of the camera that images are taken from.
    pub camera: usize,
    /// Its tasks; the first is the default.
    pub tasks: &'static [TaskEntry],
    /// The planner that is the expert of the first task; see [`EnvEntry::planner`].
    pub planner: &'static str,
    /// Policies of its own, such as one that was learned.
    pub policies: &'static [PolicyEntry],
    /// Named values next to the observation, written by [`Task::infos`] in this order: name and number of values, 0 for
    /// one number without a dimension.
    pub infos: &'static [(&'static str, usize)],
    /// What a task places by writing into the model at the start of an episode.
    pub targets: &'static [Target],
    /// Columns of a recorded row that a reset can start from: [`START_COLUMNS`], and the columns of the targets.
    pub start_columns: &'static [&'static str],
    /// Edits of the description before anything else: what every episode of the task has.
    pub compose: fn(&mut Spec, task: &str) -> Result<(), MujocoError>,
    /// The factors of variation with what they do, in the order of their columns. The argument: whether the defaults are
    /// those of `dm_control`'s own model (`stock`), or those that the reference applies.
    pub factors: fn(stock: bool) -> Vec<Control>,
}

/// One task of a domain.
pub struct TaskEntry {
    /// Its name in the setting `task`.
    pub name: &'static str,
    /// What is rewarded, in a few words.
    pub doc: &'static str,
    /// Columns of a recorded row that can be its goal; a goal is handed to [`Task::set_goal`].
    pub goal_columns: &'static [&'static str],
    /// Looks up what the task needs in the model.
    pub make: MakeTask,
}

/// Looks up what a task needs in the model.
pub type MakeTask = fn(&Model) -> Result<Box<dyn Task>, MujocoError>;

impl TaskEntry {
    /// A task without goals from recorded rows.
    pub const fn new(name: &'static str, doc: &'static str, make: MakeTask) -> Self {
        Self { name, doc, goal_columns: &[], make }
    }

    /// The same, with goals from these columns.
    pub const fn goal_columns(self, goal_columns: &'static [&'static str]) -> Self {
        Self { goal_columns, ..self }
    }
}

/// The columns that every start may name. `qpos` and `qvel` are needed; the others, zero where missing, make the
/// continuation exact.
pub const START_COLUMNS: &[&str] = &["qpos", "qvel", "time", "qacc_warmstart"];

/// What is done in a domain. It keeps indices into the model and constants, no state: state is in the [`Stage`].
pub trait Task: Send + Sync {
    /// Places everything for a new episode. The simulation stands at the reference position, computed; afterwards it is
    /// computed again.
    ///
    /// # Errors
    ///
    /// [`MujocoError::Start`]: no start was found; or the simulation failed.
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError>;

    /// Appends the observation, in the order of the suite.
    fn observe(&self, stage: &Stage, out: &mut Vec<f64>);

    /// Sets sensors of accelerations to what a recorded observation has, of as many values as [`Task::observe`] gives. They belong
    /// to the physics step before the state, and do not follow from it.
    fn recall(&self, _stage: &mut Stage, _observation: &[f64]) {}

    /// The reward of the present state, after a control step.
    fn reward(&self, stage: &Stage) -> f64;

    /// How far the present state is from what is rewarded, where the reward itself says too little to plan by: lower is
    /// better. `None`: minus the rewards so far.
    fn cost(&self, _stage: &Stage) -> Option<f64> {
        None
    }

    /// Whether the goal is reached, where there is one.
    fn success(&self, _stage: &Stage) -> Option<bool> {
        None
    }

    /// Whether the task ends here. No task of the suite ever does; time limits are no ends.
    fn terminated(&self, _stage: &Stage) -> bool {
        false
    }

    /// Appends the values of [`Domain::infos`].
    fn infos(&self, _stage: &Stage, _out: &mut Vec<f64>) {}

    /// The positions of the goal, where it is a whole state, which an image can show.
    fn goal_qpos<'a>(&self, _stage: &'a Stage) -> Option<&'a [f64]> {
        None
    }

    /// Sets the goal from column `column` of a recorded row, one of [`TaskEntry::goal_columns`].
    fn set_goal(&self, _stage: &mut Stage, _column: &str, _values: &[f64]) {}
}

/// The table entry of a domain.
pub const fn entry(domain: &'static Domain, make: MakeEnv) -> EnvEntry {
    EnvEntry::new(domain.id, domain.summary, make)
        .family("DeepMind Control Suite, on MuJoCo")
        .success(domain.success)
        .settings(SETTINGS)
        .planner(domain.planner)
        .policies(domain.policies)
}

/// The tasks of a domain, as its [`entry`] lists them. `N` is their number.
pub(crate) const fn listed<const N: usize>(tasks: &[TaskEntry]) -> [EnvTask; N] {
    let mut list = [EnvTask::new("", ""); N];
    let mut at = 0;
    while at < N {
        list[at] = EnvTask::new(tasks[at].name, tasks[at].doc);
        at += 1;
    }
    list
}

/// iCEM with these settings, as [`Domain::planner`], and what all domains share: plan at every action, go on from the last
/// plan and its elites, carry out the best plan seen. Success has no part in the cost, as tasks go on after it.
macro_rules! planner {
    ($settings:literal) => {
        concat!(
            "icem:",
            $settings,
            ",elites_kept=3,elite_shift=1,return_best=true,receding_horizon=1,action_block=1,success_bonus=0",
        )
    };
}

pub(crate) use planner;

/// As [`EnvEntry::make`].
pub type MakeEnv = fn(&EnvConfig) -> Result<Box<dyn swm_core::Env>, EnvError>;

/// Makes the environment of a domain.
///
/// # Errors
///
/// [`EnvError::Setting`]: an unknown or misfit setting; or MuJoCo, the model or its textures are missing.
pub fn make(domain: &'static Domain, config: &EnvConfig) -> Result<Box<dyn swm_core::Env>, EnvError> {
    Ok(Box::new(SuiteEnv::new(domain, config)?))
}

/// For domains whose file is used as it is.
///
/// # Errors
///
/// None.
pub fn unchanged(_: &mut Spec, _: &str) -> Result<(), MujocoError> {
    Ok(())
}
