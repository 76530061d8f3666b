//! How good a world model is without control: one set of measures for any model, on episodes that the simulator makes or that
//! were recorded.

use serde::Serialize;
use serde_json::{Map, Value as Json};
use swm_core::dataset::Dataset;
use swm_core::evaluate::quality::{WorldModel, latents, open_loop_error, surprise, violation_accuracy};
use swm_core::evaluate::{
    Distances, RankingOptions, Violation, ViolationOptions, action_ranking, random_episodes, violation_pairs,
};
use swm_core::moments::{Moments, of_rows};
use swm_core::{Batch, Cancel, Env, EnvSpec, Field, Schema};

use super::gate::{self, GateCheck};
use super::probes::{ProbeTarget, Probed, probe};
use super::tiers::task_probes;
use crate::error::TaskError;

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub struct QualityOptions {
    /// Pairs of a violation.
    pub episodes: usize,
    /// Starts of the ranking.
    pub starts: usize,
    /// Rows of an episode; violations happen in the middle.
    pub rows: usize,
    /// Rows of open-loop prediction, and actions of a plan.
    pub horizon: usize,
    /// Plans per start.
    pub plans: usize,
    /// Seed of everything.
    pub seed: u64,
}

impl Default for QualityOptions {
    /// 20 pairs per violation, 20 starts, 30 rows, a horizon of 10, 64 plans, seed 42.
    fn default() -> Self {
        Self { episodes: 20, starts: 20, rows: 30, horizon: 10, plans: 64, seed: 42 }
    }
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
    /// Ranking of plans; none where nothing is probed and the environment has no task cost.
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
/// names, `probed` are parts of the true state. `begins` is called with the name of each of the [`measurements`] before it; its
/// errors end them.
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
    mut begins: impl FnMut(&str) -> Result<(), TaskError>,
) -> Result<Quality, TaskError> {
    let QualityOptions { episodes, starts, rows, horizon, plans, seed } = *options;
    let stride = model.stride();
    if horizon < stride {
        return Err(format!(
            "the model predicts {stride} rows at a time: use a horizon of {stride} or a multiple"
        )
        .into());
    }
    begins("open-loop prediction")?;
    let open_loop_error = open_loop_error(model, recorded, horizon)?.ok_or_else(|| {
        let longest = recorded.iter().map(Batch::rows).max().unwrap_or(0);
        format!(
            "no episode has more rows than the horizon of {horizon}, the longest has {longest}: use longer ones, or a shorter horizon"
        )
    })?;
    let latent_dim = model.latent_dim();
    let known = recorded.iter().map(|rows| latents(model, rows)).collect::<Result<Vec<_>, _>>()?;
    let variance = variance(&known, latent_dim);
    let open_loop_unexplained = match variance > 0.0 {
        true => open_loop_error.iter().map(|error| error / variance).collect(),
        false => Vec::new(),
    };
    begins("probes")?;
    let probes =
        if probed.is_empty() { Vec::new() } else { probe(recorded, &known, latent_dim, probed, seed)? };
    begins("ranking of plans")?;
    let ranking = match probed.is_empty() && env.task_cost().is_none() {
        true => None,
        false => {
            let options = RankingOptions { starts, plans, horizon, seed };
            Some(ranking(model, env, recorded, probed, &options)?)
        }
    };
    let pairs = ViolationOptions { pairs: episodes, rows, at: rows / 2, seed };
    let violations = violations
        .iter()
        .map(|(name, violation)| {
            begins(&format!("violation {name}"))?;
            surprised(model, env, name, violation, &pairs)
        })
        .collect::<Result<_, _>>()?;
    let gate = gate::checks(&probes, ranking.as_ref());
    Ok(Quality { stride, open_loop_error, open_loop_unexplained, probes, ranking, gate, violations })
}

/// How many measurements [`quality`] names: open-loop prediction, probes, ranking, and every violation.
pub fn measurements(violations: &[(String, Violation)]) -> u64 {
    3 + violations.len() as u64
}

/// What is probed unless something is named: what decides on success, where that is known and in the rows; else the columns from
/// which episodes start.
pub fn default_probes(spec: &EnvSpec, settings: &Map<String, Json>, recorded: &[Batch]) -> Vec<ProbeTarget> {
    let deciding = task_probes(&spec.id, settings);
    let is_there =
        |target: &ProbeTarget| recorded.iter().all(|rows| rows.schema().index(&target.column).is_some());
    match !deciding.is_empty() && deciding.iter().all(is_there) {
        true => deciding,
        false => spec.start_columns.iter().map(|&column| column.into()).collect(),
    }
}

