//! How good a world model is without control: one set of measures for any model, on episodes that the simulator makes or that
//! were recorded.

use serde::Serialize;
use swm_core::dataset::Dataset;
use swm_core::error::BoxError;
use swm_core::evaluate::quality::{WorldModel, latents, open_loop_error, surprise, violation_accuracy};
use swm_core::evaluate::{RankingOptions, Violation, ViolationOptions, action_ranking, violation_pairs};
use swm_core::{Batch, Env, Field, Schema};

use super::gate::{self, GateCheck};
use super::probes::{ProbeTarget, Probed, probe};

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub struct QualityOptions {
    /// Pairs of a violation, and starts of the ranking.
    pub episodes: usize,
    /// Rows of an episode; violations happen in the middle.
    pub rows: usize,
    /// Rows of open-loop prediction, and actions of a plan.
    pub horizon: usize,
    /// Plans per start.
    pub plans: usize,
    /// Seed of everything.
    pub seed: u64,
}

/// What came out.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Quality {
    /// F: rows that one prediction spans.
    pub stride: usize,
    /// Mean squared error per number of the latent after 1, 2, … open-loop predictions of F rows each.
    pub open_loop_error: Vec<f64>,
    /// The same as a share of the variance of the latents: 1 is as good as their mean. Empty where they do not vary.
    pub open_loop_unexplained: Vec<f64>,
    /// What probes tell of the true state, column by column.
    pub probes: Vec<Probed>,
    /// Ranking of plans; none where the environment has no task cost.
    pub ranking: Option<Ranking>,
    /// What a model should reach before plans are made on it.
    pub gate: Vec<GateCheck>,
    /// One per violation.
    pub violations: Vec<Surprised>,
}

/// How model cost orders plans, against true cost.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Ranking {
    /// Mean of Spearman's correlations; none if there is not one.
    pub mean: Option<f64>,
    /// That of every start; none where a cost is constant.
    pub by_start: Vec<Option<f64>>,
}

/// How a kind of violation surprises.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Surprised {
    /// What happens.
    pub name: String,
    /// The share of pairs in which the impossible episode surprises more; 0.5 is chance.
    pub accuracy: Option<f64>,
    /// Mean over the pairs of the largest surprise in the possible and in the impossible episode.
    pub surprise: [f64; 2],
}

/// Measures `model` in `env` and on `recorded` episodes, tables with the columns that it reads and `action`; `violations` have
/// names, `probed` are parts of the true state.
///
/// # Errors
///
/// A horizon shorter than the model's stride or longer than every episode; whatever the single measurements refuse.
pub fn quality(
    model: &mut dyn WorldModel,
    env: &mut dyn Env,
    recorded: &[Batch],
    probed: &[ProbeTarget],
    violations: &[(String, Violation)],
    options: &QualityOptions,
) -> Result<Quality, BoxError> {
    let QualityOptions { episodes, rows, horizon, plans, seed } = *options;
    let stride = model.stride();
    if horizon < stride {
        return Err(format!(
            "the model predicts {stride} rows at a time: use a horizon of {stride} or a multiple"
        )
        .into());
    }
    let open_loop_error = open_loop_error(model, recorded, horizon)?.ok_or_else(|| {
        format!(
            "no episode has more rows than the horizon of {horizon}: use longer ones, or a shorter horizon"
        )
    })?;
    let latent_dim = model.latent_dim();
    let known = recorded.iter().map(|rows| latents(model, rows)).collect::<Result<Vec<_>, _>>()?;
    let variance = variance(&known, latent_dim);
    let open_loop_unexplained = match variance > 0.0 {
        true => open_loop_error.iter().map(|error| error / variance).collect(),
        false => Vec::new(),
    };
    let probes =
        if probed.is_empty() { Vec::new() } else { probe(recorded, &known, latent_dim, probed, seed)? };
    let ranking = match env.task_cost() {
        None => None,
        Some(_) => {
            let options = RankingOptions { starts: episodes, plans, horizon, seed };
            let by_start = action_ranking(model, env, &options)?;
            let known: Vec<f64> = by_start.iter().flatten().copied().collect();
            let mean = (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64);
            Some(Ranking { mean, by_start })
        }
    };
    let pairs = ViolationOptions { pairs: episodes, rows, at: rows / 2, seed };
    let violations = violations
        .iter()
        .map(|(name, violation)| surprised(model, env, name, violation, &pairs))
        .collect::<Result<_, _>>()?;
    let gate = gate::checks(&probes, ranking.as_ref());
    Ok(Quality { stride, open_loop_error, open_loop_unexplained, probes, ranking, gate, violations })
}

/// Of latents, `[T, Z]` an episode, the mean over their numbers.
fn variance(known: &[Vec<f64>], latent_dim: usize) -> f64 {
    let dim = latent_dim.max(1);
    let (mut sums, mut squares, mut count) = (vec![0.0; dim], vec![0.0; dim], 0.0);
    for latent in known.iter().flat_map(|latents| latents.chunks_exact(dim)) {
        count += 1.0;
        for ((sum, square), value) in sums.iter_mut().zip(&mut squares).zip(latent) {
            *sum += value;
            *square += value * value;
        }
    }
    let variance = |(sum, square): (&f64, &f64)| (square / count - (sum / count).powi(2)).max(0.0);
    sums.iter().zip(&squares).map(variance).sum::<f64>() / dim as f64
}

fn surprised(
    model: &mut dyn WorldModel,
    env: &mut dyn Env,
    name: &str,
    violation: &Violation,
    options: &ViolationOptions,
) -> Result<Surprised, BoxError> {
    let scores = violation_pairs(env, violation, options)?
        .iter()
        .map(|[possible, impossible]| Ok([surprise(model, possible)?, surprise(model, impossible)?]))
        .collect::<Result<Vec<_>, BoxError>>()?;
    let worst = |side: usize| {
        let worst = scores.iter().map(|pair| pair[side].iter().copied().fold(0.0, f64::max));
        worst.sum::<f64>() / scores.len().max(1) as f64
    };
    let surprise = [worst(0), worst(1)];
    Ok(Surprised { name: name.to_owned(), accuracy: violation_accuracy(&scores), surprise })
}

/// The first `rows` rows of the first `episodes` episodes of a dataset: those of the environment's columns that it holds, and
/// `action`.
///
/// # Errors
///
/// The dataset has no column `action`, or cannot be read.
pub fn recorded_episodes(
    env: &dyn Env,
    source: &mut dyn Dataset,
    episodes: usize,
    rows: usize,
) -> Result<Vec<Batch>, BoxError> {
    let own =
        |field: &&Field| field.name == "action" || env.spec().fields.iter().any(|own| own.name == field.name);
    let schema = Schema::new(source.schema().fields().iter().filter(own).cloned().collect())?;
    schema.require("action")?;
    let available = source.num_episodes();
    let mut read = |episode: usize| {
        let mut batch = Batch::new(schema.clone(), 0);
        let rows = source.episode_len(episode).min(rows);
        source.read(episode, 0..rows, &mut batch)?;
        Ok(batch)
    };
    (0..available.min(episodes)).map(&mut read).collect()
}
