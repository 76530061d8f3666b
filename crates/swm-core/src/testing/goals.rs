//! Whether a recorded goal is the episode's goal: in its columns, in what happens, and in its image.

use std::collections::BTreeMap;

use super::bench::{Bench, value_of};
use super::restarts::{EPISODES, Moment, STARTS, STEPS, difference, goal_of};
use crate::batch::{Batch, FieldKind};
use crate::env::{EnvConfig, GOAL_IMAGE, PIXELS, ResetOptions, VARIATION_PREFIX};
use crate::registry::EnvEntry;

/// How much the columns `goal_…` differ from those of the recorded rows that were set as goals, where they do. Of the columns
/// `no_part`, a value that is 0 in all goals is no part of them, such as the velocity of a goal at rest; one without such a value
/// must not be listed.
pub(super) fn goals_kept(
    entry: &EnvEntry,
    config: &EnvConfig,
    no_part: &[NoPart<'_>],
) -> Result<BTreeMap<String, f64>, String> {
    let mut bench = Bench::new(entry, config)?;
    let spec = bench.env.spec().clone();
    if spec.goal_columns.is_empty() {
        return unneeded(no_part, &[]).map(|()| BTreeMap::new());
    }
    let (mut values, mut acts) = (BTreeMap::<(String, usize), Compared>::new(), false);
    for episode in EPISODES {
        let plain = episode.record(&mut bench, None)?;
        for goal in STARTS.map(|start| &plain[start + STEPS].row) {
            let rows = episode.record(&mut bench, Some(&goal_of(&spec, goal)))?;
            acts |= differs(&plain, &rows);
            for column in spec.goal_columns {
                let name = format!("goal_{column}");
                let Some(index) = bench.row.schema().index(&name) else { continue };
                let (expected, found) = (value_of(goal, column), bench.row.column(index));
                let expected = expected.data.as_slice();
                // A column of another form is not the recorded one.
                if expected.len() != found.len() {
                    continue;
                }
                for value in 0..found.len() {
                    let by = difference(expected.range(value, 1), found.range(value, 1));
                    let compared = values.entry((name.clone(), value)).or_default();
                    compared.by = compared.by.max(by);
                    compared.is_set |= found.as_f64(value) != Some(0.0);
                }
            }
        }
    }
    if !acts {
        return Err("a recorded goal changes neither a column nor what happens".to_owned());
    }
    let (mut differences, mut absent) = (BTreeMap::new(), Vec::new());
    for ((name, _), Compared { by, is_set }) in values.into_iter().filter(|(_, found)| found.by > 0.0) {
        if !is_set && no_part.iter().any(|listed| listed.column == name) {
            absent.push(name);
            continue;
        }
        let known: &mut f64 = differences.entry(name).or_default();
        *known = known.max(by);
    }
    unneeded(no_part, &absent)?;
    Ok(differences)
}

/// An error for columns that are listed and not `absent`.
fn unneeded(no_part: &[NoPart<'_>], absent: &[String]) -> Result<(), String> {
    match no_part.iter().find(|listed| !absent.iter().any(|name| name == listed.column)) {
        Some(NoPart { column, .. }) => {
            Err(format!("`{column}` has all values of a goal, and is listed in `no_part`"))
        }
        None => Ok(()),
    }
}

/// Factors that choose the goal where none is recorded: they move columns `goal_…` at a reset, and no column of a start.
pub(super) fn factors_of_goals(bench: &mut Bench) -> Result<Vec<String>, String> {
    let spec = bench.env.spec().clone();
    let goals: Vec<String> = spec.goal_columns.iter().map(|column| format!("goal_{column}")).collect();
    let moved = |a: &Batch, b: &Batch, name: &str| {
        let index = a.schema().index(name);
        index.is_some_and(|index| difference(a.column(index), b.column(index)) > 0.0)
    };
    let mut found = Vec::new();
    for factor in &spec.factors {
        let mut options =
            ResetOptions { variation: Some(vec![factor.name.clone()]), ..ResetOptions::default() };
        // Values that a constraint refuses under the defaults of all others show nothing.
        let Ok((seed, _)) = bench.reset_from(7, &options) else { continue };
        let sampled = bench.row.clone();
        options.variation = Some(Vec::new());
        bench.reset(seed, &options)?;
        let moves = |name: &str| moved(&sampled, &bench.row, name);
        if goals.iter().any(|name| moves(name)) && !spec.start_columns.iter().any(|name| moves(name)) {
            found.push(factor.name.clone());
        }
    }
    Ok(found)
}

/// A column `goal_…` with values that are no part of a goal, and therefore 0 in all goals.
#[derive(Clone, Copy, Debug)]
pub struct NoPart<'a> {
    /// The column.
    pub column: &'a str,
    /// Why, as the environment's page states it.
    pub reason: &'a str,
}

/// A value of a goal, in all goals.
#[derive(Default)]
struct Compared {
    by: f64,
    is_set: bool,
}

fn differs(a: &[Moment], b: &[Moment]) -> bool {
    a.iter().zip(b).any(|(a, b)| {
        let outcomes = a.outcome.iter().zip(&b.outcome);
        let fields = a.row.schema().fields().iter().enumerate();
        let mut fields = fields
            .filter(|(_, field)| field.kind == FieldKind::Step || !field.name.starts_with(VARIATION_PREFIX));
        outcomes.into_iter().any(|((_, a), (_, b))| a.to_bits() != b.to_bits() && !(a.is_nan() && b.is_nan()))
            || fields.any(|(index, _)| difference(a.row.column(index), b.row.column(index)) > 0.0)
    })
}

/// Records episodes, starts at steps of them with the same step as goal, and compares the image of the goal with the frame: at
/// most `most[0]` of its pixels may differ, by at most `most[1]`. (The recorded frame itself may show another goal's marker.)
/// Nothing is compared in environments without images of goals, or without goals from recorded steps.
///
/// # Errors
///
/// A sentence, if more differ, or none does where some are expected.
pub fn goals_look_as_recorded(entry: &EnvEntry, config: &EnvConfig, most: [usize; 2]) -> Result<(), String> {
    let found = goal_images(entry, config)?;
    let [pixels, by] = found.unwrap_or_default();
    if pixels <= most[0] && by <= most[1] && (pixels > 0) == (most[0] > 0) {
        return Ok(());
    }
    let expected = format!("at most {} by up to {}", most[0], most[1]);
    Err(format!("{pixels} pixels of a goal differ from its frame by up to {by}; expected: {expected}"))
}

fn goal_images(entry: &EnvEntry, config: &EnvConfig) -> Result<Option<[usize; 2]>, String> {
    let (mut recorded, mut restarted) = (Bench::new(entry, config)?, Bench::new(entry, config)?);
    let spec = recorded.env.spec().clone();
    let has = |name: &str| recorded.row.schema().index(name).is_some();
    if spec.goal_columns.is_empty() || !has(GOAL_IMAGE) || !has(PIXELS) {
        return Ok(None);
    }
    let mut most = [0, 0];
    for episode in EPISODES {
        let rows = episode.record(&mut recorded, None)?;
        for goal in STARTS.map(|start| &rows[start + STEPS].row) {
            let wanted = Some(goal_of(&spec, goal));
            restarted
                .reset(episode.seed(), &ResetOptions { goal: wanted, ..episode.start_at(&spec, goal) })?;
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
