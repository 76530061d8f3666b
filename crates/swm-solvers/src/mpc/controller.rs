//! Planning without a `World`, as on a robot: an observation in, an action out.

use std::sync::Arc;
use std::time::{Duration, Instant};

use swm_core::{Batch, BatchError, Column, Dtype, LiveEpisode, Observations, Schema, Space};

use super::config::PlanConfig;
use super::planner::Planner;
use crate::context::ActionScale;
use crate::cost::Cost;
use crate::error::PlanError;
use crate::problem::Plan;
use crate::solver::Solver;
use crate::trace::Trace;

/// Plans, hands out actions one by one, and plans again: the loop of an [`MpcPolicy`](crate::MpcPolicy) without a `World`. With
/// the same cost, observations and seed it chooses the same actions. [The crate](crate) begins with an example.
pub struct Mpc {
    planner: Planner,
    source: Observations,
    /// The last observation: one row.
    rows: Batch,
    has_begun: bool,
    /// Whether the episode has an observation.
    has_observed: bool,
    seed: u64,
    episode: u64,
    deadline: Option<Duration>,
    action: Column,
    /// `[A]`: the same.
    values: Vec<f32>,
}

impl Mpc {
    /// Chooses actions of `action` with `solver`: plans of `config.horizon` blocks of `config.action_block` actions, of which
    /// `config.receding_horizon` blocks are taken before it plans again. A control step that plans takes as long as the solver;
    /// the others take no time. `config.report` is for datasets and has no effect here.
    ///
    /// # Errors
    ///
    /// A setting of `config` or of the solver is out of its bounds, or the solver cannot plan such actions.
    pub fn new(solver: Box<dyn Solver>, config: PlanConfig, action: Space) -> Result<Self, PlanError> {
        solver.check(&action)?;
        let column = Column::zeros(action.dtype().unwrap_or(Dtype::F32), action.dim());
        let values = vec![0.0; action.dim()];
        let mut mpc = Self {
            planner: Planner::new(solver, config)?,
            source: Observations::new(action, 1),
            rows: Batch::new(Arc::default(), 1),
            has_begun: false,
            has_observed: false,
            seed: 0,
            episode: 0,
            deadline: None,
            action: column,
            values,
        };
        mpc.begin();
        Ok(mpc)
    }

