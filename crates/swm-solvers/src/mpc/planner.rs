//! What an [`MpcPolicy`](crate::MpcPolicy) and an [`Mpc`](crate::Mpc) share: queues of planned actions, one per row, refilled by
//! the solver when they are empty.

use std::cmp::Reverse;
use std::sync::Arc;
use std::time::{Duration, Instant};

use swm_core::{LiveEpisode, Schema, Space, View};

use super::config::PlanConfig;
use crate::context::{ActionMap, ActionScale, History, PlanningContext};
use crate::cost::Cost;
use crate::error::PlanError;
use crate::problem::{Plan, PlanKey, Problem};
use crate::settings::Validate as _;
use crate::solver::Solver;
use crate::trace::{NoTrace, Trace};
use crate::workspace::Workspace;

/// Plans with a solver, hands out R blocks of each plan, and plans again. All its state but buffers belongs to an episode and
/// is cleared when the next one begins.
pub(super) struct Planner {
    pub(super) config: PlanConfig,
    pub(super) solver: Box<dyn Solver>,
    pub(super) trace: Box<dyn Trace>,
    pub(super) scale: Option<ActionScale>,
    /// What depends on the environment, found at the first action.
    setup: Option<Setup>,
    /// `[N]` each.
    slots: Vec<Slot>,
    histories: Vec<Option<History>>,
    search: Search,
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

impl Planner {
    /// A planner with `solver`.
    ///
    /// # Errors
    ///
    /// A setting of `config` is 0, or more blocks would be executed than are planned.
    pub(super) fn new(solver: Box<dyn Solver>, config: PlanConfig) -> Result<Self, PlanError> {
        config.validate()?;
        Ok(Self {
            config,
            solver,
            trace: Box::new(NoTrace),
            scale: None,
            setup: None,
            slots: Vec::new(),
            histories: Vec::new(),
            search: Search::default(),
        })
    }

    /// The map from values of its plans to actions of `space`.
    pub(super) fn actions(&self, space: &Space) -> Result<ActionMap, PlanError> {
        match &self.scale {
            Some(scale) => ActionMap::scaled(space, scale, self.config.clip_actions),
            None => Ok(ActionMap::new(space, self.config.clip_actions)),
        }
    }

    /// Ends the searches to come at this time.
    pub(super) fn set_deadline(&mut self, deadline: Option<Instant>) {
        self.search.workspace.deadline = deadline;
    }

    /// The last plan that was made; empty before the first.
    pub(super) fn last_plan(&self) -> &Plan {
        &self.search.plan
    }

    /// Learns what it needs to know of the environment, at the first action and whenever the rows are of another table.
    fn prepare(&mut self, cost: &dyn Cost, view: &View<'_>) -> Result<(), PlanError> {
        let (schema, space) = (view.infos().schema(), &view.spec().action);
        let known = |setup: &Setup| Arc::ptr_eq(&setup.schema, schema) && setup.space == *space;
        if !self.setup.as_ref().is_some_and(known) {
            let map = Arc::new(self.actions(space)?);
            self.solver.check(map.space())?;
            // A planner that keeps no history needs none of its fields: the cost reports what else is missing.
            let wanted = if self.config.history_len > 1 { cost.history_fields() } else { Vec::new() };
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

    /// Plans for every live row whose queue is empty; `planned(slots, plan, time)` gets those of each round. Every live row then
    /// has an action to [take](Planner::take).
    pub(super) fn plan(
        &mut self,
        cost: &mut dyn Cost,
        view: &View<'_>,
        planned: &mut dyn FnMut(&[usize], &Plan, Duration),
    ) -> Result<(), PlanError> {
        self.prepare(cost, view)?;
        let mut waiting = std::mem::take(&mut self.search.waiting);
        waiting.clear();
        let Self { config, setup, slots, histories, .. } = self;
        let setup = setup.as_ref().expect("prepared above");
        for index in view.live() {
            let Some(live) = view.row(index) else { continue };
            let (slot, history) = (&mut slots[index], &mut histories[index]);
            if live.episode.step == 0 || slot.episode != Some(live.episode.index) {
                slot.begin(live.episode);
                history.iter_mut().for_each(History::clear);
            }
            if config.history_len > 1 {
                let history = history.get_or_insert_with(|| {
                    let (frames, block) = (config.history_len, config.action_block);
                    History::new(frames, block, setup.map.dim(), view.infos(), &setup.history)
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
            self.search.slots.clear();
            self.search.slots.extend(alike.iter().map(|&(_, index)| index));
            self.search_plans(horizon, cost, view)?;
            planned(&self.search.slots, &self.search.plan, started.elapsed());
        }
        self.search.waiting = waiting;
        Ok(())
    }

    /// Whether row `index` has an action left of its plan.
    pub(super) fn has_action(&self, index: usize) -> bool {
        self.slots.get(index).is_some_and(|slot| slot.taken < slot.queue.len())
    }

    /// Takes the next action of row `index`: `write` gets its values in the plan, `[A]`.
    pub(super) fn take(&mut self, index: usize, write: impl FnOnce(&ActionMap, &[f32])) {
        let setup = self.setup.as_ref().expect("a plan was made");
        let (slot, dim) = (&mut self.slots[index], setup.map.dim());
        let values = &slot.queue[slot.taken..][..dim];
        write(&setup.map, values);
        if let Some(history) = &mut self.histories[index] {
            history.acted(values, &setup.map);
        }
        slot.taken += dim;
    }

    /// Plans `horizon` blocks for all chosen slots together and refills their queues.
    fn search_plans(
        &mut self,
        horizon: usize,
        cost: &mut dyn Cost,
        view: &View<'_>,
    ) -> Result<(), PlanError> {
        let Self { config, solver, trace, setup, slots: all, histories, search, .. } = self;
        let setup = setup.as_ref().expect("prepared before");
        let Search { slots, keys, initial, memory, workspace, plan, .. } = search;
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
        cost.prepare(&PlanningContext { view: *view, slots, histories, actions: &setup.map })?;
        cost.propose(horizon, initial)?;
        let problem = Problem {
            keys,
            horizon,
            action_block: config.action_block,
            action: setup.map.space(),
            initial,
            memory,
        };
        solver.solve(&problem, cost, workspace, trace.as_mut(), plan)?;
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
