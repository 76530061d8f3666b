//! Does a model put plans in the right order? Its cost of plans against their true cost, start by start: what a planner needs of a
//! model, and no error of prediction says.

use rand::RngExt as _;

use crate::batch::Batch;
use crate::env::{Env, EnvState, Episode, ResetOptions};
use crate::error::{BoxError, EnvError};
use crate::seed::{EpisodeSeed, keyed};

use super::quality::WorldModel;
use super::state_model::{ActionColumn, columns, defaults, rows_with_actions, start_at};
use super::stats::rank_correlation;

/// What is ranked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RankingOptions {
    /// Starts, each with a goal of its own.
    pub starts: usize,
    /// Plans per start: at least 2.
    pub plans: usize,
    /// Actions of a plan, and of the way to the goal.
    pub horizon: usize,
    /// Seed of starts and plans.
    pub seed: u64,
}

impl Default for RankingOptions {
    /// 50 starts, 64 plans of 10 actions each, seed 42.
    fn default() -> Self {
        Self { starts: 50, plans: 64, horizon: 10, seed: 42 }
    }
}

/// How far each row of a table is from the first one, `[N - 1]`: the true cost of plans that end there, where the first row is
/// their goal.
pub type Distances<'a> = dyn Fn(&Batch) -> Result<Vec<f64>, BoxError> + 'a;

/// Spearman's correlation of model cost and true cost over the plans of each start, `[starts]`; `None` where one of them is
/// constant. The model's cost is the squared distance of the predicted latent from that of the goal; the true one is
/// `distances`, or without them the environment's task cost after the plan.
///
/// A start is a row of `recorded`, tables with the environment's start columns and `action`, and its goal the row `horizon`
/// later. The first plan takes the recorded actions, and each further one leaves them earlier, for random ones; the last is all
/// random. So plans differ by how far they get, as those of a planner do: random plans alone hardly touch what is to be moved, and
/// then nothing but noise orders them. A plan that diverges is left out.
///
/// # Errors
///
/// The horizon is no multiple of the model's stride or longer than every episode, there are fewer than two plans, the environment
/// has no task cost where that is asked for, cannot be reset to a recorded state, or the model fails.
pub fn action_ranking(
    model: &mut dyn WorldModel,
    env: &mut dyn Env,
    recorded: &[Batch],
    distances: Option<&Distances<'_>>,
    options: &RankingOptions,
) -> Result<Vec<Option<f64>>, BoxError> {
    let RankingOptions { starts, plans, horizon, seed } = *options;
    let stride = model.stride();
    if horizon % stride != 0 {
        let near = (horizon / stride).max(1) * stride;
        return Err(format!(
            "plans of {horizon} {}, and the model predicts {stride} at a time: use {near}, or another multiple of {stride}",
            if horizon == 1 { "action" } else { "actions" }
        )
        .into());
    }
    if plans < 2 || horizon == 0 {
        return Err(format!("{plans} plan(s) of {horizon} action(s): at least 2 of 1 are needed").into());
    }
    let schema = rows_with_actions(env.spec())?;
    let mut rows = Batch::new(schema.clone(), 2);
    let mut action = ActionColumn::new(&env.spec().action);
    let dim = model.latent_dim();
    let mut ends = vec![0.0; 2 * dim];
    let mut state = EnvState::new();
    let mut correlations = Vec::with_capacity(starts);
    for index in 0..starts as u64 {
        let (episode, first) = sampled_start(recorded, horizon, seed, index)?;
        // The goal, then where plans end.
        let mut reached = Batch::new(schema.clone(), plans + 1);
        // As the environment shows them with its default goal.
        for row in [first + horizon, first] {
            let start = Some(start_at(env.spec(), episode.row(row))?);
            reset(env, seed, index, &ResetOptions { start, ..defaults() })?;
            write_row(env, &mut rows, usize::from(row != first));
            if row != first {
                write_row(env, &mut reached, 0);
            }
        }
        let options = ResetOptions {
            start: Some(start_at(env.spec(), episode.row(first))?),
            goal: Some(columns(env.spec().goal_columns, rows.row(1))?),
            ..defaults()
        };
        reset(env, seed, index, &options)?;
        env.snapshot(&mut state)?;
        model.encode_rows(&rows, &mut ends)?;
        let (start, goal) = ends.split_at(dim);
        let known = recorded_actions(episode, first, horizon)?;
        let wide = known.len() / horizon;
        // Of the plans that end well, plan by plan: actions [P, H, A], and true costs.
        let (mut taken, mut truth) = (Vec::new(), Vec::with_capacity(plans));
        for plan in 0..plans {
            env.restore(&state)?;
            let from = taken.len();
            let kept = horizon - horizon * plan / (plans - 1);
            let mut diverged = false;
            for step in 0..horizon {
                match known.get(step * wide..(step + 1) * wide).filter(|_| step < kept) {
                    Some(known) => action.set(known.iter().copied())?,
                    None => action.sample(seed, index, ((plan + 1) * horizon + step) as u64),
                }
                match env.step(action.as_slice()) {
                    Ok(_) => taken.extend(action.to_f64s()),
                    Err(EnvError::Diverged { .. }) => diverged = true,
                    Err(error) => return Err(error.into()),
                }
                if diverged {
                    break;
                }
            }
            if diverged {
                taken.truncate(from);
                continue;
            }
            match distances {
                Some(_) => {
                    truth.push(f64::NAN);
                    write_row(env, &mut reached, truth.len());
                }
                None => {
                    let no_cost = || format!("{} has no task cost: plans have no true order", env.spec().id);
                    truth.push(env.task_cost().ok_or_else(no_cost)?);
                }
            }
        }
        if let Some(distances) = distances {
            truth = distances(&reached)?[..truth.len()].to_vec();
        }
        let told = costs_of(model, start, goal, &taken, truth.len(), horizon)?;
        correlations.push(rank_correlation(&told, &truth));
    }
    Ok(correlations)
}

