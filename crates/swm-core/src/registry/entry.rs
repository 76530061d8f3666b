//! What every entry of a table is, and the entry of an environment.

use crate::env::{Env, EnvConfig};
use crate::error::EnvError;
use crate::settings::Setting;

use super::{PolicyEntry, Registry};

/// Something that a [`Registry`](super::Registry) finds by name: an environment, a policy, a solver, a dataset format,
/// a kind that another crate defines.
pub trait Entry: Send + Sync + 'static {
    /// What it is, in messages: `environment`.
    const KIND: &'static str;
    /// The command that lists all of them: `envs`, for `swm envs`.
    const COMMAND: &'static str;

    /// The name that it is found by. No other entry of the kind has it.
    fn name(&self) -> &'static str;

    /// Further names that it is found by.
    fn aliases(&self) -> &'static [&'static str] {
        &[]
    }

    /// Whether it cannot be found beside another entry of a name that it has. By default it cannot.
    fn is_taken_by(&self, _other: &Self) -> bool {
        true
    }

    /// Adds entries of other kinds that come with it, such as the policy of a model. By default none do.
    #[must_use]
    fn with_parts(&'static self, registry: Registry) -> Registry {
        registry
    }
}

/// Makes an environment.
pub type MakeEnv = fn(&EnvConfig) -> Result<Box<dyn Env>, EnvError>;

/// A task of an environment that has several: what its setting `task` chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct EnvTask {
    /// Its name, as the setting has it: `--env-option task=run`.
    pub name: &'static str,
    /// What is rewarded, in a few words.
    pub doc: &'static str,
}

impl EnvTask {
    /// A task: its name, and what is rewarded.
    pub const fn new(name: &'static str, doc: &'static str) -> Self {
        Self { name, doc }
    }
}

/// One environment of a table.
///
/// ```
/// # use swm_core::testing::TOY;
/// use swm_core::{EnvEntry, Setting};
///
/// const POINT: EnvEntry = EnvEntry::new("demo/Point-v0", "a point that must reach a goal", |config| TOY.make(config))
///     .settings(&[Setting::new("speed", "distance per step", "0.1")])
///     .planner("cem:horizon=5");
/// assert_eq!((POINT.id, POINT.policies.len()), ("demo/Point-v0", 0));
/// ```
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct EnvEntry {
    /// The registered name: `swm/PushT-v1`.
    pub id: &'static str,
    /// Further names that it is found by.
    pub aliases: &'static [&'static str],
    /// What it is, in one line.
    pub summary: &'static str,
    /// What it belongs to, as the heading of a list: `Classic control`. Empty: nothing.
    pub family: &'static str,
    /// When its task is solved, in a few words: `within 20 px of the goal`. Empty: it has rewards only.
    pub success: &'static str,
    /// What [`EnvConfig::settings`] may hold.
    pub settings: &'static [Setting],
    /// What the setting `task` chooses, the default first; empty where there is no such setting, or its values are no names.
    pub tasks: &'static [EnvTask],
    /// Policies that know this environment.
    pub policies: &'static [PolicyEntry],
    /// A planner that solves its task, as on a command line (`icem:horizon=20`): the policy `expert` of an environment
    /// that has no expert of its own.
    pub planner: Option<&'static str>,
    make: MakeEnv,
}

impl EnvEntry {
    /// An environment without settings, policies and a planner.
    pub const fn new(id: &'static str, summary: &'static str, make: MakeEnv) -> Self {
        let (settings, tasks, policies, planner) = (&[], &[], &[], None);
        Self { id, aliases: &[], summary, family: "", success: "", settings, tasks, policies, planner, make }
    }

    /// Further names that it is found by.
    #[must_use]
    pub const fn aliases(mut self, aliases: &'static [&'static str]) -> Self {
        self.aliases = aliases;
        self
    }

    /// What it belongs to: see [`EnvEntry::family`].
    #[must_use]
    pub const fn family(mut self, family: &'static str) -> Self {
        self.family = family;
        self
    }

    /// When its task is solved: see [`EnvEntry::success`].
    #[must_use]
    pub const fn success(mut self, success: &'static str) -> Self {
        self.success = success;
        self
    }

    /// What its configuration may hold.
    #[must_use]
    pub const fn settings(mut self, settings: &'static [Setting]) -> Self {
        self.settings = settings;
        self
    }

    /// The tasks that its setting `task` chooses: see [`EnvEntry::tasks`].
    #[must_use]
    pub const fn tasks(mut self, tasks: &'static [EnvTask]) -> Self {
        self.tasks = tasks;
        self
    }

    /// Policies that know it.
    #[must_use]
    pub const fn policies(mut self, policies: &'static [PolicyEntry]) -> Self {
        self.policies = policies;
        self
    }

    /// A planner that solves its task: see [`EnvEntry::planner`].
    #[must_use]
    pub const fn planner(mut self, planner: &'static str) -> Self {
        self.planner = Some(planner);
        self
    }

    /// Makes one.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`], and whatever the environment needs and does not find: a library, a model.
    pub fn make(&self, config: &EnvConfig) -> Result<Box<dyn Env>, EnvError> {
        (self.make)(config)
    }
}

impl Entry for EnvEntry {
    const KIND: &'static str = "environment";
    const COMMAND: &'static str = "envs";

    fn name(&self) -> &'static str {
        self.id
    }

    fn aliases(&self) -> &'static [&'static str] {
        self.aliases
    }
}
