//! `World`: many environments stepped in parallel, all their data in one `infos` table, a policy attached.
//!
//! There is one rollout loop, [`World::run`]; collecting, evaluating and recording are recorders that watch it.

mod fields;
mod options;
mod rollout;
mod slot;

use std::sync::Arc;

use rayon::ThreadPool;

use crate::batch::{Batch, Column, Field, Schema, Slice};
use crate::env::{EnvSpec, ResetOptions, VARIATION_PREFIX};
use crate::error::{BatchError, PolicyError, WorldError};
use crate::evaluate::{Judge, SuccessRule};
use crate::pace::Pace;
use crate::policy::{Actions, LiveEpisode, Policy, View};
use crate::registry::{EnvEntry, PolicyContext};
use crate::seed::EpisodeSeed;
use crate::view::{Frames, Transform};

pub use options::{MAX_FRAME_SKIP, WorldOptions};
pub use rollout::{Rollout, Scenario};
pub(crate) use slot::Slot;

use fields::CommonFields;
use slot::{ResetRules, StepRules};

/// Many environments of one kind, and everything they say in one table.
///
/// ```
/// use swm_core::testing::TOY;
/// use swm_core::{ResetOptions, Rollout, Scenario, World, WorldOptions, policy};
///
/// let mut world = World::new(&TOY, WorldOptions { num_envs: 4, ..WorldOptions::default() })?;
/// world.set_policy(policy::random());
///
/// // By hand: every environment at once.
/// world.reset(42, &ResetOptions::default())?;
/// world.step()?;
/// assert_eq!(world.infos().rows(), 4);
///
/// // Or whole episodes: these ten, whatever the number of environments and threads.
/// let options = ResetOptions::default();
/// let rollout = Rollout { episodes: 0..10, seed: 42, scenario: Scenario::Same(&options) };
/// let evaluation = world.evaluate(&rollout, &mut ())?;
/// assert_eq!(evaluation.episodes, 10);
/// # Ok::<(), swm_core::WorldError>(())
/// ```
pub struct World {
    entry: EnvEntry,
    options: WorldOptions,
    pub(crate) spec: EnvSpec,
    slots: Vec<Slot>,
    infos: Batch,
    actions: Column,
    policy: Option<Box<dyn Policy>>,
    /// The policy's own fields at this step, to be copied into the infos.
    report: Batch,
    /// Why the policy's own fields do not fit into the infos.
    unfit: Option<String>,
    fields: CommonFields,
    judge: Option<Judge>,
    frames: Option<Frames>,
    policy_seed: u64,
    pace: Pace,
    pool: Arc<ThreadPool>,
}

