//! Replays a dataset on the simulator, and compares the two.
//!
//! Each recorded episode's factors, goal and start are restored, its actions are run again, and every column of
//! real values that both have, and every integer state, is compared step by step.

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;
use swm_core::batch::FieldKind;
use swm_core::dataset::{self, CHECKPOINT, Checkpoints, Dataset};
use swm_core::env::step_times;
use swm_core::{
    Batch, Dtype, Env, EnvConfig, EnvEntry, EnvState, Episode, EpisodeSeed, Field, MAX_FRAME_SKIP, Metadata,
    Registry, Schema, Slice, Value,
};
use swm_data::rendered::env_named;

use crate::error::TaskError;
use crate::request::{Assignment, Fix, Message};

/// The environment that the dataset at `path` says it was recorded in.
///
/// # Errors
///
/// It names none, or one that this program does not have: of another program, or of another build.
pub fn recorded_env(
    registry: &Registry,
    source: &dyn Dataset,
    path: &Path,
) -> Result<&'static EnvEntry, TaskError> {
    let path = path.display();
    let Some(named) = source.metadata().and_then(Metadata::known_env) else {
        let text = format!("{path} does not name its environment");
        return Err(Message::new(text).fix(Fix::give("env")).into());
    };
    env_named(registry, named, "it was recorded in").map_err(|reason| {
        let fix = Fix::Set {
            setting: Assignment::name("env"),
            to: "if this program has the environment under another id",
        };
        Message::new(format!("{path}: {reason}")).fix(fix).into()
    })
}

/// The result of a replay.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct ReplayReport {
    /// Whether every column stays within the tolerance.
    pub ok: bool,
    /// Largest accepted difference.
    pub tolerance: f64,
    /// Episodes replayed.
    pub episodes: usize,
    /// Steps compared.
    pub rows: usize,
    /// Largest differences by column.
    pub columns: BTreeMap<String, Difference>,
    /// Recorded checkpoints that were compared; none where factors are overridden.
    pub checkpoints: usize,
    /// Those whose state is not the replayed one in every bit.
    pub checkpoints_differ: usize,
}

/// How far a column of the replay is from the recorded one.
#[derive(Clone, Copy, Debug, Default, Serialize)]
#[non_exhaustive]
pub struct Difference {
    /// Largest absolute difference over all steps.
    pub max_abs: f64,
    /// Largest absolute difference over the last steps of episodes.
    pub final_abs: f64,
}

/// Episodes that one thread replays before the others are waited for.
const EPISODES_PER_THREAD: usize = 8;

/// Replays `episodes` of `source` on an environment of this config, with the factors of `overrides` in place of recorded ones,
/// on all threads; `watch` is called for each, in order.
///
/// # Errors
///
/// The dataset lacks what a reset needs, has a frame skip that cannot be, or cannot be read; the environment cannot
/// be made or reset. Differences are no errors. Of several episodes, the error of the first.
pub fn replay(
    env: (&EnvEntry, &EnvConfig),
    source: &mut dyn Dataset,
    episodes: &[usize],
    overrides: &BTreeMap<String, Value>,
    tolerance: f64,
    mut watch: impl FnMut(usize),
) -> Result<ReplayReport, TaskError> {
    let mut report = ReplayReport {
        ok: true,
        tolerance,
        episodes: episodes.len(),
        rows: 0,
        columns: BTreeMap::new(),
        checkpoints: 0,
        checkpoints_differ: 0,
    };
    let threads = rayon::current_num_threads().clamp(1, episodes.len().max(1));
    let workers = (0..threads).map(|_| Worker::new(env, source.share(), overrides));
    let mut workers = workers.collect::<Result<Vec<Worker>, _>>()?;
    for round in episodes.chunks(threads * EPISODES_PER_THREAD) {
        let run = |(thread, worker): (usize, &mut Worker)| -> Vec<_> {
            let own = round.iter().enumerate().skip(thread).step_by(threads);
            own.map(|(at, &episode)| (at, worker.replay(episode, overrides))).collect()
        };
        let mut replayed: Vec<(usize, Result<Replayed, TaskError>)> =
            workers.par_iter_mut().enumerate().flat_map_iter(run).collect();
        replayed.sort_by_key(|(at, _)| *at);
        for (at, replayed) in replayed {
            replayed?.add_to(&mut report);
            watch(round[at]);
        }
    }
    report.ok = report.columns.values().all(|difference| difference.max_abs <= tolerance);
    Ok(report)
}

