//! A custom world model: the next state is a linear function of state and action, fitted to a dataset by least squares. The
//! policy `fitted-model:FILE` plans on it.

use std::path::Path;

use serde_json::{Map, Value as Json};
use swm::core::{Batch, BoxError, PolicyArgs, PolicyEntry, Schema, Setting};
use swm::solvers::models::{Dynamics, GoalMse, Part, Reduction, ShootingCost, Steps};
use swm::solvers::{
    Candidates, LearnedCost, PlanError, PlanningContext, SOLVER_SETTING, on_true_dynamics, plan_on,
};

/// `fitted-model`. What a command asks of the model behind it is said here too: the images that it was trained on (those of
/// its dataset), the file that it depends on, and its oracle, the same planner on the true dynamics.
pub const FITTED_MODEL: PolicyEntry = PolicyEntry::new(
    "fitted-model",
    "plans on a linear model that is fitted to a dataset (`fitted-model:FILE`), with the settings of solver and plan",
    |context, args| {
        let (file, given) = split(args).ok_or_else(|| args.wrong("name one dataset: `fitted-model:FILE`"))?;
        let cost = fit(file.as_ref()).map_err(|error| args.wrong(error.to_string()))?;
        let learned = LearnedCost::new(Box::new(cost), BLOCK);
        Ok(Box::new(plan_on(context, learned, given).map_err(|error| args.wrong(error.to_string()))?))
    },
)
.settings(&[Setting::new("FILE", "A dataset with the columns state and action", "required"), SOLVER_SETTING])
.image(|args| swm::data::open(split(args)?.0.as_ref()).ok()?.metadata()?.image)
.files(|args| Ok(split(args).into_iter().map(|(file, _)| file.into()).collect()))
.oracle(|context, args| {
    let (_, mut given) = split(args)?;
    given.insert("action_block".to_owned(), BLOCK.into());
    on_true_dynamics(context, given)
});

/// The dataset, and the settings of solver and plan; plans are short if nothing else is said.
fn split(args: &PolicyArgs) -> Option<(&str, Map<String, Json>)> {
    let [file] = &args.positional[..] else { return None };
    let mut given = args.named.clone();
    given.entry("horizon").or_insert(10.into());
    given.entry("receding_horizon").or_insert(2.into());
    Some((file.as_str()?, given))
}

fn fit(data: &Path) -> Result<ShootingCost<LinearModel>, BoxError> {
    let objective = GoalMse::new(&["state"], Steps::All, Reduction::Mean);
    Ok(ShootingCost::new(LinearModel::fit(data)?, Box::new(objective), Vec::new())?)
}

/// Actions of a block.
const BLOCK: usize = 2;
/// Dimensions of a state, and of an action.
const STATE: usize = 4;
const ACTION: usize = 2;
/// Input of a prediction: state, action, 1.
const INPUT: usize = STATE + ACTION + 1;

/// next state = weights × (state, action, 1).
struct LinearModel {
    weights: [[f64; INPUT]; STATE],
    parts: [Part; 1],
    /// `[B]`: where plans start, and where they shall lead.
    starts: Vec<[f64; STATE]>,
    goals: Vec<[f32; STATE]>,
}

