//! A custom world model: the next state is a linear function of state and action, fitted to a dataset by least squares.
//! `swm quality --model fitted-model:FILE` measures it, and the policy `fitted-model:FILE` plans with it.

use std::path::Path;

use swm::core::evaluate::quality::WorldModel;
use swm::core::{Batch, BoxError, PolicyArgs, Row, Schema};
use swm::solvers::WorldModelEntry;

/// `fitted-model`, with what commands ask of it: the images that it was trained on (those of its dataset), the file that it depends on,
/// and plans that are short unless others are asked for.
pub const FITTED_MODEL: WorldModelEntry = WorldModelEntry::new(
    "fitted-model",
    "a linear model that is fitted to a dataset with the columns state and action (`fitted-model:FILE`)",
    |_, args| {
        let file = file(args).ok_or_else(|| args.wrong("name one dataset: `fitted-model:FILE`"))?;
        let model = LinearModel::fit(file.as_ref()).map_err(|error| args.wrong(error.to_string()))?;
        Ok(Box::new(model))
    },
)
.plan("horizon=10,receding_horizon=2,aggregate=mean")
.image(|args| swm::data::open(file(args)?.as_ref()).ok()?.metadata()?.image)
.files(|args| Ok(file(args).into_iter().map(Into::into).collect()));

/// The dataset.
fn file(args: &PolicyArgs) -> Option<&str> {
    let [file] = &args.positional[..] else { return None };
    file.as_str()
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
            let states = rows.get::<f64>("state")?;
            let actions: Vec<f64> = rows.get::<f32>("action")?.iter().copied().map(f64::from).collect();
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
        Ok(Self { weights })
    }

    fn next(&self, state: &[f64], action: &[f64]) -> [f64; STATE] {
        let input = input(state, action);
        self.weights.map(|row| row.iter().zip(&input).map(|(weight, value)| weight * value).sum())
    }
}

fn input(state: &[f64], action: &[f64]) -> [f64; INPUT] {
    let mut input = [1.0; INPUT];
    input[..STATE].copy_from_slice(state);
    input[STATE..INPUT - 1].copy_from_slice(action);
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

impl WorldModel for LinearModel {
    fn latent_dim(&self) -> usize {
        STATE
    }

    fn stride(&self) -> usize {
        BLOCK
    }

    fn encode(&mut self, row: Row<'_>, latent: &mut [f64]) -> Result<(), BoxError> {
        latent.copy_from_slice(row.get("state")?);
        Ok(())
    }

    fn predict(&mut self, latent: &mut [f64], actions: &[f64]) -> Result<(), BoxError> {
        for action in actions.chunks_exact(ACTION) {
            latent.copy_from_slice(&self.next(latent, action));
        }
        Ok(())
    }
}