/// What one episode showed.
#[derive(Default)]
struct Replayed {
    rows: usize,
    columns: BTreeMap<String, Difference>,
    checkpoints: usize,
    checkpoints_differ: usize,
}

impl Replayed {
    fn add_to(self, report: &mut ReplayReport) {
        report.rows += self.rows;
        report.checkpoints += self.checkpoints;
        report.checkpoints_differ += self.checkpoints_differ;
        for (name, Difference { max_abs, final_abs }) in self.columns {
            let largest = report.columns.entry(name).or_default();
            largest.max_abs = largest.max_abs.max(max_abs);
            largest.final_abs = largest.final_abs.max(final_abs);
        }
    }
}

/// An environment of one thread, and its handle of the dataset.
struct Worker {
    env: Box<dyn Env>,
    source: Box<dyn Dataset>,
    frame_skip: u32,
    columns: Columns,
    saved: Option<Checkpoints>,
    recorded: Batch,
    pieces: Batch,
    live: Batch,
    state: EnvState,
}

impl Worker {
    fn new(
        (entry, config): (&EnvEntry, &EnvConfig),
        source: Box<dyn Dataset>,
        overrides: &BTreeMap<String, Value>,
    ) -> Result<Self, TaskError> {
        let metadata = source.metadata().cloned();
        let frame_skip = metadata.as_ref().map_or(1, |m| m.frame_skip);
        if frame_skip > MAX_FRAME_SKIP {
            return Err(format!("its frame skip of {frame_skip} is more than {MAX_FRAME_SKIP}").into());
        }
        let env = entry.make(config)?;
        let live = Batch::new(Schema::new(env.spec().fields.clone())?, 1);
        let columns = Columns::shared(env.as_ref(), source.as_ref())?;
        let recorded = Batch::new(Schema::new(columns.read.clone())?, 0);
        let saved = metadata.as_ref().filter(|_| overrides.is_empty());
        let saved = saved.and_then(|metadata| Checkpoints::of(source.schema(), metadata.checkpoints));
        let pieces =
            Batch::new(Schema::new(saved.as_ref().map(Checkpoints::field).into_iter().collect())?, 0);
        let state = EnvState::new();
        Ok(Self { env, source, frame_skip, columns, saved, recorded, pieces, live, state })
    }

    fn replay(&mut self, episode: usize, overrides: &BTreeMap<String, Value>) -> Result<Replayed, TaskError> {
        let Self { env, source, frame_skip, columns, saved, recorded, pieces, live, state } = self;
        let mut found = Replayed::default();
        let mut options = dataset::whole_episode(env.spec(), source.as_mut(), episode)?;
        options.variation_values.extend(overrides.clone());
        let steps = source.episode_len(episode);
        source.read(episode, 0..steps, recorded)?;
        if saved.is_some() {
            source.read(episode, 0..steps, pieces)?;
        }
        let seed = options.seed.unwrap_or(EpisodeSeed::new(0));
        env.reset(&Episode::new(seed, &options))?;
        for step in 0..steps {
            env.observe(&mut live.rows_mut());
            columns.compare(recorded, step, live, step + 1 == steps, &mut found.columns);
            found.rows += 1;
            if let Some(saved) =
                saved.as_ref().filter(|saved| saved.is_at(step as u64) && step + saved.every() <= steps)
            {
                let size = pieces.schema().dim(0);
                let whole = &pieces.get::<u8>(CHECKPOINT)?[step * size..(step + saved.every()) * size];
                if let Some(recorded) = saved.read(whole) {
                    env.snapshot(state)?;
                    found.checkpoints += 1;
                    found.checkpoints_differ += usize::from(state.bytes() != recorded);
                }
            }
            if step + 1 < steps {
                let action = recorded.row(step).at(columns.action);
                if !action.is_finite() {
                    return Err(
                        format!("episode {episode}, step {step}: the recorded action is not finite").into()
                    );
                }
                step_times(env.as_mut(), action, *frame_skip)?;
            }
        }
        Ok(found)
    }
}

