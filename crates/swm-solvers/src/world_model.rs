//! World models of a registry: one entry, by whose name a model is measured and planned with.

use std::slice;
use std::sync::{Arc, Mutex, PoisonError};

use serde::Deserialize as _;
use serde_json::{Map, Value as Json};
use swm_core::env::{GOAL_IMAGE, PIXELS};
use swm_core::evaluate::quality::WorldModel;
use swm_core::evaluate::{MakeModel, ModelEntry};
use swm_core::registry::{FilesOf, ImageOf, TrainedOf};
use swm_core::{
    Batch, BoxError, Column, Entry, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Registry,
    Row, Schema, Setting, Settings,
};

use crate::context::{ActionMap, PlanningContext};
use crate::error::PlanError;
use crate::learned::{LearnedCost, SOLVER_SETTING, on_true_dynamics, plan_on};
use crate::models::{Dynamics, Objective, Part, Path, ShootingCost};
use crate::mpc::PlanConfig;
use crate::problem::Candidates;
use crate::simulator::Aggregate;

/// A world model of a registry, which implements [`WorldModel`] alone. With `registry.with(&[MODEL])` every command finds it by its
/// name: `quality --model NAME:ARGS` measures it, and the policy `NAME:ARGS` plans with it by any solver, with its oracle, in
/// evaluations, sweeps and traces. Requests also take it as `mpc:NAME:ARGS` ([`registered_model`](crate::registered_model)).
///
/// A plan's cost is the squared distance of predicted latents from that of the goal, per number of the latent: of the last state, or
/// over all as `aggregate` says. The goal's row is made of the goal's columns: `goal_state` as `state`, `goal` as `pixels`.
///
/// ```
/// use swm_core::evaluate::quality::WorldModel;
/// use swm_core::testing::TOY;
/// use swm_core::{BoxError, EnvConfig, PolicyContext, Registry, Row};
/// use swm_solvers::{SOLVERS, WorldModelEntry};
///
/// /// Knows that an action moves the point by as much.
/// struct Line;
///
/// impl WorldModel for Line {
///     fn latent_dim(&self) -> usize {
///         1
///     }
///     fn encode(&mut self, row: Row<'_>, latent: &mut [f64]) -> Result<(), BoxError> {
///         latent.copy_from_slice(row.get("state")?);
///         Ok(())
///     }
///     fn predict(&mut self, latent: &mut [f64], action: &[f64]) -> Result<(), BoxError> {
///         latent[0] += action[0];
///         Ok(())
///     }
/// }
///
/// static LINE: [WorldModelEntry; 1] =
///     [WorldModelEntry::new("line", "moves by the action", |_, _| Ok(Box::new(Line))).plan("horizon=10")];
/// let registry = Registry::new().with(SOLVERS).with(&LINE);
/// let config = EnvConfig::default();
/// let policy = registry.policy("line:samples=50,receding_horizon=2", PolicyContext::new(&TOY, &config))?;
/// assert!(policy.describe().contains("model=line"));
/// # Ok::<(), swm_core::PolicyError>(())
/// ```
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct WorldModelEntry {
    /// What measures of quality make it by.
    pub model: ModelEntry,
    /// The policy that plans with it.
    pub policy: PolicyEntry,
    /// Its own settings.
    pub settings: &'static [Setting],
    plan: &'static str,
}

/// How the distances of a plan's states from the goal become its cost.
const AGGREGATE: Setting =
    Setting::new("aggregate", "Cost of a plan: last, mean or best distance from the goal", "last");

/// Settings of a planner on a model without settings of its own, as far as they do not depend on the solver.
const OF_PLANS: &[Setting] = &[SOLVER_SETTING, AGGREGATE];

impl WorldModelEntry {
    /// A model without settings that sees no images.
    pub const fn new(name: &'static str, summary: &'static str, make: MakeModel) -> Self {
        let policy = PolicyEntry::new(name, summary, plan_with).settings(OF_PLANS).oracle(oracle);
        Self { model: ModelEntry::new(name, summary, make), policy, settings: &[], plan: "" }
    }

