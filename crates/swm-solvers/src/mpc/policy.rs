//! The policy: queues of planned actions, one per environment, refilled by the solver when they are empty.

use std::any::Any;
use std::cmp::Reverse;
use std::sync::Arc;
use std::time::Instant;

use serde_json::Map;
use swm_core::settings::describe;
use swm_core::{Actions, Field, LiveEpisode, Policy, PolicyError, Schema, Settings as _, Space, View};

use super::config::PlanConfig;
use crate::context::{ActionMap, ActionScale, History, PlanningContext};
use crate::cost::Cost;
use crate::error::PlanError;
use crate::problem::{Plan, PlanKey, Problem};
use crate::settings::Validate as _;
use crate::solver::Solver;
use crate::trace::{NoTrace, Trace};
use crate::workspace::Workspace;

/// Plans with a solver and a cost, executes R blocks, and plans again.
///
/// All its state belongs to an episode and is cleared when the next one begins. Environments whose episode is over are
/// never planned for.
/// ```
/// use swm_core::testing::TOY;
/// use swm_core::{EnvConfig, Rollout, World, WorldOptions};
/// use swm_solvers::{Cem, MpcPolicy, PlanConfig, SimulatorCost, SimulatorOptions};
///
/// // Plans on the environment's true dynamics; any other `Cost` can replace it.
/// let cost = SimulatorCost::new(&TOY, &EnvConfig::default(), SimulatorOptions::default())?;
/// let solver = Cem { samples: 30, iterations: 5, elites: 5, ..Cem::default() };
/// let config = PlanConfig { horizon: 5, receding_horizon: 1, action_block: 1, ..PlanConfig::default() };
/// let mut world = World::new(&TOY, WorldOptions::default().max_episode_steps(20))?;
/// world.set_policy(MpcPolicy::new(Box::new(solver), Box::new(cost), config)?);
///
/// let rollout = Rollout::new(0..4).seed(42);
/// assert_eq!(world.evaluate(&rollout)?.success_rate, 100.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct MpcPolicy {
    config: PlanConfig,
    tools: Tools,
    scale: Option<ActionScale>,
    history_fields: Vec<String>,
    /// What depends on the environment, found at the first action.
    setup: Option<Setup>,
    /// `[N]` each.
    slots: Vec<Slot>,
    histories: Vec<Option<History>>,
    search: Search,
}

/// What plans are made with.
struct Tools {
    solver: Box<dyn Solver>,
    cost: Box<dyn Cost>,
    trace: Box<dyn Trace>,
}

/// What the policy needs to know of the environment.
struct Setup {
    space: Space,
    schema: Arc<Schema>,
    map: Arc<ActionMap>,
    /// Positions of the history's fields in the infos.
    history: Vec<usize>,
}

/// The state of one environment's episode.
#[derive(Default)]
struct Slot {
    episode: Option<u64>,
    plans: u64,
    /// `[R × k, A]`: actions to execute; the first `taken` values are done.
    queue: Vec<f32>,
    taken: usize,
    /// `[H - R, D]`: the unexecuted rest of the last plan.
    rest: Vec<f32>,
    /// Blocks of the last plan that are not executed yet, where the horizon shrinks.
    ahead: usize,
    /// The solver's state of the episode.
    memory: Vec<f64>,
}

impl Slot {
    fn begin(&mut self, episode: LiveEpisode) {
        self.episode = Some(episode.index);
        self.plans = 0;
        self.queue.clear();
        self.taken = 0;
        self.rest.clear();
        self.ahead = 0;
        self.memory.clear();
    }

    /// Blocks of its next plan.
    fn horizon(&self, config: &PlanConfig) -> usize {
        if self.ahead > 0 { self.ahead } else { config.horizon }
    }
}

/// Buffers of one round of planning.
#[derive(Default)]
struct Search {
    /// The slots that need a plan, by the blocks that theirs has: the longest first.
    waiting: Vec<(Reverse<usize>, usize)>,
    /// Those that are planned for together.
    slots: Vec<usize>,
    keys: Vec<PlanKey>,
    initial: Vec<f32>,
    memory: Vec<Vec<f64>>,
    workspace: Workspace,
    plan: Plan,
}