/// Which columns are compared.
struct Columns {
    /// The fields to read from the dataset: the compared ones, then the action.
    read: Vec<Field>,
    /// For each compared one, its position in the environment's fields.
    live: Vec<usize>,
    action: usize,
}

impl Columns {
    fn shared(env: &dyn Env, source: &dyn Dataset) -> Result<Self, TaskError> {
        let schema = source.schema();
        let (mut read, mut live) = (Vec::new(), Vec::new());
        for (index, field) in env.spec().fields.iter().enumerate() {
            // Integers where they are the state, as on a grid; elsewhere they count things, in ways that differ.
            let is_state = env.spec().start_columns.contains(&field.name.as_str());
            let is_compared = |dtype: Dtype| match dtype {
                Dtype::F32 | Dtype::F64 => true,
                Dtype::I64 => is_state,
                _ => false,
            };
            if !is_compared(field.dtype) || field.kind != FieldKind::Step {
                continue;
            }
            if let Some(found) = schema.index(&field.name).map(|index| &schema.fields()[index])
                && found.dim() == field.dim()
                && is_compared(found.dtype)
            {
                read.push(found.clone());
                live.push(index);
            }
        }
        if read.is_empty() {
            return Err(format!(
                "the dataset shares no column of real values and no integer state with {}",
                env.spec().id
            )
            .into());
        }
        let action = schema.index("action").ok_or_else(|| {
            format!(
                "{} was recorded without the column `action`, which a replay repeats",
                source.path().display()
            )
        })?;
        let action = schema.fields()[action].clone();
        let wanted = &env.spec().action;
        if Some(action.dtype) != wanted.dtype() || action.dim() != wanted.dim() {
            return Err(format!(
                "the dataset's action is {} {:?}, the environment's {} {:?}",
                action.dtype,
                action.shape,
                wanted.dtype().map_or("nothing", Dtype::name),
                wanted.shape(),
            )
            .into());
        }
        let position = read.len();
        read.push(action);
        Ok(Self { read, live, action: position })
    }

    fn compare(
        &self,
        recorded: &Batch,
        step: usize,
        live: &Batch,
        last: bool,
        differences: &mut BTreeMap<String, Difference>,
    ) {
        for (position, &index) in self.live.iter().enumerate() {
            let difference = largest_difference(recorded.row(step).at(position), live.row(0).at(index));
            let largest = differences.entry(self.read[position].name.clone()).or_default();
            largest.max_abs = largest.max_abs.max(difference);
            if last {
                largest.final_abs = largest.final_abs.max(difference);
            }
        }
    }
}

/// The largest absolute difference; infinite where only one is NaN.
fn largest_difference(a: Slice<'_>, b: Slice<'_>) -> f64 {
    let value = |slice: Slice<'_>, i| slice.as_f64(i).unwrap_or(f64::NAN);
    (0..a.len()).fold(0.0, |largest: f64, i| {
        let (a, b) = (value(a, i), value(b, i));
        let difference = if a.is_nan() && b.is_nan() { 0.0 } else { (a - b).abs() };
        largest.max(if difference.is_nan() { f64::INFINITY } else { difference })
    })
}