fn reset(env: &mut dyn Env, seed: u64, index: u64, options: &ResetOptions) -> Result<(), EnvError> {
    env.reset(&Episode::new(EpisodeSeed::of(seed, index), options)).map(drop)
}

/// An episode and one of its rows that `horizon` others follow, uniformly.
fn sampled_start(
    recorded: &[Batch],
    horizon: usize,
    seed: u64,
    index: u64,
) -> Result<(&Batch, usize), BoxError> {
    let starts = |episode: &Batch| episode.rows().saturating_sub(horizon);
    let total: usize = recorded.iter().map(starts).sum();
    if total == 0 {
        return Err(
            format!("no episode has more rows than plans have actions, {horizon}: use longer ones").into()
        );
    }
    let mut left = keyed(seed, "quality start", [index, 0]).random_range(0..total);
    let mut episodes = recorded.iter();
    loop {
        let episode = episodes.next().ok_or("a row of those counted")?;
        match left.checked_sub(starts(episode)) {
            Some(rest) => left = rest,
            None => return Ok((episode, left)),
        }
    }
}

/// `[H, A]` from the row `first` on.
fn recorded_actions(episode: &Batch, first: usize, horizon: usize) -> Result<Vec<f64>, BoxError> {
    let column = episode.column(episode.schema().require("action")?);
    let wide = column.len() / episode.rows();
    let number = |at| column.as_f64(at).ok_or_else(|| "`action` holds no numbers".into());
    (first * wide..(first + horizon) * wide).map(number).collect()
}

/// What a model says of plans with the actions `taken`, `[P, H, A]`: the squared distance from `goal` after each, `[P]`.
fn costs_of(
    model: &mut dyn WorldModel,
    start: &[f64],
    goal: &[f64],
    taken: &[f64],
    plans: usize,
    horizon: usize,
) -> Result<Vec<f64>, BoxError> {
    let mut latents = start.repeat(plans);
    let wide = taken.len() / (plans * horizon).max(1);
    let stride = model.stride();
    let mut actions = Vec::with_capacity(plans * stride * wide);
    for step in (0..horizon).step_by(stride) {
        actions.clear();
        (0..plans).for_each(|plan| actions.extend(&taken[(plan * horizon + step) * wide..][..stride * wide]));
        model.predict_rows(&mut latents, &actions)?;
    }
    let distance = |latent: &[f64]| latent.iter().zip(goal).map(|(a, b)| (a - b) * (a - b)).sum();
    Ok(latents.chunks_exact(goal.len().max(1)).map(distance).collect())
}

fn write_row(env: &mut dyn Env, rows: &mut Batch, row: usize) {
    let rows = &mut rows.rows_mut();
    rows.select(row);
    env.write_episode(rows);
    env.observe(rows);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EnvConfig;
    use crate::evaluate::{StateModel, random_episodes};
    use crate::testing::TOY;

    fn ranked(gain: Option<f64>, plans: usize, horizon: usize) -> Result<Vec<Option<f64>>, BoxError> {
        let mut model = StateModel::new(&TOY, &EnvConfig::default(), gain)?;
        let mut env = TOY.make(&EnvConfig::default())?;
        let recorded = random_episodes(env.as_mut(), 8, 10, 5, &crate::Cancel::new())?;
        let options = RankingOptions { starts: 8, plans, horizon, seed: 3 };
        let by_task = action_ranking(&mut model, env.as_mut(), &recorded, None, &options)?;
        let distances = |rows: &Batch| {
            let state = rows.column(rows.schema().require("state")?);
            let at = |row| state.as_f64(row).unwrap_or(f64::NAN);
            Ok((1..rows.rows()).map(|row| (at(row) - at(0)).abs()).collect())
        };
        // The toy's task cost is the distance from its goal.
        assert_eq!(action_ranking(&mut model, env.as_mut(), &recorded, Some(&distances), &options)?, by_task);
        Ok(by_task)
    }

    #[test]
    fn the_true_dynamics_rank_plans_as_they_are_and_worse_ones_less_so() {
        let exact = ranked(Some(1.0), 30, 6).unwrap();
        assert_eq!(exact.len(), 8);
        // Squares of distances are in the order of distances.
        assert!(exact.iter().all(|found| found.is_some_and(|found| found > 0.999_999)), "{exact:?}");
        assert_eq!(exact, ranked(Some(1.0), 30, 6).unwrap());
        let mean = |found: &[Option<f64>]| found.iter().flatten().sum::<f64>() / found.len() as f64;
        let weak = mean(&ranked(Some(0.5), 30, 6).unwrap());
        let turned = mean(&ranked(Some(-1.0), 30, 6).unwrap());
        assert!(turned < weak && weak < 1.0, "{turned} {weak}");
        assert_eq!(ranked(None, 30, 6).unwrap(), [None; 8], "what never changes ranks nothing");
        assert!(ranked(None, 1, 6).is_err());
        assert!(ranked(None, 30, 10).unwrap_err().to_string().contains("use longer ones"));
    }
}
