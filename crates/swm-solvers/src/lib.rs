//! Planning: choose actions by predicting their outcome with a model.
//!
//! ```
//! use swm_core::{Dtype, Space};
//! use swm_solvers::models::{ControlCost, ControlModel, Stage};
//! use swm_solvers::{Cem, Mpc, PlanConfig};
//!
//! struct Cart([f64; 2]); // position and velocity, as measured
//!
//! impl ControlModel for Cart {
//!     fn state_dim(&self) -> usize { 2 }
//!     fn action_dim(&self) -> usize { 1 }
//!     fn start(&self, _: usize, state: &mut [f64]) { state.copy_from_slice(&self.0) }
//!     fn step(&self, at: &Stage<'_>, next: &mut [f64]) {
//!         next[1] = at.state[1] + 0.1 * at.action[0];
//!         next[0] = at.state[0] + 0.1 * next[1];
//!     }
//!     fn cost(&self, at: &Stage<'_>) -> f64 { (at.state[0] - 1.0).powi(2) + 0.1 * at.state[1].powi(2) }
//! }
//!
//! let solver = Cem { samples: 64, iterations: 5, elites: 8, clip: true, ..Cem::default() };
//! let config = PlanConfig { horizon: 20, receding_horizon: 1, action_block: 1, ..PlanConfig::default() };
//! let mut mpc = Mpc::new(Box::new(solver), config, Space::uniform_box(Dtype::F32, &[1], -1.0, 1.0))?;
//! let mut cost = ControlCost::new(Cart([0.0, 0.0]));
//! for _ in 0..60 {
//!     let velocity = cost.model.0[1] + 0.1 * f64::from(mpc.next(&mut cost, None)?[0]);
//!     cost.model.0 = [cost.model.0[0] + 0.1 * velocity, velocity]; // on a robot: act, then measure
//! }
//! assert!((cost.model.0[0] - 1.0).abs() < 0.1);
//! # Ok::<(), swm_solvers::PlanError>(())
//! ```
//!
//! Three parts, which exchange plain slices (no tensors, no environment crates):
//!
//! * a [`Cost`] rates candidate plans: a learned model or an analytic problem ([`models`] puts them
//!   together), or the true simulator ([`SimulatorCost`]);
//! * a [`Solver`] searches for the cheapest plan: configuration data with a pure `solve` ([`SOLVERS`] lists
//!   them; a new one is one file in `solvers/` and one line in that table);
//! * [`Mpc`] and, in a `World`, [`MpcPolicy`] execute plans: they plan, act for some steps, and plan again.
//!
//! [`PLANNERS`] joins the three into policies for any environment: `cem:samples=300,horizon=10`.
//!
//! A plan is `[H, D]`: H blocks of D = k × A values, which are k consecutive actions of A values each, in the
//! order in which they are executed; integers are one-hot. [`Trace`] observes a solver. Noise is keyed by (episode seed,
//! plan, iteration, sample), so the plan of an episode has the same bits alone or among many, on one thread or several.
//!
//! A cost of one's own and a solver that is called directly:
//!
//! ```
//! use swm_core::{Dtype, EpisodeSeed, Space};
//! use swm_solvers::{Candidates, Cem, Cost, NoTrace, Outputs, Plan, PlanError, PlanKey, Problem, Solver, Workspace};
//!
//! /// Three values that should add up to 2.
//! struct Sum;
//!
//! impl Cost for Sum {
//!     fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
//!         for (plan, cost) in candidates.plans().zip(outputs.costs.iter_mut()) {
//!             *cost = f64::from((plan.iter().sum::<f32>() - 2.0).powi(2));
//!         }
//!         Ok(())
//!     }
//! }
//!
//! let key = PlanKey { episode: 0, seed: EpisodeSeed::new(42), plan: 0 };
//! let action = Space::uniform_box(Dtype::F32, &[1], -1.0, 1.0);
//! let problem =
//!     Problem { keys: &[key], horizon: 3, action_block: 1, action: &action, initial: &[0.0; 3], memory: &[] };
//! let mut plan = Plan::new();
//! Cem::default().solve(&problem, &mut Sum, &mut Workspace::new(), &mut NoTrace, &mut plan)?;
//! assert!(plan.cost_of_returned[0] < 1e-6);
//! # Ok::<(), PlanError>(())
//! ```

#![cfg_attr(
    not(feature = "faer"),
    expect(dead_code, unused_imports, reason = "what the solvers on matrices need, and no other does")
)]

mod bounds;
mod colored;
mod context;
mod control;
mod cost;
mod descent;
mod entry;
mod error;
mod executed;
mod learned;
mod lifted;
#[cfg(feature = "faer")]
mod matrix;
pub mod models;
mod mpc;
mod planners;
mod problem;
mod ranges;
mod registered;
#[cfg(feature = "faer")]
mod riccati;
mod sampler;
mod sampling;
mod settings;
mod simulator;
mod solver;
mod solvers;
mod space;
mod steps;
pub mod testing;
mod trace;
mod workspace;
mod world_model;

pub use colored::Normalize;
pub use context::{ActionMap, ActionScale, HistoryView, PlanningContext};
pub use cost::{Cost, Outputs, WeightFn};
pub use descent::{Descent, GradClip};
pub use entry::{MakeSolver, SolverEntry};
pub use error::PlanError;
pub use executed::AsExecuted;
pub use learned::{LearnedCost, SOLVER_SETTING, on_true_dynamics, plan_on};
pub use mpc::{Mpc, MpcPolicy, PlanConfig, Report, planner_of};
pub use planners::{EXPERT, PLANNERS};
pub use problem::{Candidates, Plan, PlanKey, Problem};
pub use registered::registered_model;
pub use sampling::{Noise, cheapest, clip, count_non_finite};
pub use settings::Validate;
pub use simulator::{Aggregate, SimulatorCost, SimulatorOptions};
pub use solver::{Solver, SolverConfig};
pub use solvers::{
    Adam, AdamW, CategoricalCem, Cem, Grasp, Icem, Lagrangian, Mppi, Optimizer, Penalty, Pgd,
    PredictiveSampling, SOLVERS, Select, Sgd, Sync, TemperatureMode,
};
#[cfg(feature = "faer")]
pub use solvers::{CmaEs, FullCem, Ilqr};
pub use space::{categories, largest, plan_dim};
pub use steps::{StateSteps, StepBatch};
pub use trace::{
    Detail, Elite, Iteration, IterationRecord, JsonLines, Memory, NoTrace, PlanPaths, PlanRecord, Records,
    Trace, TracedIteration, TracedPlan, stops_at_success,
};
pub use workspace::{Scratch, Workspace};
pub use world_model::{ModelDynamics, WorldModelEntry};
