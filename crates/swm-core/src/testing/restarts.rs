//! Whether an episode that starts at a recorded step continues as the recorded one did, and whether the image of a recorded goal
//! is the recorded frame. What is lost is data: see [`Inexact`].

use std::collections::BTreeMap;

use super::checks::{Bench, value_of};
use crate::batch::{Batch, FieldKind, Slice, Value};
use crate::env::{EnvConfig, EnvSpec, GOAL_IMAGE, PIXELS, ResetOptions, VARIATION_PREFIX};
use crate::registry::EnvEntry;

/// A column that differs after a start from a recorded step.
#[derive(Clone, Copy, Debug)]
pub struct Inexact<'a> {
    /// The column.
    pub column: &'a str,
    /// How much the first observation may differ, in absolute terms.
    pub first: f64,
    /// How much the next ten steps may differ.
    pub later: f64,
    /// Why. The environment's page tells users.
    pub reason: &'a str,
}

/// Recorded steps to start from.
const STARTS: [usize; 4] = [0, 3, 11, 24];
/// Steps that are compared afterwards.
const STEPS: usize = 10;
/// Seeds of episodes, and how many steps each of their actions is held: things move further, and touch.
const EPISODES: [(u64, usize); 4] = [(3, 1), (8, 6), (21, 12), (34, 12)];

/// Records episodes, starts again from some of their steps under the same factors and seed, and compares all step columns,
/// images included, of the first observation and of the next ten steps under the same actions: bit for bit, but for `inexact`.
/// Nothing is compared in environments that cannot start from recorded steps.
///
/// # Errors
///
/// A sentence that names the columns that differ by more, or are listed as inexact and are exact.
pub fn restarts_continue(
    entry: &EnvEntry,
    config: &EnvConfig,
    inexact: &[Inexact<'_>],
) -> Result<(), String> {
    let found = restarts(entry, config).map_err(|reason| format!("{}: {reason}", entry.id))?;
    let mut wrong = Vec::new();
    for (column, [first, later]) in &found {
        let known = inexact.iter().find(|known| known.column == column);
        let (most_first, most_later) = known.map_or((0.0, 0.0), |known| (known.first, known.later));
        if *first > most_first || *later > most_later {
            wrong.push(format!("`{column}` differs by {first:e} at first and {later:e} later"));
        }
    }
    let unneeded = inexact.iter().filter(|known| !found.contains_key(known.column));
    wrong.extend(unneeded.map(|known| format!("`{}` is exact, and listed as inexact", known.column)));
    match wrong.is_empty() {
        true => Ok(()),
        false => Err(format!("{}, restarted:\n  {}", entry.id, wrong.join("\n  "))),
    }
}

/// The largest differences of each column that differs: at first, later.
fn restarts(entry: &EnvEntry, config: &EnvConfig) -> Result<BTreeMap<String, [f64; 2]>, String> {
    let mut differences = BTreeMap::new();
    let (mut recorded, mut restarted) = (Bench::new(entry, config)?, Bench::new(entry, config)?);
    if recorded.env.spec().start_columns.is_empty() {
        return Ok(differences);
    }
    for (seed, hold) in EPISODES {
        let rows = record(&mut recorded, seed, hold)?;
        for start in STARTS {
            restarted.reset(seed, &start_at(recorded.env.spec(), &rows[start]))?;
            compare(&rows[start], &restarted.row, 0, &mut differences);
            for step in start..start + STEPS {
                restarted.step(seed, step / hold)?;
                compare(&rows[step + 1], &restarted.row, 1, &mut differences);
            }
        }
    }
    Ok(differences)
}

/// Every row of an episode.
fn record(bench: &mut Bench, seed: u64, hold: usize) -> Result<Vec<Batch>, String> {
    bench.reset(seed, &ResetOptions::default())?;
    let mut rows = vec![bench.row.clone()];
    for step in 0..STARTS[STARTS.len() - 1] + STEPS {
        bench.step(seed, step / hold)?;
        rows.push(bench.row.clone());
    }
    Ok(rows)
}

/// What a reset needs to start at a row, under the factors that a recording holds: others have their defaults.
fn start_at(spec: &EnvSpec, row: &Batch) -> ResetOptions {
    let factors = spec.factors.iter().filter(|factor| factor.sampled_by_default);
    let value = |name: &String| value_of(row, &format!("{VARIATION_PREFIX}{name}"));
    ResetOptions {
        variation: Some(Vec::new()),
        variation_values: factors.map(|factor| (factor.name.clone(), value(&factor.name))).collect(),
        start: Some(columns(row, &[spec.start_columns, spec.start_extras])),
        ..ResetOptions::default()
    }
}

fn columns(row: &Batch, names: &[&[&str]]) -> BTreeMap<String, Value> {
    names.concat().into_iter().map(|name| (name.to_owned(), value_of(row, name))).collect()
}

fn compare(a: &Batch, b: &Batch, phase: usize, differences: &mut BTreeMap<String, [f64; 2]>) {
    for (index, field) in a.schema().fields().iter().enumerate() {
        let found = difference(a.column(index), b.column(index));
        if field.kind == FieldKind::Step && found > 0.0 {
            let known = differences.entry(field.name.clone()).or_default();
            known[phase] = known[phase].max(found);
        }
    }
}

/// The largest absolute difference; infinite where only one is NaN.
fn difference(a: Slice<'_>, b: Slice<'_>) -> f64 {
    let of = |index| match (a.as_f64(index), b.as_f64(index)) {
        (Some(a), Some(b)) if a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()) => 0.0,
        (Some(a), Some(b)) if a.is_finite() && b.is_finite() => (a - b).abs(),
        _ => f64::INFINITY,
    };
    (0..a.len()).map(of).fold(0.0, f64::max)
}