    /// The settings of the model itself, which distinguish them from those of solver and plan. Values without a key, such as a
    /// file, need none.
    #[must_use]
    pub const fn settings(mut self, settings: &'static [Setting]) -> Self {
        self.settings = settings;
        self
    }

    /// Settings of the plan where none are given: `horizon=10,receding_horizon=2`. A block has the model's stride of actions.
    #[must_use]
    pub const fn plan(mut self, settings: &'static str) -> Self {
        self.plan = settings;
        self
    }

    /// What images it was trained on.
    #[must_use]
    pub const fn image(mut self, image: ImageOf) -> Self {
        self.model = self.model.image(image);
        self.policy = self.policy.image(image);
        self
    }

    /// What environment it was trained in.
    #[must_use]
    pub const fn trained(mut self, trained: TrainedOf) -> Self {
        self.model = self.model.trained(trained);
        self.policy = self.policy.trained(trained);
        self
    }

    /// Which files it is made of: those that its arguments name, unless set.
    #[must_use]
    pub const fn files(mut self, files: FilesOf) -> Self {
        self.policy = self.policy.files(files);
        self
    }

    /// The arguments of the model, and the settings of solver and plan with this entry's own defaults.
    fn split(&self, args: &PolicyArgs) -> Result<(PolicyArgs, Map<String, Json>), PolicyError> {
        let is_own = |name: &String| self.settings.iter().any(|setting| setting.name == name);
        let (named, mut given): (Map<_, _>, Map<_, _>) =
            args.named.clone().into_iter().partition(|(name, _)| is_own(name));
        let mut own = PolicyArgs::new(args.name.clone(), named);
        own.positional.clone_from(&args.positional);
        let plan = PolicyArgs::parse(&format!("{}:{}", args.name, self.plan))?.named;
        let solver = |of: &Map<String, Json>| of.get(SOLVER_SETTING.name).cloned();
        let usual = solver(&plan).unwrap_or_else(|| SOLVER_SETTING.default.into());
        let is_other = solver(&given).is_some_and(|asked| asked != usual);
        // Another solver has other settings.
        let is_kept =
            |name: &str| !is_other || PlanConfig::SETTINGS.iter().any(|setting| setting.name == name);
        for (name, value) in plan.into_iter().filter(|(name, _)| is_kept(name)) {
            given.entry(name).or_insert(value);
        }
        Ok((own, given))
    }
}

impl Entry for WorldModelEntry {
    const KIND: &'static str = "world model";
    const COMMAND: &'static str = "quality --help";

    fn name(&self) -> &'static str {
        self.model.name
    }

    fn with_parts(&'static self, registry: Registry) -> Registry {
        registry.with(slice::from_ref(&self.model)).with(slice::from_ref(&self.policy))
    }
}

