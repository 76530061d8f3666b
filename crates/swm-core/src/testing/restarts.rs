//! Whether an episode that starts at a recorded step continues as the recorded one did, towards a recorded goal, and whether
//! rows that are no starts or goals are refused. What is lost is data: see [`Inexact`].

use std::collections::BTreeMap;

use super::bench::{Bench, value_of};
use super::goals::NoPart;
use crate::batch::{Batch, Slice, Value};
use crate::env::{EnvConfig, EnvSpec, Outcome, ResetOptions, VARIATION_PREFIX};
use crate::registry::EnvEntry;

/// A column that differs after a start from a recorded step, or a goal that is not the recorded one.
#[derive(Clone, Copy, Debug)]
pub struct Inexact<'a> {
    /// The column; or `reward`, `terminated`, `success` or `task_cost`.
    pub column: &'a str,
    /// How much the first observation may differ, in absolute terms.
    pub first: f64,
    /// How much the next ten steps may differ.
    pub later: f64,
    /// Why. The environment's page tells users.
    pub reason: &'a str,
}

/// Recorded steps to start from.
pub(super) const STARTS: [usize; 4] = [0, 3, 11, 24];
/// Steps that are compared afterwards.
pub(super) const STEPS: usize = 10;

/// An episode to record.
#[derive(Clone, Copy)]
pub(super) struct Recorded {
    seed: u64,
    /// How many steps each of its actions is held: things move further, and touch.
    hold: usize,
    /// Whether every factor is sampled, or only those that are by default.
    varies: bool,
}

pub(super) const EPISODES: [Recorded; 5] = [
    Recorded { seed: 3, hold: 1, varies: false },
    Recorded { seed: 8, hold: 6, varies: false },
    Recorded { seed: 21, hold: 12, varies: false },
    Recorded { seed: 34, hold: 12, varies: false },
    Recorded { seed: 55, hold: 3, varies: true },
];

