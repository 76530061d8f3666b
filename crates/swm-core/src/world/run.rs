//! The one loop. It names exactly which episodes run; a slot whose episode ends takes the next index or idles.
//! No bias toward short episodes, no auto-reset modes.

use std::sync::Arc;

use super::World;
use super::lanes::{self, Upcoming};
use super::split_recorder::{SharedRecorder, SplitRecorder};
use crate::batch::Slice;
use crate::error::WorldError;
use crate::policy::View;
use crate::recorder::{LiveStep, Recorder};
use crate::run::{Cancel, LiveEpisode, Rollout, RunInfo, Slot};

/// What a driver without a policy is called in records.
const EXTERNAL: &str = "external";

/// A rollout under way, driven from outside: whoever holds it chooses the actions, on the thread it likes.
///
/// ```
/// use swm_core::testing::TOY;
/// use swm_core::{Column, Dtype, Rollout, World, WorldOptions};
///
/// let mut world = World::new(&TOY, WorldOptions::new(4).max_episode_steps(20))?;
/// let rollout = Rollout::new(0..10).seed(42);
/// let mut recorder = ();
/// let mut run = world.begin(&rollout, &mut recorder)?;
/// while let Some(view) = run.needs_actions() {
///     let states = view.infos().get::<f64>("state")?;
///     let actions: Vec<f32> = states.iter().map(|&state| -state.clamp(-1.0, 1.0) as f32).collect();
///     run.set_actions(Column::F32(actions).as_slice())?;
///     run.advance()?;
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// It ends when [`Run::needs_actions`] says `None`. A run that is dropped before is cut off: its recorder is not finished,
/// and what it committed stays.
pub struct Run<'a> {
    pub(super) world: &'a mut World,
    pub(super) rollout: &'a Rollout,
    pub(super) recorder: &'a mut dyn Recorder,
    pub(super) upcoming: Arc<Upcoming>,
    pub(super) started: bool,
    pub(super) has_actions: bool,
}

impl World {
    /// Runs the episodes of `rollout` under the attached policy, watched by `recorder` (`&mut ()`: by nobody). What comes out
    /// does not depend on the number of environments and threads; the order in which the recorder sees steps of different
    /// episodes does.
    ///
    /// # Errors
    ///
    /// As [`World::reset`] and [`World::step`]; fewer reset options than episodes; [`WorldError::Cancelled`]; whatever the
    /// recorder meets. With several threads and a policy that can be divided ([`Policy::divide`](crate::Policy::divide)), the failure of the
    /// first episode that fails is given, and all before it go on to their ends.
    pub fn run(&mut self, rollout: &Rollout, recorder: &mut dyn Recorder) -> Result<(), WorldError> {
        self.run_split(rollout, &mut SharedRecorder::new(recorder))
    }

    /// As [`World::run`], with a recorder that may have a shard per environment.
    pub(crate) fn run_split(
        &mut self,
        rollout: &Rollout,
        recorder: &mut dyn SplitRecorder,
    ) -> Result<(), WorldError> {
        let divides = self.policy.as_ref().ok_or(WorldError::NoPolicy)?.is_parallel();
        let threads = self.threads.clone();
        let mut drive = || {
            let mut run = self.begin(rollout, recorder)?;
            if run.needs_actions().is_none() {
                return Ok(());
            }
            run.act()?;
            run.prepare()?;
            let upcoming = Arc::clone(&run.upcoming);
            if let Some(result) = lanes::run(self, rollout, &upcoming, recorder) {
                return result;
            }
            let mut run = Run { world: self, rollout, recorder, upcoming, started: true, has_actions: true };
            while run.needs_actions().is_some() {
                if !run.has_actions {
                    run.act()?;
                }
                run.advance()?;
            }
            Ok(())
        };
        // The whole loop moves to the world's threads at once, so that no step pays for a hand-over.
        if threads.is_one() && !divides { drive() } else { threads.install(drive) }
    }

    /// Resets the first episodes of `rollout`, and leaves the rest to the caller: see [`Run`].
    ///
    /// # Errors
    ///
    /// As [`World::reset`]; fewer reset options than episodes.
    pub fn begin<'a>(
        &'a mut self,
        rollout: &'a Rollout,
        recorder: &'a mut dyn Recorder,
    ) -> Result<Run<'a>, WorldError> {
        rollout.check()?;
        let upcoming = Arc::new(Upcoming::new(rollout.episodes.clone()));
        self.slots.iter_mut().for_each(|slot| slot.progress = None);
        let mut run = Run { world: self, rollout, recorder, upcoming, started: false, has_actions: false };
        run.begin_due()?;
        run.finish_if_over()?;
        Ok(run)
    }
}

