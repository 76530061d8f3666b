//! `World`: many environments stepped in parallel, all their data in one `infos` table, a policy attached.
//!
//! There is one rollout loop, [`World::run`]; collecting, evaluating and recording are recorders that watch it.

mod acting;
mod fields;
mod lanes;
mod phases;
mod run;
mod saved;
mod split_recorder;

use std::sync::Arc;

use crate::batch::{Batch, Column, Field, Schema, Slice};
use crate::env::{EnvSpec, Keypoint, ResetOptions, VARIATION_PREFIX};
use crate::error::{BatchError, PolicyError, WorldError};
use crate::policy::{Policy, View};
use crate::registry::{EnvEntry, PolicyContext};
use crate::run::{EpisodeEnd, LiveEpisode, Progress, Slot, WorldOptions};
use crate::success::{Judge, SuccessRule};
use crate::threads::{Pace, Threads};
use crate::view::{Frames, Transform};

pub use run::Run;
pub use saved::SavedSlot;

pub(crate) use split_recorder::{RecorderShard, SharedRecorder, SplitRecorder};

use fields::{CommonFields, check_names};
use phases::{OptionsOf, ResetRules, StepRules};

/// Many environments of one kind, and everything they say in one table.
///
/// ```
/// use swm_core::testing::TOY;
/// use swm_core::{ResetOptions, Rollout, World, WorldOptions, policies};
///
/// let mut world = World::new(&TOY, WorldOptions::new(4))?;
/// world.set_policy(policies::random())?;
///
/// // By hand: every environment at once.
/// world.reset(42, &ResetOptions::default())?;
/// world.step()?;
/// assert_eq!(world.infos().rows(), 4);
///
/// // Or whole episodes: these ten, whatever the number of environments and threads.
/// let evaluation = world.evaluate(&Rollout::new(0..10).seed(42))?;
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
    fields: CommonFields,
    judge: Option<Judge>,
    frames: Option<Frames>,
    policy_seed: u64,
    pace: Pace,
    pub(crate) threads: Threads,
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
        let threads = match Threads::new(options.threads) {
            Ok(threads) => threads,
            Err(error) => return wrong("threads", error.to_string()),
        };
        let mut slots = (0..options.num_envs)
            .map(|_| entry.make(&options.env).map(Slot::new))
            .collect::<Result<Vec<_>, _>>()?;
        let spec = slots[0].env().spec().clone();
        check_names(&spec.fields)?;
        let every = options.checkpoints.map(|every| every as usize);
        let checkpoints = every.map(|every| phases::checkpoints(&mut slots[0], every)).transpose()?;
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
            fields,
            judge: None,
            frames: None,
            policy_seed: 0,
            pace,
            threads,
        })
    }

    /// The table entry that the environments were made from.
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

    /// The table of everything: row `i` is environment `i`. Holds the last reset's or step's values.
    pub fn infos(&self) -> &Batch {
        &self.infos
    }

    /// Changes the time limit of the episodes to come, and returns the old one.
    pub fn set_max_episode_steps(&mut self, limit: Option<u64>) -> Option<u64> {
        std::mem::replace(&mut self.options.max_episode_steps, limit)
    }

    /// What a policy sees.
    pub fn view(&self) -> View<'_> {
        View {
            infos: &self.infos,
            spec: &self.spec,
            slots: &self.slots,
            seed: self.policy_seed,
            threads: &self.threads,
            cancel: None,
        }
    }

    /// The episode of one slot so far: live, or over since the last step.
    ///
    /// # Panics
    /// If there is no such slot.
    pub fn episode(&self, slot: usize) -> Option<EpisodeEnd> {
        self.slots[slot].progress.as_ref().map(Progress::summary)
    }

    /// Image coordinates of moving objects in a slot: see [`Env::keypoints`](crate::Env::keypoints).
    ///
    /// # Panics
    /// If there is no such slot.
    pub fn keypoints(&self, slot: usize) -> Vec<Keypoint> {
        self.slots[slot].env.keypoints()
    }

    /// How far a slot's task is from done: see [`Env::task_cost`](crate::Env::task_cost).
    ///
    /// # Panics
    /// If there is no such slot.
    pub fn task_cost(&self, slot: usize) -> Option<f64> {
        self.slots[slot].env.task_cost()
    }

    /// Attaches the policy that `step` and `run` ask for actions. Its own fields, if it has any, become the last of
    /// the infos.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Unsupported`]: one of its fields has the name of another. The policy that was attached before stays.
    pub fn set_policy(&mut self, policy: impl Policy + 'static) -> Result<(), WorldError> {
        self.exchange_policy(policy).map(drop)
    }

    /// As [`World::set_policy`]; returns the table of infos that another one replaced, which happens where the fields change.
    /// For bindings that hold addresses of its columns.
    ///
    /// # Errors
    ///
    /// As of [`World::set_policy`].
    pub fn exchange_policy(&mut self, policy: impl Policy + 'static) -> Result<Option<Batch>, WorldError> {
        let replaced = self.make_room(policy.fields()).map_err(|error| {
            let (policy, reason) = (policy.describe(), error.to_string());
            PolicyError::Unsupported { policy, reason }
        })?;
        self.policy = Some(Box::new(policy));
        Ok(replaced)
    }

    /// Frees the environments and returns the infos. For bindings that hold addresses of their columns.
    pub fn into_infos(self) -> Batch {
        self.infos
    }

    /// Replaces the last policy's fields of the infos by `fields`; all others keep their values. Returns the replaced table.
    fn make_room(&mut self, fields: Vec<Field>) -> Result<Option<Batch>, BatchError> {
        let kept = self.fields.of_policy();
        let old = self.infos.schema().fields();
        if fields == old[kept..] {
            return Ok(None);
        }
        check_names(&fields)?;
        let all: Vec<Field> = old[..kept].iter().chain(&fields).cloned().collect();
        let mut infos = Batch::new(Schema::new(all)?, self.slots.len());
        for index in 0..kept {
            assert!(infos.column_mut(index).copy_from(self.infos.column(index)), "the field is the same");
        }
        self.report = Batch::new(Schema::new(fields)?, self.slots.len());
        Ok(Some(std::mem::replace(&mut self.infos, infos)))
    }

    /// Lets `rule` decide what success is, at every step from the start on, in place of the environment: its own success
    /// then neither counts nor ends an episode. The environment's own rule gives it back.
    ///
    /// # Errors
    ///
    /// The rule names a field or an element that the infos lack.
    pub fn set_success(&mut self, rule: &SuccessRule) -> Result<(), WorldError> {
        self.judge = rule.judge(self.infos.schema())?;
        Ok(())
    }

    /// What renders its images: see [`Env::renderer`](crate::Env::renderer).
    pub fn renderer(&self) -> Option<String> {
        self.slots.first().and_then(|slot| slot.env().renderer())
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

    /// Resets every environment: slot `i` begins episode `i` of the run with seed `seed`.
    ///
    /// # Errors
    ///
    /// Unknown factors, values out of bounds or that break a constraint, start or goal columns that the environment does not take.
    pub fn reset(&mut self, seed: u64, options: &ResetOptions) -> Result<(), WorldError> {
        for (index, slot) in (0..).zip(&mut self.slots) {
            slot.next = Some(LiveEpisode::of(seed, index));
        }
        self.reset_phase(&|_, _| options)
    }

    /// Resets chosen slots, each to an episode of its own with options of its own; the others keep their episodes. For
    /// auto-reset and vector environments.
    ///
    /// # Errors
    ///
    /// No such slot, or one twice: nothing has been reset then. As [`World::reset`].
    pub fn reset_slots(&mut self, resets: &[(usize, LiveEpisode, &ResetOptions)]) -> Result<(), WorldError> {
        let mut options: Vec<Option<&ResetOptions>> = vec![None; self.slots.len()];
        for &(slot, _, given) in resets {
            let taken = options.get_mut(slot).is_none_or(|place| place.replace(given).is_some());
            if taken {
                let reason = format!("slot {slot} of {} is not there, or named twice", self.slots.len());
                return Err(WorldError::Option { option: "reset_slots", reason });
            }
        }
        for &(slot, episode, _) in resets {
            self.slots[slot].next = Some(episode);
        }
        self.reset_phase(&|slot, _| options[slot].expect("only slots with options have a next episode"))
    }

    /// Asks the policy for actions and steps every environment whose episode is not over; the others keep their last row until
    /// they are reset.
    ///
    /// # Errors
    ///
    /// No policy is attached; no environment is in an episode ([`WorldError::NoEpisode`]); the policy fails; an action is outside of
    /// the space (NaN, say). The lowest slot's error is given.
    pub fn step(&mut self) -> Result<(), WorldError> {
        if self.policy.is_none() {
            return Err(WorldError::NoPolicy);
        }
        self.check_live(None)?;
        self.act(None)?;
        self.step_phase(None)
    }

    /// The actions of the last step, `[N, …action shape]` of the action space's type. Those of idle slots mean nothing.
    pub fn actions(&self) -> Slice<'_> {
        self.actions.as_slice()
    }

    /// Steps with given actions, `[N, …action shape]` of the action space's type.
    ///
    /// # Errors
    ///
    /// No environment is in an episode, another number or type of values, or an action outside of the space; nothing has been
    /// stepped then.
    pub fn step_with(&mut self, actions: Slice<'_>) -> Result<(), WorldError> {
        self.check_live(None)?;
        self.take_actions(actions, None)?;
        self.step_phase(None)
    }

    /// Steps the slots that `mask` (`[N]`) chooses, as far as they are live, with given actions: see
    /// [`World::step_with`]. The others stay as they are.
    ///
    /// # Errors
    ///
    /// A mask of another length. As [`World::step_with`], where the mask chooses a slot.
    pub fn step_slots(&mut self, mask: &[bool], actions: Slice<'_>) -> Result<(), WorldError> {
        if mask.len() != self.slots.len() {
            let reason = format!("{} values for {} environments", mask.len(), self.slots.len());
            return Err(WorldError::Option { option: "mask", reason });
        }
        self.check_live(Some(mask))?;
        self.take_actions(actions, Some(mask))?;
        self.step_phase(Some(mask))
    }

    /// Refuses a step that would step nothing, unless `mask` chooses no slot.
    fn check_live(&self, mask: Option<&[bool]>) -> Result<(), WorldError> {
        let is_chosen = |index: usize| mask.is_none_or(|mask| mask[index]);
        let mut chosen =
            self.slots.iter().enumerate().filter(|&(index, _)| is_chosen(index)).map(|(_, slot)| slot);
        if chosen.clone().any(Slot::is_live) || chosen.clone().next().is_none() {
            return Ok(());
        }
        let reason = match chosen.all(|slot| slot.progress.is_none()) {
            true => "no episode has begun",
            false => "the episodes of all environments that it would step are over",
        };
        Err(WorldError::NoEpisode { reason })
    }

    fn reset_phase(&mut self, options: OptionsOf<'_>) -> Result<(), WorldError> {
        if self.slots.iter().all(|slot| slot.next.is_none()) {
            return Ok(());
        }
        let Self { slots, infos, fields, judge, frames, threads, .. } = self;
        let rules = ResetRules { fields: *fields, judge: judge.as_ref(), frames: frames.as_ref() };
        phases::reset_all(slots, &mut infos.rows_mut(), options, &rules, threads)
    }

    fn step_phase(&mut self, mask: Option<&[bool]>) -> Result<(), WorldError> {
        let Self { options, slots, infos, actions, fields, judge, frames, pace, threads, .. } = self;
        let rules = StepRules {
            frame_skip: options.frame_skip,
            max_steps: options.max_episode_steps,
            mask,
            reset: ResetRules { fields: *fields, judge: judge.as_ref(), frames: frames.as_ref() },
        };
        phases::step_all(slots, &mut infos.rows_mut(), actions.as_slice(), &rules, pace, threads)
    }
}

/// What a policy for the environments of a world is made for.
impl<'a> From<&'a World> for PolicyContext<'a> {
    fn from(world: &'a World) -> Self {
        Self::new(&world.entry, &world.options.env).frame_skip(world.options.frame_skip)
    }
}