    /// The seed of its noise, 0 unless set: episode `e` of this controller has the noise of episode `e` of a run with this seed.
    #[must_use]
    pub fn with_seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self.begin();
        self
    }

    /// Plans in units of `scale`: see [`MpcPolicy::with_scale`](crate::MpcPolicy::with_scale).
    ///
    /// # Errors
    ///
    /// The scale does not fit the actions.
    pub fn with_scale(mut self, scale: ActionScale) -> Result<Self, PlanError> {
        self.planner.scale = Some(scale);
        self.planner.actions(self.source.action())?;
        Ok(self)
    }

    /// Ends a search this long after the call of [`Mpc::next`] began, and takes the best plan so far: that of a solver with as many
    /// iterations as there was time for, one or more. The call takes longer than `time` by up to one iteration and the evaluation
    /// of the plan. How many iterations were made is in [`Plan::iterations`] of [`Mpc::last_plan`]. Plans then depend on the speed of
    /// the machine.
    #[must_use]
    pub fn with_deadline(mut self, time: Duration) -> Self {
        self.deadline = Some(time);
        self
    }

    /// Reports every plan to `trace`. Plans do not change.
    #[must_use]
    pub fn with_trace(mut self, trace: impl Trace + 'static) -> Self {
        self.planner.trace = Box::new(trace);
        self
    }

    /// The next action, `[A]`: numbers of the action space, clipped to it unless `clip_actions` is off; integers as whole numbers. It
    /// plans where the last plan is used up, from what is left of it.
    ///
    /// `observation` is one row of the columns that `cost` reads ([`Cost::prepare`]), with the same columns at every call; `None` where
    /// it reads none, as when the model holds the measured state, and at calls that do not plan. A cost that looks back (`history_len` above 1) gets the
    /// observations of earlier calls, so call this once per control step.
    ///
    /// # Errors
    ///
    /// The observation has other columns than before or lacks one that the cost needs; there is none where the episode had some and a
    /// plan is needed; the solver or the cost fails; the action is not
    /// finite. The episode may go on: a plan that was made before is kept.
    pub fn next<'b>(
        &mut self,
        cost: &mut dyn Cost,
        observation: impl Into<Option<&'b Batch>>,
    ) -> Result<&[f32], PlanError> {
        let deadline = self.deadline.and_then(|time| Instant::now().checked_add(time));
        match observation.into() {
            Some(observation) => self.observe(observation)?,
            None => self.observe_nothing()?,
        }
        self.take_next(cost, deadline)
    }

    fn take_next(&mut self, cost: &mut dyn Cost, deadline: Option<Instant>) -> Result<&[f32], PlanError> {
        let Self { planner, source, rows, action, .. } = self;
        planner.set_deadline(deadline);
        planner.plan(cost, &source.view(rows)?, &mut |_, _, _| {}).map_err(|error| match error {
            PlanError::Batch(BatchError::UnknownField { name, .. }) if rows.schema().fields().is_empty() => {
                not_observed(name, "a column of the observation".to_owned())
            }
            error => error,
        })?;
        planner.take(0, |map, values| map.write(values, &mut action.as_slice_mut()));
        self.source.advance();
        let action = self.action.as_slice();
        for (index, out) in self.values.iter_mut().enumerate() {
            *out = action.as_f64(index).unwrap_or(f64::NAN) as f32;
        }
        if !action.is_finite() {
            let reason = format!("the planned action {:?} is not finite; check the model", self.values);
            return Err(PlanError::Cost(reason.into()));
        }
        Ok(&self.values)
    }

    /// Forgets the plan and what was observed: the next action is the first of a new episode.
    pub fn reset(&mut self) {
        self.episode += 1;
        self.has_observed = false;
        self.begin();
    }

    /// The last plan, of the episode 0 of its arrays; `None` before the first.
    pub fn last_plan(&self) -> Option<&Plan> {
        Some(self.planner.last_plan()).filter(|plan| !plan.iterations.is_empty())
    }

    /// How long plans are and how much of each is taken.
    pub fn config(&self) -> &PlanConfig {
        &self.planner.config
    }

    fn begin(&mut self) {
        self.source.begin(0, LiveEpisode::of(self.seed, self.episode));
    }

    /// Without an observation no plan is made from that of an earlier call.
    fn observe_nothing(&mut self) -> Result<(), PlanError> {
        if !self.has_observed {
            if self.has_begun {
                self.rows = Batch::new(Arc::default(), 1);
                self.has_begun = false;
            }
            return Ok(());
        }
        if self.planner.config.history_len == 1 && self.planner.has_action(0) {
            return Ok(());
        }
        Err(not_observed("the observation".to_owned(), names(self.rows.schema())))
    }

    /// Copies an observation.
    fn observe(&mut self, observation: &Batch) -> Result<(), PlanError> {
        let columns = observation.schema();
        if !self.has_begun {
            self.rows = Batch::new(Arc::clone(columns), 1);
            self.has_begun = true;
        }
        let own = self.rows.schema();
        if !Arc::ptr_eq(own, columns) && own != columns {
            let [expected, found] = [own, columns].map(|schema| names(schema));
            return Err(BatchError::WrongValue { name: "the observation".to_owned(), expected, found }.into());
        }
        self.source.view(observation)?;
        for index in 0..columns.fields().len() {
            assert!(self.rows.column_mut(index).copy_from(observation.column(index)), "one schema has both");
        }
        self.has_observed = true;
        Ok(())
    }
}

/// What a plan needs, and was not given.
fn not_observed(name: String, expected: String) -> PlanError {
    BatchError::WrongValue { name, expected, found: "none: `next` got no observation".to_owned() }.into()
}

/// `a row of state f64 [2], goal f64 [2]`.
fn names(schema: &Schema) -> String {
    let field = |field: &swm_core::Field| format!("{} {} {:?}", field.name, field.dtype, field.shape);
    format!("a row of {}", schema.fields().iter().map(field).collect::<Vec<_>>().join(", "))
}