/// Records episodes, starts at steps of them with the same step as goal, and compares the image of the goal with the frame: at
/// most `most[0]` of its pixels may differ, by at most `most[1]`. (The recorded frame itself may show another goal's marker.)
/// Nothing is compared in environments without images of goals, or without goals from recorded steps.
///
/// # Errors
///
/// A sentence, if more differ, or none does where some are expected.
pub fn goals_look_as_recorded(entry: &EnvEntry, config: &EnvConfig, most: [usize; 2]) -> Result<(), String> {
    let found = goal_images(entry, config).map_err(|reason| format!("{}: {reason}", entry.id))?;
    let [pixels, by] = found.unwrap_or_default();
    if pixels <= most[0] && by <= most[1] && (pixels > 0) == (most[0] > 0) {
        return Ok(());
    }
    let (id, expected) = (entry.id, format!("at most {} by up to {}", most[0], most[1]));
    Err(format!("{id}: {pixels} pixels of a goal differ from its frame by up to {by}; expected: {expected}"))
}

fn goal_images(entry: &EnvEntry, config: &EnvConfig) -> Result<Option<[usize; 2]>, String> {
    let (mut recorded, mut restarted) = (Bench::new(entry, config)?, Bench::new(entry, config)?);
    let spec = recorded.env.spec().clone();
    let has = |name: &str| recorded.row.schema().index(name).is_some();
    if spec.goal_columns.is_empty() || !has(GOAL_IMAGE) || !has(PIXELS) {
        return Ok(None);
    }
    let mut most = [0, 0];
    for (seed, hold) in EPISODES {
        let rows = record(&mut recorded, seed, hold)?;
        for goal in STARTS {
            let goal = &rows[goal + STEPS];
            let wanted = Some(columns(goal, &[spec.goal_columns, spec.goal_extras]));
            restarted.reset(seed, &ResetOptions { goal: wanted, ..start_at(&spec, goal) })?;
            let [frame, image] = [PIXELS, GOAL_IMAGE].map(|name| value_of(&restarted.row, name));
            let (frame, image) = (frame.data.as_slice(), image.data.as_slice());
            let (Some(frame), Some(image)) = (frame.get::<u8>(), image.get::<u8>()) else { continue };
            let pixels = frame.chunks_exact(3).zip(image.chunks_exact(3)).filter(|(a, b)| a != b).count();
            let by = frame.iter().zip(image).map(|(a, b)| usize::from(a.abs_diff(*b))).max().unwrap_or(0);
            most = [most[0].max(pixels), most[1].max(by)];
        }
    }
    Ok(Some(most))
}
