//! From recorded steps back to reset options: the state to start from, or the whole episode to repeat.

use std::collections::BTreeMap;

use super::Dataset;
use crate::batch::{Batch, Field, Schema, Value};
use crate::env::{EnvSpec, ResetOptions, VARIATION_PREFIX};
use crate::error::{BatchError, BoxError};
use crate::seed::EpisodeSeed;

/// Reset options that stand at a recorded row, under the factors of its episode as far as the dataset holds them.
/// The goal is not set.
///
/// # Errors
///
/// No such episode or row, or what is stored cannot be read.
pub fn recorded_state(
    spec: &EnvSpec,
    source: &mut dyn Dataset,
    episode: usize,
    row: usize,
) -> Result<ResetOptions, BoxError> {
    Ok(ResetOptions {
        variation: Some(Vec::new()),
        variation_values: recorded_factors(spec, source, episode)?,
        start: Some(read_known(source, episode, row, &[spec.start_columns, spec.start_extras].concat())?),
        ..ResetOptions::default()
    })
}

/// The columns of a recorded `[episode, row]` that set a goal, and with images those that they take besides
/// ([`EnvSpec::goal_extras`]); none where the dataset has none of them.
///
/// # Errors
///
/// As of [`recorded_state`].
pub fn recorded_goal(
    spec: &EnvSpec,
    source: &mut dyn Dataset,
    [episode, row]: [usize; 2],
    has_images: bool,
) -> Result<BTreeMap<String, Value>, BoxError> {
    let mut goal = read_known(source, episode, row, spec.goal_columns)?;
    if has_images && !goal.is_empty() {
        goal.extend(read_known(source, episode, row, spec.goal_extras)?);
    }
    Ok(goal)
}

/// Reset options that repeat a recorded episode from its first row: its factors, its goal, its seed.
///
/// Where the factors of the episode are known, the reset places things from them, just as the recorded one did:
/// in files of this program (a factor without a column was at its default), and in others that hold every factor that
/// is sampled by default. Otherwise it stands at the first recorded row.
///
/// # Errors
///
/// As of [`recorded_state`].
pub fn whole_episode(
    spec: &EnvSpec,
    source: &mut dyn Dataset,
    episode: usize,
) -> Result<ResetOptions, BoxError> {
    let mut options = recorded_state(spec, source, episode, 0)?;
    let held = |name: &String| options.variation_values.contains_key(name);
    let all_known = match source.metadata() {
        Some(metadata) => !metadata.from_recorded_rows,
        None => {
            spec.factors.iter().filter(|factor| factor.sampled_by_default).all(|factor| held(&factor.name))
        }
    };
    if all_known {
        options.start = None;
    }
    let mut goal = BTreeMap::new();
    for column in spec.goal_columns {
        let name = format!("goal_{column}");
        if source.schema().index(&name).is_some() {
            goal.extend(
                read_step(source, episode, 0, &[&name])?.into_values().map(|v| ((*column).to_owned(), v)),
            );
        }
    }
    options.goal = (!goal.is_empty()).then_some(goal);
    if source.metadata().is_some() && source.schema().index("seed").is_some() {
        let seed = read_step(source, episode, 0, &["seed"])?.remove("seed").expect("asked for");
        options.seed = match seed.data {
            crate::batch::Column::I64(values) => values.first().map(|&seed| EpisodeSeed::new(seed as u64)),
            _ => None,
        };
    }
    Ok(options)
}

/// The values of the factors that the dataset holds, as the environment's types. The reference stores scalars as
/// `[T]` or `[T, 1]`; both hold one number.
fn recorded_factors(
    spec: &EnvSpec,
    source: &mut dyn Dataset,
    episode: usize,
) -> Result<BTreeMap<String, Value>, BoxError> {
    let mut values = BTreeMap::new();
    let runs = &source.info().runs;
    let run = runs.iter().rfind(|&&(first, _)| first <= episode as u64).map(|(_, run)| run.clone());
    for factor in &spec.factors {
        // A column may be there for other runs: what this one neither sampled nor set stays so.
        if run.as_ref().is_some_and(|run| !run.varies(factor)) {
            continue;
        }
        let column = format!("{VARIATION_PREFIX}{}", factor.name);
        let Some(dtype) = factor.space.dtype() else { continue };
        if source.schema().index(&column).is_none() {
            continue;
        }
        for (name, value) in read_step(source, episode, 0, &[&column])? {
            values.insert(factor.name.clone(), value.cast(&name, dtype, &factor.space.shape())?);
        }
    }
    Ok(values)
}

/// As [`read_step`], without the columns that the dataset lacks.
///
/// # Errors
///
/// No such episode or row, or what is stored cannot be read.
pub fn read_known(
    source: &mut dyn Dataset,
    episode: usize,
    row: usize,
    columns: &[&str],
) -> Result<BTreeMap<String, Value>, BoxError> {
    let known: Vec<&str> =
        columns.iter().copied().filter(|column| source.schema().index(column).is_some()).collect();
    read_step(source, episode, row, &known)
}

/// Some columns of one recorded row, by name.
///
/// # Errors
///
/// No such column, episode or row, or what is stored cannot be read.
pub fn read_step(
    source: &mut dyn Dataset,
    episode: usize,
    row: usize,
    columns: &[&str],
) -> Result<BTreeMap<String, Value>, BoxError> {
    let fields: Vec<Field> = columns
        .iter()
        .map(|name| Ok(source.schema().fields()[source.schema().require(name)?].clone()))
        .collect::<Result<_, BatchError>>()?;
    let mut batch = Batch::new(Schema::new(fields)?, 0);
    source.read(episode, row..row + 1, &mut batch)?;
    let values = batch
        .schema()
        .fields()
        .iter()
        .enumerate()
        .map(|(index, field)| (field.name.clone(), Value::from_slice(&field.shape, batch.column(index))));
    Ok(values.collect())
}