/// The planner of a policy that plans: on the true dynamics, or on a model of any crate.
pub fn planner_of(policy: &mut dyn Policy) -> Option<&mut MpcPolicy> {
    policy.as_any()?.downcast_mut()
}

impl MpcPolicy {
    /// A policy that minimizes `cost` with `solver`: `config.horizon` blocks of `config.action_block` actions, of which
    /// `config.receding_horizon` are executed before it plans again.
    ///
    /// # Errors
    ///
    /// A setting of `config` is 0, or more blocks would be executed than are planned.
    pub fn new(solver: Box<dyn Solver>, cost: Box<dyn Cost>, config: PlanConfig) -> Result<Self, PlanError> {
        config.validate()?;
        let history_fields = cost.history_fields();
        Ok(Self {
            config,
            tools: Tools { solver, cost, trace: Box::new(NoTrace) },
            scale: None,
            history_fields,
            setup: None,
            slots: Vec::new(),
            histories: Vec::new(),
            search: Search::default(),
        })
    }

    /// Plans in units of `scale`: those that the model of the cost was trained with. Without it, plans are in the units
    /// of the environment.
    #[must_use]
    pub fn with_scale(mut self, scale: ActionScale) -> Self {
        self.scale = Some(scale);
        self
    }

    /// Reports every plan to `trace`. Plans do not change.
    #[must_use]
    pub fn with_trace(mut self, trace: impl Trace + 'static) -> Self {
        self.set_trace(trace);
        self
    }

    /// As [`MpcPolicy::with_trace`], of a policy that is in use.
    pub fn set_trace(&mut self, trace: impl Trace + 'static) {
        self.tools.trace = Box::new(trace);
    }

    /// How long plans are and how much of each is executed.
    pub fn config(&self) -> &PlanConfig {
        &self.config
    }

    /// The map from values of its plans to actions of `space`.
    ///
    /// # Errors
    ///
    /// As of [`ActionMap::scaled`], where the policy has a scale.
    pub fn actions(&self, space: &Space) -> Result<ActionMap, PlanError> {
        match &self.scale {
            Some(scale) => ActionMap::scaled(space, scale, self.config.clip_actions),
            None => Ok(ActionMap::new(space, self.config.clip_actions)),
        }
    }

    /// Learns what it needs to know of the environment, at the first action and whenever the world is another.
    fn prepare(&mut self, view: &View<'_>, space: &Space) -> Result<(), PolicyError> {
        let schema = view.infos().schema();
        let known = |setup: &Setup| Arc::ptr_eq(&setup.schema, schema) && setup.space == *space;
        if !self.setup.as_ref().is_some_and(known) {
            let map = Arc::new(self.actions(space)?);
            self.tools.solver.check(map.space())?;
            // A policy that keeps no history needs none of its fields: what is missing then is the cost's to say.
            let wanted = if self.config.history_len > 1 { self.history_fields.as_slice() } else { &[] };
            let history = wanted.iter().map(|name| schema.require(name));
            let history = history.collect::<Result<_, _>>()?;
            self.setup = Some(Setup { space: space.clone(), schema: Arc::clone(schema), map, history });
            self.slots.clear();
            self.histories.clear();
        }
        self.slots.resize_with(view.rows(), Slot::default);
        self.histories.resize_with(view.rows(), || None);
        Ok(())
    }
}

impl Policy for MpcPolicy {
    fn describe(&self) -> String {
        let Tools { solver, cost, .. } = &self.tools;
        let mut settings = Map::new();
        for part in [solver.changed_settings(), self.config.changed(), cost.changed_settings()] {
            settings.extend(part);
        }
        describe(solver.name(), &settings)
    }

    fn fields(&self) -> Vec<Field> {
        self.config.report.fields()
    }