/// The ranking of plans by how far they end from the goal in what is `probed`, each value in units of its std over the recorded
/// rows, or by the environment's task cost where nothing is. Starts are recorded rows; where those do not hold the environment's
/// start columns, episodes of random actions.
fn ranking(
    model: &mut dyn WorldModel,
    env: &mut dyn Env,
    recorded: &[Batch],
    probed: &[ProbeTarget],
    options: &RankingOptions,
) -> Result<Ranking, TaskError> {
    let start_columns = env.spec().start_columns;
    let holds = |rows: &Batch| start_columns.iter().all(|column| rows.schema().index(column).is_some());
    let simulated = match recorded.iter().all(holds) {
        true => Vec::new(),
        false => random_episodes(env, options.starts, 2 * options.horizon, options.seed, &Cancel::new())?,
    };
    let known: Vec<Values> =
        probed.iter().map(|target| Values::of(target, recorded)).collect::<Result<_, _>>()?;
    let distances = |rows: &Batch| {
        let mut sums = vec![0.0; rows.rows().saturating_sub(1)];
        known.iter().try_for_each(|values| values.add_distances(rows, &mut sums))?;
        Ok(sums)
    };
    let distances = (!known.is_empty()).then_some(&distances as &Distances<'_>);
    let recorded = if simulated.is_empty() { recorded } else { &simulated };
    let by_start = action_ranking(model, env, recorded, distances, options)?;
    let found: Vec<f64> = by_start.iter().flatten().copied().collect();
    let mean = (!found.is_empty()).then(|| found.iter().sum::<f64>() / found.len() as f64);
    Ok(Ranking { mean, by_start })
}

/// A probed quantity, whose values are compared in units of their variance.
struct Values<'a> {
    target: &'a ProbeTarget,
    /// Per value; 1 where it does not vary.
    variance: Vec<f64>,
}

impl<'a> Values<'a> {
    fn of(target: &'a ProbeTarget, recorded: &[Batch]) -> Result<Self, TaskError> {
        let (mut all, mut dim) = (Vec::new(), 1);
        for rows in recorded {
            let (values, wide) = target.values(rows)?;
            dim = wide.max(1);
            // What is missing is NaN.
            all.extend(
                values.chunks_exact(dim).filter(|row| row.iter().all(|value| value.is_finite())).flatten(),
            );
        }
        let variance = of_rows(&all, dim).iter().map(|column| column.divisor().powi(2)).collect();
        Ok(Self { target, variance })
    }

    /// Adds the squared distances of all rows but the first from the first.
    fn add_distances(&self, rows: &Batch, sums: &mut [f64]) -> Result<(), TaskError> {
        let (values, dim) = self.target.values(rows)?;
        let mut rows = values.chunks_exact(dim.max(1));
        let goal = rows.next().unwrap_or_default();
        for (sum, row) in sums.iter_mut().zip(rows) {
            let apart = row.iter().zip(goal).zip(&self.variance);
            *sum += apart.map(|((a, b), variance)| (a - b).powi(2) / variance).sum::<f64>();
        }
        Ok(())
    }
}

/// Of latents, `[T, Z]` an episode, the mean over their numbers.
fn variance(known: &[Vec<f64>], latent_dim: usize) -> f64 {
    let dim = latent_dim.max(1);
    let mut all = vec![Moments::default(); dim];
    for latent in known.iter().flat_map(|latents| latents.chunks_exact(dim)) {
        all.iter_mut().zip(latent).for_each(|(moments, &value)| moments.add(value));
    }
    all.iter().map(Moments::variance).sum::<f64>() / dim as f64
}

fn surprised(
    model: &mut dyn WorldModel,
    env: &mut dyn Env,
    name: &str,
    violation: &Violation,
    options: &ViolationOptions,
) -> Result<Surprised, TaskError> {
    let scores = violation_pairs(env, violation, options)?
        .iter()
        .map(|[possible, impossible]| Ok([surprise(model, possible)?, surprise(model, impossible)?]))
        .collect::<Result<Vec<_>, TaskError>>()?;
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
) -> Result<Vec<Batch>, TaskError> {
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