impl Run<'_> {
    /// What a policy sees; `None` when all episodes are over.
    pub fn needs_actions(&self) -> Option<View<'_>> {
        let is_live = self.world.slots.iter().any(Slot::is_live);
        is_live.then(|| View { cancel: self.rollout.cancelled_by(), ..self.world.view() })
    }

    /// Takes the actions of this step, `[N, …action shape]` of the action space's type. Those of idle slots are ignored.
    ///
    /// # Errors
    ///
    /// As [`World::step_with`].
    pub fn set_actions(&mut self, actions: Slice<'_>) -> Result<(), WorldError> {
        self.world.take_actions(actions, None)?;
        self.has_actions = true;
        Ok(())
    }

    /// Asks the attached policy for the actions of this step.
    ///
    /// # Errors
    ///
    /// No policy is attached, the policy fails, or an action is outside of the space.
    pub fn act(&mut self) -> Result<(), WorldError> {
        let cancel = self.rollout.cancelled_by();
        self.world.act(cancel).map_err(|error| match cancel {
            // A policy that stops for this cause says so in its own words.
            Some(cancel) if cancel.is_cancelled() => WorldError::Cancelled,
            _ => error,
        })?;
        self.has_actions = true;
        Ok(())
    }

    /// Records this step of every live episode, steps them, and begins the episodes that are due.
    ///
    /// # Errors
    ///
    /// [`WorldError::NoActions`], [`WorldError::Cancelled`], a failure of an environment, or whatever the recorder meets. The
    /// run is over then.
    pub fn advance(&mut self) -> Result<(), WorldError> {
        self.step()?;
        self.begin_due()?;
        self.finish_if_over()
    }

    /// Makes sure that a step may be taken, and that the recorder knows of the run.
    fn prepare(&mut self) -> Result<(), WorldError> {
        if self.rollout.cancelled_by().is_some_and(Cancel::is_cancelled) {
            return Err(WorldError::Cancelled);
        }
        if !self.has_actions {
            return Err(WorldError::NoActions);
        }
        self.start()
    }

    /// Records this step of every live episode, steps them, and tells of those that are over.
    pub(super) fn step(&mut self) -> Result<(), WorldError> {
        self.prepare()?;
        self.has_actions = false;
        self.record(Slot::is_live)?;
        self.world.step_phase(None)?;
        self.record(|slot| slot.finished().is_some())?;
        for slot in &mut self.world.slots {
            let Some(progress) = slot.finished() else { continue };
            self.recorder.episode(&progress.summary()).map_err(WorldError::Record)?;
            slot.progress = None;
        }
        Ok(())
    }

    /// Begins an episode in every slot that has none, as long as some are left.
    pub(super) fn begin_due(&mut self) -> Result<(), WorldError> {
        let rollout = self.rollout;
        for slot in self.world.slots.iter_mut().filter(|slot| slot.progress.is_none()) {
            slot.next = self.upcoming.take().map(|index| LiveEpisode::of(rollout.seed, index));
        }
        self.world.reset_phase(&|_, episode| rollout.options_of(episode))
    }

    /// Where no episode is live, the run is over.
    fn finish_if_over(&mut self) -> Result<(), WorldError> {
        if self.world.slots.iter().any(Slot::is_live) {
            return Ok(());
        }
        self.start()?;
        self.recorder.finish().map_err(WorldError::Record)
    }

    /// Tells the recorder of the run, once. This comes after the first reset and the first actions, so that a request
    /// that cannot be met leaves no file behind.
    fn start(&mut self) -> Result<(), WorldError> {
        if std::mem::replace(&mut self.started, true) {
            return Ok(());
        }
        let policy = self.world.policy_description();
        let renderer = self.world.renderer();
        let info = RunInfo {
            spec: &self.world.spec,
            schema: self.world.infos.schema(),
            options: &self.world.options,
            rollout: self.rollout,
            policy: policy.as_deref().unwrap_or(EXTERNAL),
            renderer: renderer.as_deref(),
        };
        self.recorder.start(&info).map_err(WorldError::Record)
    }

    /// Shows the chosen slots to the recorder, in their order.
    fn record(&mut self, chosen: impl Fn(&Slot) -> bool) -> Result<(), WorldError> {
        for (index, slot) in self.world.slots.iter().enumerate().filter(|(_, slot)| chosen(slot)) {
            let progress = slot.progress.as_ref().expect("chosen slots have an episode");
            let (episode, success) = (progress.episode, progress.success_now);
            let row = LiveStep { values: self.world.infos.row(index), episode, success, env: slot.env() };
            self.recorder.step(&row).map_err(WorldError::Record)?;
        }
        Ok(())
    }
}
