//! Does a model put plans in the right order? Its cost of random plans against their true task cost, start by start: what a
//! planner needs of a model, and no error of prediction says.

use crate::batch::Batch;
use crate::env::{Env, EnvState, Episode, ResetOptions};
use crate::error::{BoxError, EnvError};
use crate::seed::EpisodeSeed;

use super::quality::WorldModel;
use super::state_model::{ActionColumn, columns, defaults, rows_with_actions, start_at};
use super::stats::rank_correlation;

/// What is ranked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RankingOptions {
    /// Starts, each with a goal of its own.
    pub starts: usize,
    /// Random plans per start: at least 2.
    pub plans: usize,
    /// Actions of a plan, and of the way to the goal.
    pub horizon: usize,
    /// Seed of starts, goals and plans.
    pub seed: u64,
}

/// Spearman's correlation of model cost and true cost over the plans of each start, `[starts]`; `None` where one of them is
/// constant. The model's cost is the squared distance of the predicted latent from that of the goal, the true one the
/// environment's task cost after the plan. Goals are rows that random actions reach from the start in `horizon` steps; a
/// plan that diverges is left out.
///
/// # Errors
///
/// The horizon is no multiple of the model's stride, there are fewer than two plans, the environment has no task cost
/// or cannot be reset to a recorded state, or the model fails.
pub fn action_ranking(
    model: &mut dyn WorldModel,
    env: &mut dyn Env,
    options: &RankingOptions,
) -> Result<Vec<Option<f64>>, BoxError> {
    let RankingOptions { starts, plans, horizon, seed } = *options;
    let stride = model.stride();
    if horizon % stride != 0 {
        let near = (horizon / stride).max(1) * stride;
        return Err(format!(
            "plans of {horizon} actions, and the model predicts {stride} at a time: use {near}, or another multiple of {stride}"
        )
        .into());
    }
    if plans < 2 || horizon == 0 {
        return Err(format!("{plans} plan(s) of {horizon} action(s): at least 2 of 1 are needed").into());
    }
    let mut rows = Batch::new(rows_with_actions(env.spec())?, 2);
    let mut action = ActionColumn::new(&env.spec().action);
    let dim = model.latent_dim();
    let mut ends = vec![0.0; 2 * dim];
    let mut state = EnvState::new();
    let mut correlations = Vec::with_capacity(starts);
    for index in 0..starts as u64 {
        let episode = |options: &ResetOptions, env: &mut dyn Env| -> Result<(), EnvError> {
            env.reset(&Episode { seed: EpisodeSeed::of(seed, index), options }).map(drop)
        };
        episode(&defaults(), env)?;
        write_row(env, &mut rows, 0);
        // The way to the goal is as random as a plan, but none of them.
        for step in 0..horizon as u64 {
            action.sample(seed, index, step);
            env.step(action.as_slice())?;
        }
        write_row(env, &mut rows, 1);
        let reset = ResetOptions {
            start: Some(start_at(env.spec(), rows.row(0))?),
            goal: Some(columns(env.spec().goal_columns, rows.row(1))?),
            ..defaults()
        };
        episode(&reset, env)?;
        env.snapshot(&mut state)?;
        model.encode_rows(&rows, &mut ends)?;
        let (start, goal) = ends.split_at(dim);
        // Actions of the plans that end well, plan by plan: [P, H, A].
        let (mut taken, mut truth) = (Vec::new(), Vec::with_capacity(plans));
        for plan in 0..plans as u64 {
            env.restore(&state)?;
            let (first, mut diverged) = (taken.len(), false);
            for step in 0..horizon as u64 {
                action.sample(seed, index, (plan + 1) * horizon as u64 + step);
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
                taken.truncate(first);
                continue;
            }
            let no_cost = || format!("{} has no task cost: plans have no true order", env.spec().id);
            truth.push(env.task_cost().ok_or_else(no_cost)?);
        }
        let told = costs_of(model, start, goal, &taken, truth.len(), horizon)?;
        correlations.push(rank_correlation(&told, &truth));
    }
    Ok(correlations)
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
    use crate::evaluate::StateModel;
    use crate::testing::TOY;

    fn ranked(gain: Option<f64>, plans: usize) -> Result<Vec<Option<f64>>, BoxError> {
        let mut model = StateModel::new(&TOY, &EnvConfig::default(), gain)?;
        let mut env = TOY.make(&EnvConfig::default())?;
        let options = RankingOptions { starts: 8, plans, horizon: 6, seed: 3 };
        action_ranking(&mut model, env.as_mut(), &options)
    }

    #[test]
    fn the_true_dynamics_rank_plans_as_they_are_and_worse_ones_less_so() {
        let exact = ranked(Some(1.0), 30).unwrap();
        assert_eq!(exact.len(), 8);
        // Squares of distances are in the order of distances.
        assert!(exact.iter().all(|found| found.is_some_and(|found| found > 0.999_999)), "{exact:?}");
        assert_eq!(exact, ranked(Some(1.0), 30).unwrap());
        let mean = |found: &[Option<f64>]| found.iter().flatten().sum::<f64>() / found.len() as f64;
        let weak = mean(&ranked(Some(0.5), 30).unwrap());
        let turned = mean(&ranked(Some(-1.0), 30).unwrap());
        assert!(turned < weak && weak < 1.0, "{turned} {weak}");
        assert_eq!(ranked(None, 30).unwrap(), [None; 8], "what never changes ranks nothing");
        assert!(ranked(None, 1).is_err());
    }
}