/// A row of an episode, and what its step led to.
pub(super) struct Moment {
    pub(super) row: Batch,
    pub(super) outcome: [(&'static str, f64); 4],
}

/// Records episodes with a recorded goal, starts again from some of their steps under the same factors and goal and another
/// seed, and compares all columns, images included, rewards, ends and task costs, of the first observation and of the next ten
/// steps under the same actions: bit for bit, but for `inexact` and the values of goals in `no_part`. Then it does the same with other values of the factors that choose
/// the goal where none is recorded: they have no effect on an episode with a recorded goal. Nothing is compared in environments that
/// cannot start from recorded steps.
///
/// # Errors
///
/// A sentence that names the columns that differ by more, or are listed as inexact and are exact.
pub fn restarts_continue(
    entry: &EnvEntry,
    config: &EnvConfig,
    inexact: &[Inexact<'_>],
    no_part: &[NoPart<'_>],
) -> Result<(), String> {
    let mut found = restarts(entry, config)?;
    for (column, by) in super::goals::goals_kept(entry, config, no_part)? {
        found.entry(column).or_default()[0] = by;
    }
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
        false => Err(format!("after a recorded start and goal: {}", wrong.join(", "))),
    }
}

/// The largest differences of each column that differs: at first, later.
fn restarts(entry: &EnvEntry, config: &EnvConfig) -> Result<BTreeMap<String, [f64; 2]>, String> {
    let mut differences = BTreeMap::new();
    let (mut bench, mut restarted) = (Bench::new(entry, config)?, Bench::new(entry, config)?);
    let spec = bench.env.spec().clone();
    if spec.start_columns.is_empty() {
        return Ok(differences);
    }
    let choosing = super::goals::factors_of_goals(&mut bench)?;
    for episode in EPISODES {
        let mut goal = None;
        if !spec.goal_columns.is_empty() {
            let rows = episode.record(&mut bench, None)?;
            goal = Some(goal_of(&spec, &rows[rows.len() - 1].row));
        }
        let rows = episode.record(&mut bench, goal.as_ref())?;
        for start in STARTS {
            let options = ResetOptions { goal: goal.clone(), ..episode.start_at(&spec, &rows[start].row) };
            let outcome = restarted.reset(episode.seed + 1000, &options)?;
            episode.go_on(&mut restarted, &rows, start, &outcome, &[], &mut differences)?;
            if choosing.is_empty() {
                continue;
            }
            let mut others = options;
            others.variation_values.retain(|name, _| !choosing.contains(name));
            others.variation = Some(choosing.clone());
            let outcome = restarted.reset_from(episode.seed + 2000, &others)?.1;
            episode.go_on(&mut restarted, &rows, start, &outcome, &choosing, &mut differences)?;
        }
    }
    Ok(differences)
}

impl Recorded {
    /// Every row of the episode.
    pub(super) fn record(
        self,
        bench: &mut Bench,
        goal: Option<&BTreeMap<String, Value>>,
    ) -> Result<Vec<Moment>, String> {
        let mut options = ResetOptions::default();
        let mut seed = self.seed;
        if self.varies {
            options.variation = Some(vec!["all".to_owned()]);
            seed = bench.reset_from(seed, &options)?.0;
        }
        options.goal = goal.cloned();
        let outcome = bench.reset(seed, &options)?;
        let mut rows = vec![Moment { row: bench.row.clone(), outcome: bench.outcome(&outcome) }];
        for step in 0..STARTS[STARTS.len() - 1] + STEPS {
            let outcome = self.step(bench, step)?;
            rows.push(Moment { row: bench.row.clone(), outcome: bench.outcome(&outcome) });
        }
        Ok(rows)
    }

    /// Compares an episode that was reset to a recorded row, and the next steps of it. The factors `sampled` have other values.
    fn go_on(
        self,
        bench: &mut Bench,
        rows: &[Moment],
        start: usize,
        outcome: &Outcome,
        sampled: &[String],
        differences: &mut BTreeMap<String, [f64; 2]>,
    ) -> Result<(), String> {
        let outcome = bench.outcome(outcome);
        // What a step was rewarded with is not known at a reset.
        compare(&rows[start], &bench.row, sampled, &outcome[3..], 0, differences);
        for step in start..start + STEPS {
            let outcome = self.step(bench, step)?;
            let outcome = bench.outcome(&outcome);
            // What an episode is rewarded with after its end may depend on how long ago that was.
            let is_over = rows[..=step].iter().any(|moment| moment.outcome[1].1 > 0.0);
            let outcome = if is_over { &outcome[3..] } else { &outcome[..] };
            compare(&rows[step + 1], &bench.row, sampled, outcome, 1, differences);
        }
        Ok(())
    }

    fn step(self, bench: &mut Bench, step: usize) -> Result<Outcome, String> {
        bench.step(self.seed, step / self.hold)
    }

    /// What a reset needs to start at a row, under the factors that a recording holds: others have their defaults.
    pub(super) fn start_at(self, spec: &EnvSpec, row: &Batch) -> ResetOptions {
        let factors = spec.factors.iter().filter(|factor| self.varies || factor.sampled_by_default);
        let value = |name: &String| value_of(row, &format!("{VARIATION_PREFIX}{name}"));
        let start = columns(row, &[spec.start_columns, spec.start_extras]);
        ResetOptions {
            variation: Some(Vec::new()),
            variation_values: factors.map(|factor| (factor.name.clone(), value(&factor.name))).collect(),
            start: (!start.is_empty()).then_some(start),
            ..ResetOptions::default()
        }
    }

    pub(super) fn seed(self) -> u64 {
        self.seed
    }
}

/// What a reset needs for the goal that a row is.
pub(super) fn goal_of(spec: &EnvSpec, row: &Batch) -> BTreeMap<String, Value> {
    columns(row, &[spec.goal_columns, spec.goal_extras])
}

fn columns(row: &Batch, names: &[&[&str]]) -> BTreeMap<String, Value> {
    names.concat().into_iter().map(|name| (name.to_owned(), value_of(row, name))).collect()
}

fn compare(
    expected: &Moment,
    row: &Batch,
    sampled: &[String],
    outcome: &[(&'static str, f64)],
    phase: usize,
    differences: &mut BTreeMap<String, [f64; 2]>,
) {
    let mut note = |name: &str, found: f64| {
        if found > 0.0 {
            let known = differences.entry(name.to_owned()).or_default();
            known[phase] = known[phase].max(found);
        }
    };
    for (index, field) in row.schema().fields().iter().enumerate() {
        let factor = field.name.strip_prefix(VARIATION_PREFIX);
        if factor.is_some_and(|factor| sampled.iter().any(|sampled| sampled == factor)) {
            continue;
        }
        note(&field.name, difference(expected.row.column(index), row.column(index)));
    }
    for (name, value) in outcome {
        let of =
            |outcome: &[(&str, f64)]| outcome.iter().find(|(known, _)| known == name).map(|known| known.1);
        let expected = of(&expected.outcome).unwrap_or(f64::NAN);
        note(name, difference(Slice::F64(&[expected]), Slice::F64(&[*value])));
    }
}

/// The largest absolute difference; infinite where only one is NaN.
pub(super) fn difference(a: Slice<'_>, b: Slice<'_>) -> f64 {
    let of = |index| match (a.as_f64(index), b.as_f64(index)) {
        (Some(a), Some(b)) if a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()) => 0.0,
        (Some(a), Some(b)) if a.is_finite() && b.is_finite() => (a - b).abs(),
        _ => f64::INFINITY,
    };
    (0..a.len()).map(of).fold(0.0, f64::max)
}

/// A start or goal from a row without the columns for it, or of a column in an environment that has none, is an error. So is a row whose columns
/// have another size or hold NaN; where only one of them does, it may also be left alone in favor of the others. Afterwards the
/// environment can be reset.
///
/// # Errors
///
/// A sentence that says what is accepted.
pub fn wrong_rows_are_refused(entry: &EnvEntry, config: &EnvConfig) -> Result<(), String> {
    let mut bench = Bench::new(entry, config)?;
    let spec = bench.env.spec().clone();
    bench.reset(EPISODES[0].seed, &ResetOptions::default())?;
    let row = bench.row.clone();
    for (kind, names) in [("start", spec.start_columns), ("goal", spec.goal_columns)] {
        let mut reset = |row: BTreeMap<String, Value>| {
            let options = match kind {
                "start" => ResetOptions { start: Some(row), ..ResetOptions::default() },
                _ => ResetOptions { goal: Some(row), ..ResetOptions::default() },
            };
            bench.reset(EPISODES[0].seed, &options).ok().map(|_| bench.row.clone())
        };
        if names.is_empty() {
            if reset(BTreeMap::from([("state".to_owned(), Value::scalar(0.0))])).is_some() {
                return Err(format!("a {kind} is accepted, and the description has no columns of one"));
            }
            continue;
        }
        if reset(BTreeMap::new()).is_some() {
            return Err(format!("a {kind} without columns is accepted"));
        }
        let sound = columns(&row, &[names]);
        let expected = reset(sound.clone());
        for (what, spoil) in SPOILED {
            let mut all = sound.clone();
            for name in names {
                let numbers = value_of(&row, name).to_f64s(name).map_err(|error| error.to_string())?;
                let wrong = Value::vector(&spoil(numbers));
                let mut one = sound.clone();
                one.insert((*name).to_owned(), wrong.clone());
                all.insert((*name).to_owned(), wrong);
                if reset(one).is_some_and(|found| expected.as_ref() != Some(&found)) {
                    return Err(format!("a {kind} with {what} in `{name}` is accepted"));
                }
            }
            if reset(all).is_some() {
                return Err(format!("a {kind} with {what} in {} is accepted", names.join(", ")));
            }
        }
    }
    bench.reset(EPISODES[0].seed, &ResetOptions::default())?;
    match row == bench.row {
        true => Ok(()),
        false => Err("a refused start or goal changes the next episode".to_owned()),
    }
}

type Spoil = fn(Vec<f64>) -> Vec<f64>;

/// What spoils the values of a column.
const SPOILED: [(&str, Spoil); 3] = [
    ("a number too many", |numbers| [&numbers[..], &[0.0]].concat()),
    ("a number too few", |numbers| numbers[..numbers.len().saturating_sub(1)].to_vec()),
    ("NaN", |numbers| [&[f64::NAN], numbers.get(1..).unwrap_or_default()].concat()),
];