    fn as_any(&mut self) -> Option<&mut dyn Any> {
        Some(self)
    }

    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        self.prepare(view, actions.space())?;
        let Self { config, tools, setup, slots, histories, search, .. } = self;
        let setup = setup.as_ref().expect("prepared above");
        let dim = setup.map.dim();
        let mut waiting = std::mem::take(&mut search.waiting);
        waiting.clear();
        for index in view.live() {
            let Some(live) = view.row(index) else { continue };
            let (slot, history) = (&mut slots[index], &mut histories[index]);
            if live.episode.step == 0 || slot.episode != Some(live.episode.index) {
                slot.begin(live.episode);
                history.iter_mut().for_each(History::clear);
            }
            if config.history_len > 1 {
                let history = history.get_or_insert_with(|| {
                    History::new(config.history_len, config.action_block, dim, view.infos(), &setup.history)
                });
                history.observe(live.row, &setup.history);
            }
            if slot.taken == slot.queue.len() {
                waiting.push((Reverse(slot.horizon(config)), index));
            }
        }
        waiting.sort_unstable();
        for alike in waiting.chunk_by(|(one, _), (other, _)| one == other) {
            let (Reverse(horizon), started) = (alike[0].0, Instant::now());
            search.slots.clear();
            search.slots.extend(alike.iter().map(|&(_, index)| index));
            search.run(config, horizon, tools, setup, view, slots, histories)?;
            config.report.write(&search.slots, &search.plan, started.elapsed(), actions);
        }
        search.waiting = waiting;
        for index in view.live() {
            let slot = &mut slots[index];
            let planned = &slot.queue[slot.taken..][..dim];
            setup.map.write(planned, &mut actions.row(index));
            if let Some(history) = &mut histories[index] {
                history.acted(planned, &setup.map);
            }
            slot.taken += dim;
        }
        Ok(())
    }
}

impl Search {
    /// Plans `horizon` blocks for all chosen slots together and refills their queues.
    #[expect(clippy::too_many_arguments, reason = "the parts of a policy, borrowed apart")]
    fn run(
        &mut self,
        config: &PlanConfig,
        horizon: usize,
        tools: &mut Tools,
        setup: &Setup,
        view: &View<'_>,
        all: &mut [Slot],
        histories: &[Option<History>],
    ) -> Result<(), PlanError> {
        let Self { slots, keys, initial, memory, workspace, plan, .. } = self;
        let dim = config.action_block * setup.map.dim();
        let size = horizon * dim;
        keys.clear();
        initial.clear();
        initial.resize(slots.len() * size, 0.0);
        memory.resize_with(slots.len(), Vec::new);
        for ((&index, initial), memory) in slots.iter().zip(initial.chunks_exact_mut(size)).zip(&mut *memory)
        {
            let episode = view.row(index).expect("only live environments are planned for").episode;
            let slot = &all[index];
            keys.push(PlanKey::of(episode, slot.plans));
            initial[..slot.rest.len()].copy_from_slice(&slot.rest);
            memory.clone_from(&slot.memory);
        }
        tools.cost.prepare(&PlanningContext { view: *view, slots, histories, actions: &setup.map })?;
        tools.cost.propose(horizon, initial)?;
        let problem = Problem {
            keys,
            horizon,
            action_block: config.action_block,
            action: setup.map.space(),
            initial,
            memory,
        };
        let Tools { solver, cost, trace } = tools;
        solver.solve(&problem, cost.as_mut(), workspace, trace.as_mut(), plan)?;
        let plans = plan.actions.chunks_exact(size).zip(&plan.memory);
        for (&index, (actions, memory)) in slots.iter().zip(plans) {
            let slot = &mut all[index];
            let executed = config.receding_horizon.min(horizon);
            let (now, later) = actions.split_at(executed * dim);
            if config.shrinking_horizon {
                // What a solver remembers is of the size of its plan, and the next has another.
                slot.ahead = horizon - executed;
                slot.memory.clear();
            } else {
                slot.memory.clone_from(memory);
            }
            slot.plans += 1;
            slot.taken = 0;
            slot.queue.clear();
            slot.queue.extend_from_slice(now);
            slot.rest.clear();
            if config.warm_start {
                slot.rest.extend_from_slice(later);
            }
        }
        Ok(())
    }
}