/// The entry that arguments name.
fn entry_of(context: &PolicyContext<'_>, args: &PolicyArgs) -> Result<&'static WorldModelEntry, PolicyError> {
    let found = context.registry.and_then(|registry| registry.find::<WorldModelEntry>(&args.name).ok());
    found.ok_or_else(|| args.wrong("is a world model that the registry of this policy does not have"))
}

/// The policy of every entry: found by the name of its arguments.
fn plan_with(context: &PolicyContext<'_>, args: &PolicyArgs) -> Result<Box<dyn Policy>, PolicyError> {
    let entry = entry_of(context, args)?;
    let (own, mut given) = entry.split(args)?;
    let aggregate = match given.shift_remove(AGGREGATE.name) {
        Some(value) => Aggregate::deserialize(&value).map_err(|_| {
            args.wrong(format!("setting `{}`: {value}; use last, mean or best", AGGREGATE.name))
        })?,
        None => Aggregate::default(),
    };
    let model = entry.model.make(context, &own)?;
    let block = model.stride();
    let wrong = |error: PlanError| args.wrong(error.to_string());
    let dynamics = ModelDynamics::new(model, own.to_string()).map_err(wrong)?;
    let cost = ShootingCost::new(dynamics, Box::new(Distance { aggregate }), Vec::new()).map_err(wrong)?;
    let learned = LearnedCost::new(Box::new(cost), block).with_settings(&[AGGREGATE]);
    Ok(Box::new(plan_on(context, learned, given).map_err(wrong)?))
}

/// The same planner on the true dynamics.
fn oracle(context: &PolicyContext<'_>, args: &PolicyArgs) -> Option<PolicyArgs> {
    let entry = entry_of(context, args).ok()?;
    let (own, mut given) = entry.split(args).ok()?;
    let block = entry.model.make(context, &own).ok()?.stride();
    given.insert("action_block".to_owned(), block.into());
    on_true_dynamics(context, given)
}

/// A [`WorldModel`] as dynamics of plans: its latents, `[Z]`, are the states. Plans are in the units of the environment's actions, in
/// blocks of the model's [stride](WorldModel::stride).
pub struct ModelDynamics {
    /// Never locked: dynamics are shared by threads, none of which asks the model.
    model: Mutex<Box<dyn WorldModel>>,
    name: String,
    parts: [Part; 1],
    map: Option<Arc<ActionMap>>,
    /// `[B, Z]` each: where plans start, and their goals.
    starts: Vec<f64>,
    goals: Vec<f32>,
    /// Of the last context: which columns make the rows of goals.
    goal_columns: Option<GoalColumns>,
    /// `[B × S, Z]`.
    latents: Vec<f64>,
    /// `[B × S, F, A]`.
    actions: Vec<f64>,
}

/// The columns of a table that make a row of the goal, under the names that a model reads.
struct GoalColumns {
    of: Arc<Schema>,
    from: Vec<usize>,
    rows: Batch,
}

impl ModelDynamics {
    /// The latents of `model`, which descriptions call `name`.
    ///
    /// # Errors
    ///
    /// [`PlanError::Setting`]: latents without values, or a stride of 0.
    pub fn new(model: Box<dyn WorldModel>, name: String) -> Result<Self, PlanError> {
        let dim = model.latent_dim();
        for (name, value) in [("latent", dim), ("stride", model.stride())] {
            if value == 0 {
                return Err(PlanError::setting(name, "the model has 0; it must have 1 or more"));
            }
        }
        Ok(Self {
            model: Mutex::new(model),
            name,
            parts: [Part { name: "latent".to_owned(), range: 0..dim }],
            map: None,
            starts: Vec::new(),
            goals: Vec::new(),
            goal_columns: None,
            latents: Vec::new(),
            actions: Vec::new(),
        })
    }

    /// Encodes the rows where plans start, and those of their goals.
    fn encode(&mut self, context: &PlanningContext<'_>) -> Result<(), BoxError> {
        let schema = context.view().infos().schema();
        if !self.goal_columns.as_ref().is_some_and(|known| Arc::ptr_eq(&known.of, schema)) {
            self.goal_columns = Some(GoalColumns::new(schema)?);
        }
        let Self { model, goal_columns, starts, goals, .. } = self;
        let model = model.get_mut().unwrap_or_else(PoisonError::into_inner);
        let columns = goal_columns.as_mut().expect("made above");
        let mut now = Batch::new(Arc::clone(schema), 0);
        columns.rows.clear();
        for index in 0..context.len() {
            let row: Row<'_> = context.env(index).row;
            now.push_row(row, 0..schema.fields().len())?;
            columns.rows.push_row(row, columns.from.iter().copied())?;
        }
        let size = context.len() * model.latent_dim();
        starts.clear();
        starts.resize(size, 0.0);
        model.encode_rows(&now, starts)?;
        let mut encoded = vec![0.0; size];
        model.encode_rows(&columns.rows, &mut encoded).map_err(|error| {
            format!(
                "the goal cannot be encoded, of which rows have the columns that begin with `goal`: {error}"
            )
        })?;
        goals.clear();
        goals.extend(encoded.iter().map(|&value| value as f32));
        Ok(())
    }
}

impl GoalColumns {
    fn new(schema: &Arc<Schema>) -> Result<Self, BoxError> {
        let (mut from, mut fields) = (Vec::new(), Vec::new());
        for (index, field) in schema.fields().iter().enumerate() {
            let of_step = match field.name.strip_prefix("goal_") {
                Some(name) => Some(name),
                None => (field.name == GOAL_IMAGE).then_some(PIXELS),
            };
            // Constants of the episode, such as factors, are those of the goal too.
            let is_constant = field.kind == swm_core::FieldKind::Episode && of_step.is_none();
            if let Some(name) = of_step.or(is_constant.then_some(field.name.as_str())) {
                let mut renamed = field.clone();
                name.clone_into(&mut renamed.name);
                from.push(index);
                fields.push(renamed);
            }
        }
        let rows = Batch::new(Schema::new(fields)?, 0);
        Ok(Self { of: Arc::clone(schema), from, rows })
    }
}

impl Dynamics for ModelDynamics {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        self.map = Some(Arc::clone(context.actions()));
        self.encode(context).map_err(PlanError::Cost)
    }

    fn parts(&self) -> &[Part] {
        &self.parts
    }

    fn goal(&self, episode: usize) -> &[f32] {
        let dim = self.parts[0].range.len();
        &self.goals[episode * dim..][..dim]
    }

    fn roll_out(&mut self, candidates: &Candidates<'_>, states: &mut [f32]) -> Result<(), PlanError> {
        let Self { model, map, starts, latents, actions, parts, .. } = self;
        let (dim, [episodes, samples, horizon, block]) = (parts[0].range.len(), candidates.shape());
        let prepared = map.as_ref().filter(|_| starts.len() == episodes * dim);
        let model = model.get_mut().unwrap_or_else(PoisonError::into_inner);
        let map = prepared.ok_or(PlanError::Size {
            name: "prepared episodes",
            expected: episodes,
            found: starts.len() / dim,
        })?;
        let space = map.space();
        let mut action = Column::zeros(space.dtype().unwrap_or(swm_core::Dtype::F32), space.dim());
        latents.clear();
        for start in starts.chunks_exact(dim) {
            (0..samples).for_each(|_| latents.extend_from_slice(start));
        }
        for step in 0..horizon {
            actions.clear();
            for plan in candidates.plans() {
                for values in plan[step * block..][..block].chunks_exact(map.dim()) {
                    map.write(values, &mut action.as_slice_mut());
                    let action = action.as_slice();
                    actions.extend((0..action.len()).filter_map(|index| action.as_f64(index)));
                }
            }
            model.predict_rows(latents, actions).map_err(PlanError::Cost)?;
            for (latent, path) in latents.chunks_exact(dim).zip(states.chunks_exact_mut(horizon * dim)) {
                let out = &mut path[step * dim..][..dim];
                out.iter_mut().zip(latent).for_each(|(out, &value)| *out = value as f32);
            }
        }
        Ok(())
    }

    fn changed_settings(&self) -> Map<String, Json> {
        Map::from_iter([("model".to_owned(), self.name.clone().into())])
    }
}

/// The squared distance from the goal, per number of the latent.
struct Distance {
    aggregate: Aggregate,
}

impl Objective for Distance {
    fn cost(&self, path: &Path<'_>) -> f64 {
        let mut distances = path.states.chunks_exact(path.dim).map(|state| {
            let squares = state.iter().zip(path.goal).map(|(a, b)| f64::from(a - b).powi(2));
            squares.sum::<f64>() / path.dim as f64
        });
        let count = distances.len() as f64;
        match self.aggregate {
            Aggregate::Last => distances.next_back().unwrap_or(f64::NAN),
            Aggregate::Mean => distances.sum::<f64>() / count,
            Aggregate::Best => distances.fold(f64::INFINITY, f64::min),
        }
    }

    fn changed_settings(&self) -> Map<String, Json> {
        match self.aggregate {
            Aggregate::Last => Map::new(),
            aggregate => Map::from_iter([(AGGREGATE.name.to_owned(), serde_json::json!(aggregate))]),
        }
    }
}