impl LinearModel {
    fn fit(data: &Path) -> Result<Self, BoxError> {
        let mut dataset = swm::data::open(data)?;
        let fields = dataset.schema().fields();
        let columns = ["state", "action"].map(|name| fields.iter().find(|field| field.name == name).cloned());
        let [Some(state), Some(action)] = columns else {
            return Err(format!("{} lacks the column `state` or `action`", data.display()).into());
        };
        let mut rows = Batch::new(Schema::new(vec![state, action])?, 0);
        // Normal equations: moments × weightsᵀ = targets.
        let (mut moments, mut targets) = ([[0.0; INPUT]; INPUT], [[0.0; STATE]; INPUT]);
        for episode in 0..dataset.num_episodes() {
            dataset.read(episode, 0..dataset.episode_len(episode), &mut rows)?;
            let (states, actions) = (rows.get::<f64>("state")?, rows.get::<f32>("action")?);
            let pairs = states.chunks_exact(STATE).zip(states.chunks_exact(STATE).skip(1));
            for ((state, next), action) in pairs.zip(actions.chunks_exact(ACTION)) {
                let input = input(state, action);
                for (row, &a) in input.iter().enumerate() {
                    input.iter().zip(&mut moments[row]).for_each(|(b, sum)| *sum += a * b);
                    next.iter().zip(&mut targets[row]).for_each(|(b, sum)| *sum += a * b);
                }
            }
        }
        let solution = solve(moments, targets)
            .ok_or("the dataset does not determine a linear model; record more, and with random actions")?;
        let mut weights = [[0.0; INPUT]; STATE];
        for (column, row) in solution.iter().enumerate() {
            row.iter().enumerate().for_each(|(output, &weight)| weights[output][column] = weight);
        }
        let parts = [Part { name: "state".to_owned(), range: 0..STATE }];
        Ok(Self { weights, parts, starts: Vec::new(), goals: Vec::new() })
    }

    fn next(&self, state: &[f64], action: &[f32]) -> [f64; STATE] {
        let input = input(state, action);
        self.weights.map(|row| row.iter().zip(&input).map(|(weight, value)| weight * value).sum())
    }
}

fn input(state: &[f64], action: &[f32]) -> [f64; INPUT] {
    let mut input = [1.0; INPUT];
    input[..STATE].copy_from_slice(state);
    input[STATE..INPUT - 1].iter_mut().zip(action).for_each(|(out, &value)| *out = f64::from(value));
    input
}

/// Gaussian elimination with pivoting; `None` if the equations are dependent.
fn solve(mut left: [[f64; INPUT]; INPUT], mut right: [[f64; STATE]; INPUT]) -> Option<[[f64; STATE]; INPUT]> {
    for pivot in 0..INPUT {
        let best = (pivot..INPUT).max_by(|&a, &b| left[a][pivot].abs().total_cmp(&left[b][pivot].abs()))?;
        if left[best][pivot].abs() < 1e-9 {
            return None;
        }
        left.swap(pivot, best);
        right.swap(pivot, best);
        for row in (0..INPUT).filter(|&row| row != pivot) {
            let factor = left[row][pivot] / left[pivot][pivot];
            let (from_left, from_right) = (left[pivot], right[pivot]);
            left[row].iter_mut().zip(from_left).for_each(|(out, value)| *out -= factor * value);
            right[row].iter_mut().zip(from_right).for_each(|(out, value)| *out -= factor * value);
        }
    }
    for (row, values) in right.iter_mut().enumerate() {
        values.iter_mut().for_each(|value| *value /= left[row][row]);
    }
    Some(right)
}

impl Dynamics for LinearModel {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        self.starts.clear();
        self.goals.clear();
        for index in 0..context.len() {
            let row = context.env(index).row;
            let column = |name: &str| -> Result<[f64; STATE], PlanError> {
                let values: &[f64] = row.get(name).map_err(|error| PlanError::Cost(error.into()))?;
                values.try_into().map_err(|_| PlanError::Size {
                    name: "state",
                    expected: STATE,
                    found: values.len(),
                })
            };
            self.starts.push(column("state")?);
            self.goals.push(column("goal_state")?.map(|value| value as f32));
        }
        Ok(())
    }

    fn parts(&self) -> &[Part] {
        &self.parts
    }

    fn goal(&self, episode: usize) -> &[f32] {
        &self.goals[episode]
    }

    fn roll_out(&mut self, candidates: &Candidates<'_>, states: &mut [f32]) -> Result<(), PlanError> {
        let paths = states.chunks_exact_mut(candidates.horizon * STATE);
        for (index, (plan, path)) in candidates.plans().zip(paths).enumerate() {
            let mut state = self.starts[index / candidates.samples];
            for (block, out) in plan.chunks_exact(candidates.dim).zip(path.chunks_exact_mut(STATE)) {
                for action in block.chunks_exact(ACTION) {
                    state = self.next(&state, action);
                }
                out.copy_from_slice(&state.map(|value| value as f32));
            }
        }
        Ok(())
    }
}