impl World {
    /// Makes the environments. Nothing is reset yet.
    ///
    /// # Errors
    ///
    /// An option out of its bounds, and whatever making the environment meets: an unknown setting, a library or model that is not
    /// installed.
    pub fn new(entry: &EnvEntry, options: WorldOptions) -> Result<Self, WorldError> {
        options.check()?;
        let wrong = |option, reason: String| Err(WorldError::Option { option, reason });
        // rayon takes 0 for "one per core".
        let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads.unwrap_or(0));
        let pool = match pool.thread_name(|i| format!("swm-{i}")).build() {
            Ok(pool) => Arc::new(pool),
            Err(error) => return wrong("threads", error.to_string()),
        };
        let mut slots = (0..options.num_envs)
            .map(|_| entry.make(&options.env).map(Slot::new))
            .collect::<Result<Vec<_>, _>>()?;
        let spec = slots[0].env().spec().clone();
        let every = options.checkpoints.map(|every| every as usize);
        let checkpoints = every.map(|every| slots[0].checkpoints(every)).transpose()?;
        let (columns, fields) = CommonFields::append(&spec, checkpoints);
        let infos = Batch::new(Schema::new(columns)?, options.num_envs);
        if let Some(name) = options.unrecorded.iter().find(|name| name.starts_with(VARIATION_PREFIX)) {
            return wrong("unrecorded", format!("`{name}` is needed to restore recorded episodes"));
        }
        if let Some(error) = options.unrecorded.iter().find_map(|name| infos.schema().require(name).err()) {
            return wrong("unrecorded", error.to_string());
        }
        let actions = infos.column(fields.action).to_column();
        let (report, pace) = (Batch::new(Arc::default(), options.num_envs), Pace::default());
        Ok(Self {
            entry: *entry,
            options,
            spec,
            slots,
            infos,
            actions,
            policy: None,
            report,
            unfit: None,
            fields,
            judge: None,
            frames: None,
            policy_seed: 0,
            pace,
            pool,
        })
    }

    /// The entry that its environments are made by.
    pub fn entry(&self) -> &EnvEntry {
        &self.entry
    }

    /// The environments' description.
    pub fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    /// How the world was built.
    pub fn options(&self) -> &WorldOptions {
        &self.options
    }

    /// The table of everything: row = environment. Holds the last reset's or step's values.
    pub fn infos(&self) -> &Batch {
        &self.infos
    }

    /// Changes the time limit of the episodes to come, and returns the old one.
    pub fn set_max_episode_steps(&mut self, limit: Option<u64>) -> Option<u64> {
        std::mem::replace(&mut self.options.max_episode_steps, limit)
    }

    /// Attaches the policy that `step` and `run` ask for actions. Its own fields, if it has any, become the last of
    /// the infos; should another field have the same name, `step` and `run` say so.
    pub fn set_policy(&mut self, policy: impl Policy + 'static) {
        self.unfit = self.make_room(policy.fields()).err().map(|error| error.to_string());
        self.policy = Some(Box::new(policy));
    }

    /// Replaces the last policy's fields of the infos by `fields`; all others keep their values.
    fn make_room(&mut self, fields: Vec<Field>) -> Result<(), BatchError> {
        let kept = self.fields.of_policy();
        let old = self.infos.schema().fields();
        if fields == old[kept..] {
            return Ok(());
        }
        let all: Vec<Field> = old[..kept].iter().chain(&fields).cloned().collect();
        let mut infos = Batch::new(Schema::new(all)?, self.slots.len());
        for index in 0..kept {
            assert!(infos.column_mut(index).copy_from(self.infos.column(index)), "the field is the same");
        }
        self.infos = infos;
        self.report = Batch::new(Schema::new(fields)?, self.slots.len());
        Ok(())
    }

    /// Lets `rule` decide what success is, in every row from the start on, in place of the environment: its own success
    /// then neither counts nor ends an episode. The environment's own rule gives it back.
    ///
    /// # Errors
    ///
    /// The rule names a field or an element that the infos lack.
    pub fn set_success(&mut self, rule: &SuccessRule) -> Result<(), WorldError> {
        self.judge = rule.judge(self.infos.schema())?;
        Ok(())
    }

    /// Shows images through `transform`, or as they are. Fields that are not images do not change.
    pub fn set_transform(&mut self, transform: Option<Arc<dyn Transform>>) {
        self.frames = transform.map(|transform| Frames::new(transform, self.infos.schema()));
    }

    /// The seed of the policy's own noise: repetitions of the same episodes differ by it alone. 0: noise comes from the
    /// episodes' seeds.
    pub fn set_policy_seed(&mut self, seed: u64) {
        self.policy_seed = seed;
    }

    /// The attached policy, in words.
    pub fn policy_description(&self) -> Option<String> {
        self.policy.as_ref().map(Policy::describe)
    }

    /// Resets every environment: row `i` begins episode `i` of the run with seed `seed`.
    ///
    /// # Errors
    ///
    /// Unknown factors, values out of bounds or that break a constraint, start or goal columns that the environment does not take.
    pub fn reset(&mut self, seed: u64, options: &ResetOptions) -> Result<(), WorldError> {
        for (row, slot) in self.slots.iter_mut().enumerate() {
            let index = row as u64;
            slot.next = Some(LiveEpisode { index, seed: EpisodeSeed::of(seed, index), step: 0 });
        }
        self.on_threads(|world| world.reset_phase(&Scenario::Same(options)))
    }

    /// Asks the policy for actions and steps every environment whose episode is not over.
    ///
    /// # Errors
    ///
    /// No policy is attached, the policy fails, or an action is outside of the space (NaN, say). The lowest row's error is given.
    pub fn step(&mut self) -> Result<(), WorldError> {
        self.on_threads(|world| {
            world.act()?;
            world.step_phase()
        })
    }

    /// Steps with given actions, `[N, …action shape]` of the action space's type.
    ///
    /// # Errors
    ///
    /// Another number or type of values, or an action outside of the space; nothing has been stepped then.
    pub fn step_with(&mut self, actions: Slice<'_>) -> Result<(), WorldError> {
        let expected = self.actions.as_slice();
        if actions.dtype() != expected.dtype() || actions.len() != expected.len() {
            let width = self.spec.action.width();
            let reason = format!(
                "actions must be {} values of {} ({} environments × {width}), found {} of {}",
                expected.len(),
                expected.dtype(),
                self.slots.len(),
                actions.len(),
                actions.dtype(),
            );
            return Err(WorldError::Action { row: 0, episode: 0, step: 0, reason });
        }
        assert!(self.actions.as_slice_mut().copy_from(actions), "checked above");
        self.check_actions()?;
        self.on_threads(Self::step_phase)
    }

    fn act(&mut self) -> Result<(), WorldError> {
        let policy = self.policy.as_mut().ok_or(WorldError::NoPolicy)?;
        if let Some(reason) = &self.unfit {
            let (policy, reason) = (policy.describe(), reason.clone());
            return Err(PolicyError::Unsupported { policy, reason }.into());
        }
        let report = &mut self.report;
        let fields = report.schema().fields().len();
        (0..fields).for_each(|index| report.column_mut(index).fill_missing());
        let view = View { infos: &self.infos, spec: &self.spec, slots: &self.slots, seed: self.policy_seed };
        policy.act(&view, &mut Actions { space: &self.spec.action, column: &mut self.actions, report })?;
        self.check_actions()?;
        self.copy_report();
        Ok(())
    }

    /// Copies what the policy said of live rows into the infos.
    fn copy_report(&mut self) {
        let first = self.fields.of_policy();
        for index in 0..self.report.schema().fields().len() {
            let width = self.report.schema().width(index);
            for row in (0..self.slots.len()).filter(|&row| self.slots[row].is_live()) {
                let (_, rest) = self.infos.column_mut(first + index).split_at(row * width);
                let said = self.report.column(index).range(row * width, width);
                assert!(rest.split_at(width).0.copy_from(said), "one schema made both");
            }
        }
    }

    /// Refuses actions that are not finite, and copies the others into the infos.
    fn check_actions(&mut self) -> Result<(), WorldError> {
        let width = self.spec.action.width();
        let actions = self.actions.as_slice();
        for (row, slot) in self.slots.iter().enumerate() {
            let Some(episode) = slot.live_episode() else { continue };
            let action = actions.range(row * width, width);
            let refuse = |reason: String| {
                Err(WorldError::Action { row, episode: episode.index, step: episode.step, reason })
            };
            if !action.is_finite() {
                return refuse(format!("the action {action:?} is not finite"));
            }
            if !self.spec.action.holds_integers(action) {
                let (low, high) = self.spec.action.bounds();
                return refuse(format!("the action {action:?} is not between {low:?} and {high:?}"));
            }
            let infos = self.infos.column_mut(self.fields.action);
            let (_, rest) = infos.split_at(row * width);
            assert!(rest.split_at(width).0.copy_from(action), "one schema made both");
        }
        Ok(())
    }

    fn reset_phase(&mut self, scenario: &Scenario<'_>) -> Result<(), WorldError> {
        let Self { slots, infos, fields, judge, frames, .. } = self;
        let rules = ResetRules { fields: *fields, judge: judge.as_ref(), frames: frames.as_ref() };
        slot::reset_all(slots, infos.rows_mut(), scenario, &rules)
    }

    fn step_phase(&mut self) -> Result<(), WorldError> {
        let Self { options, slots, infos, actions, fields, judge, frames, pace, .. } = self;
        let rules = StepRules {
            frame_skip: options.frame_skip,
            max_steps: options.max_episode_steps,
            reset: ResetRules { fields: *fields, judge: judge.as_ref(), frames: frames.as_ref() },
        };
        slot::step_all(slots, infos.rows_mut(), actions.as_slice(), &rules, pace)
    }

    /// Does `work` on the world's own threads. A single environment has nothing to share, and stays on the
    /// caller's thread, which saves the hand-over.
    fn on_threads<R: Send>(&mut self, work: impl FnOnce(&mut Self) -> R + Send) -> R {
        if self.slots.len() == 1 {
            return work(self);
        }
        let pool = Arc::clone(&self.pool);
        pool.install(|| work(self))
    }
}

/// What a policy for the environments of a world is made for.
impl<'a> From<&'a World> for PolicyContext<'a> {
    fn from(world: &'a World) -> Self {
        Self::new(&world.entry, &world.options.env).frame_skip(world.options.frame_skip)
    }
}
