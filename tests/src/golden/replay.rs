//! Running a recorded trajectory again and comparing every row.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use anyhow::{Context as _, Result, anyhow};
use serde_json::Value as Json;
use swm::core::env::PIXELS;
use swm::core::{
    Batch, Column, Dtype, Env, EnvConfig, EnvSpec, Episode, EpisodeSeed, ImageSize, Outcome, Registry,
    ResetOptions, Schema, Value,
};

use super::doors;
use super::fetch;
use super::file::{GoldenFile, Image};
use super::mazes;
use super::piecewise;
use super::rules::{ImageTolerance, Rules, Tolerance, Unit};

/// How one array compares.
#[derive(Debug)]
pub struct Comparison {
    /// Key of the array, or image.
    pub column: String,
    /// Worst difference, as a multiple of what is accepted: above 1 it fails.
    pub excess: f64,
    /// The absolute difference there (of an image: the share of unequal pixels).
    pub worst: f64,
    /// Step of the worst difference.
    pub row: usize,
    /// What is accepted there; `None`: a difference is expected.
    pub tolerance: Option<f64>,
    /// Further words.
    pub note: String,
}

impl Comparison {
    /// Whether the difference is accepted.
    pub fn passes(&self) -> bool {
        self.tolerance.is_none() || self.excess <= 1.0
    }
}

/// The comparisons of one file.
#[derive(Debug)]
pub struct Report {
    /// All of them.
    pub comparisons: Vec<Comparison>,
    /// Differences on purpose, in words.
    pub expected: Vec<&'static str>,
    /// The trajectory itself differs on purpose.
    pub trajectory_differs: bool,
}

impl Report {
    /// Whether everything that should agree does.
    pub fn passes(&self) -> bool {
        self.trajectory_differs || self.comparisons.iter().all(Comparison::passes)
    }
}

/// Arrays of which row t belongs to the step from t to t + 1.
const OUTCOMES: [&str; 3] = ["reward", "terminated", "is_success"];

/// Replays one file.
///
/// # Errors
///
/// The file lacks an array, or the environment cannot be made, reset or stepped. Differences are part of the report.
pub fn check_file(registry: &Registry, rules: &Rules, file: &GoldenFile) -> Result<Report> {
    let mut factors = file.factors.clone();
    let mut expected = (rules.adapt)(&mut factors);
    expected.extend(fetch::was_not_drawn(file));
    let mut run = Run::new(registry, rules, file)?;
    if rules.env_id == doors::ENV {
        doors::add_unrecorded(&mut run, rules, file, &mut factors)?;
    }
    let options = run.start(rules, file, &factors)?;
    let tolerance = rules.tolerance[usize::from(!file.factors.is_empty())];
    let mut worst: BTreeMap<&str, Comparison> = BTreeMap::new();
    let mut comparisons = Vec::new();
    let actions = file.rows("actions").context("no actions")?;
    run.reset(&options)?;
    let is_expected = |name: &str| rules.expected_differences.iter().any(|(expected, _)| *expected == name);
    let is_compared = rules.compares_images() && !is_expected("goal_png");
    if let Some(goal) = file.goal_image.as_ref().filter(|_| is_compared) {
        comparisons.push(compare_image("goal_png", goal, run.row.get("goal")?, rules.images, 0));
    }
    for row in 0..=actions.len().min(rules.steps) {
        for &(key, units) in rules.compared {
            if OUTCOMES.contains(&key) {
                continue;
            }
            let Some(expected) = recorded(file, key, row) else { continue };
            let actual = run.field(key)?;
            note_worst(&mut worst, (key, units, tolerance), row, &expected, &actual);
        }
        if let Some(image) = file.images.get(&row).filter(|_| rules.compares_images()) {
            let name = format!("img_{row}_png");
            comparisons.push(compare_image(&name, image, run.row.get(PIXELS)?, rules.images, row));
        }
        if let Some(action) = actions.get(row).filter(|_| row < rules.steps) {
            let outcome = run.step(action)?;
            let of = |flag: bool| f64::from(u8::from(flag));
            let actual = [outcome.reward, of(outcome.terminated), of(outcome.success == Some(true))];
            for &(key, units) in rules.compared {
                let Some(index) = OUTCOMES.iter().position(|outcome| *outcome == key) else { continue };
                let Some(expected) = recorded(file, key, row) else { continue };
                note_worst(&mut worst, (key, units, tolerance), row, &expected, &actual[index..=index]);
            }
        }
    }
    comparisons.extend(worst.into_values());
    for &(key, reason) in rules.expected_differences {
        if file.numbers.contains_key(key) || (key == "goal_png" && file.goal_image.is_some()) {
            let (column, note) = (key.to_owned(), format!("expected difference: {reason}"));
            comparisons.push(Comparison {
                column,
                excess: 0.0,
                worst: f64::NAN,
                row: 0,
                tolerance: None,
                note,
            });
        }
    }
    let trajectory_differs = expected.iter().any(|words| words.contains("trajectories differ"));
    Ok(Report { comparisons, expected, trajectory_differs })
}

/// A row of an array that changes, or the whole of one that does not (`goal_state`), compared once.
fn recorded(file: &GoldenFile, key: &str, row: usize) -> Option<Vec<f64>> {
    if key.starts_with("goal_") {
        return (row == 0).then(|| file.numbers.get(key).map(|array| array.iter().copied().collect()))?;
    }
    let array = file.numbers.get(key)?;
    (row < array.shape()[0]).then(|| array.index_axis(ndarray::Axis(0), row).iter().copied().collect())
}

fn note_worst<'a>(
    worst: &mut BTreeMap<&'a str, Comparison>,
    (key, units, tolerance): (&'a str, &[Unit], Tolerance),
    row: usize,
    expected: &[f64],
    actual: &[f64],
) {
    let entry = worst.entry(key).or_insert(Comparison {
        column: key.to_owned(),
        excess: 0.0,
        worst: 0.0,
        row,
        tolerance: Some(tolerance.of(units[0])),
        note: String::new(),
    });
    if expected.len() != actual.len() || units.len() != actual.len() {
        entry.excess = f64::INFINITY;
        entry.note = format!("{} values recorded, {} here", expected.len(), actual.len());
        return;
    }
    for ((&a, &b), &unit) in expected.iter().zip(actual).zip(units) {
        let mut difference = if a.is_nan() && b.is_nan() { 0.0 } else { (a - b).abs() };
        if unit == Unit::Rad {
            difference = difference.min((difference - TAU).abs());
        }
        let accepted = tolerance.of(unit);
        let excess = if difference == 0.0 { 0.0 } else { difference / accepted };
        // NaN on one side only is the worst of all.
        let excess = if excess.is_nan() { f64::INFINITY } else { excess };
        if excess > entry.excess {
            (entry.excess, entry.worst, entry.row, entry.tolerance) =
                (excess, difference, row, Some(accepted));
        }
    }
}

/// Compares images: the share of unequal pixels counts, and the largest difference.
fn compare_image(
    name: &str,
    expected: &Image,
    actual: &[u8],
    accepted: ImageTolerance,
    row: usize,
) -> Comparison {
    let column = name.to_owned();
    let tolerance = Some(1.0 - accepted.equal_pixels);
    if expected.rgb.len() != actual.len() {
        let note = format!("{} bytes instead of {}", actual.len(), expected.rgb.len());
        return Comparison { column, excess: f64::INFINITY, worst: 1.0, row, tolerance, note };
    }
    let pairs = expected.rgb.chunks_exact(3).zip(actual.chunks_exact(3));
    let unequal = pairs.filter(|(a, b)| a != b).count();
    let largest = expected.rgb.iter().zip(actual).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
    let worst = unequal as f64 / (expected.height * expected.width) as f64;
    let note = format!("{unequal} unequal pixels, largest difference {largest} levels");
    let excess = worst / (1.0 - accepted.equal_pixels);
    let excess = if largest > accepted.largest_difference { f64::INFINITY } else { excess };
    Comparison { column, excess, worst, row, tolerance, note }
}

/// One environment and its row.
pub(super) struct Run {
    env: Box<dyn Env>,
    pub(super) row: Batch,
}

impl Run {
    fn new(registry: &Registry, rules: &Rules, file: &GoldenFile) -> Result<Self> {
        let image = file.images.values().next().or(file.goal_image.as_ref());
        let image = image.filter(|_| rules.compares_images());
        let mut config = EnvConfig {
            image: image.map(|p| ImageSize { height: p.height, width: p.width }),
            ..EnvConfig::default()
        };
        (rules.settings)(&mut config.settings);
        piecewise::set_grid(file, &mut config.settings);
        mazes::set_maze(file, &mut config.settings);
        let env = registry.env(rules.env_id)?.make(&config)?;
        let row = Batch::new(Schema::new(env.spec().fields.clone())?, 1);
        Ok(Self { env, row })
    }

    pub(super) fn reset(&mut self, options: &ResetOptions) -> Result<()> {
        self.env.reset(&Episode::new(EpisodeSeed::new(0), options))?;
        self.env.write_episode(&mut self.row.rows_mut());
        self.env.observe(&mut self.row.rows_mut());
        Ok(())
    }

    fn step(&mut self, action: &[f64]) -> Result<Outcome> {
        let space = &self.env.spec().action;
        let dtype = space.dtype().unwrap_or(Dtype::F64);
        let action = Value::vector(action).cast("action", dtype, &space.shape())?;
        let outcome = self.env.step(action.data.as_slice())?;
        self.env.observe(&mut self.row.rows_mut());
        Ok(outcome)
    }

    /// The field that an array of the file holds.
    fn field(&self, key: &str) -> Result<Vec<f64>> {
        let prefixes = ["obs_", "info_", "state_"];
        let name = prefixes.iter().find_map(|prefix| key.strip_prefix(prefix)).unwrap_or(key);
        let name = if name == "obs" { "observation" } else { name };
        let index = self.row.schema().require(name)?;
        let column: Column = self.row.column(index).to_column();
        Ok(Value { shape: vec![column.len()], data: column }.to_f64s(name)?)
    }

    /// Reset options whose first row is the recorded one.
    ///
    /// The recorded start is known only after the reset's own physics step, so the factors are corrected until the
    /// first rows agree; two or three rounds suffice.
    pub(super) fn start(
        &mut self,
        rules: &Rules,
        file: &GoldenFile,
        factors: &serde_json::Map<String, Json>,
    ) -> Result<ResetOptions> {
        let mut options = ResetOptions { variation: Some(Vec::new()), ..ResetOptions::default() };
        for (name, json) in factors {
            options.variation_values.insert(name.clone(), Value::from_json(name, json)?);
        }
        let specs = self.env.spec().factors.clone();
        let mut targets = Vec::new();
        for &(key, first, factor) in rules.starts {
            let spec = specs.iter().find(|spec| spec.name == factor).context("unknown start factor")?;
            let row = recorded(file, key, 0).ok_or_else(|| anyhow!("{} has no {key}", file.name))?;
            let wanted = row[first..first + spec.space.dim()].to_vec();
            if !factors.contains_key(factor) {
                targets.push((key, first, factor, spec.space.bounds(), wanted));
            }
        }
        for (.., factor, (low, high), wanted) in &targets {
            options.variation_values.insert((*factor).to_owned(), Value::vector(&clamp(wanted, low, high)));
        }
        for column in self.env.spec().goal_columns {
            if let Some(goal) = recorded(file, &format!("goal_{column}"), 0) {
                options.goal.get_or_insert_default().insert((*column).to_owned(), Value::vector(&goal));
            }
        }
        let start = recorded_start(file, self.env.spec());
        if !start.is_empty() {
            options.start = Some(start);
            return Ok(options);
        }
        for _ in 0..4 {
            self.reset(&options)?;
            for (key, first, factor, (low, high), wanted) in &targets {
                let actual = self.field(key)?;
                let now = options.variation_values[*factor].to_f64s(factor)?;
                let corrected: Vec<f64> = (now.iter().zip(wanted).zip(&actual[*first..]))
                    .map(|((now, wanted), actual)| now + (wanted - actual))
                    .collect();
                options
                    .variation_values
                    .insert((*factor).to_owned(), Value::vector(&clamp(&corrected, low, high)));
            }
        }
        Ok(options)
    }
}

/// `(array of the file, row, start column)`.
type Place = (&'static str, usize, &'static str);

/// Where a reset of an environment places things by writing into the model.
fn placed_in_model(env_id: &str) -> &'static [Place] {
    const PLACED: &[(&str, &[Place])] = &[
        ("swm/ReacherDMControl-v0", &[("model_geom_pos", 6, "target_pos")]),
        ("swm/FingerDMControl-v0", &[("model_site_pos", 0, "target_pos")]),
        (
            "swm/ManipulatorDMControl-v0",
            &[("model_body_pos", 11, "target_pos"), ("model_body_quat", 11, "target_quat")],
        ),
    ];
    PLACED.iter().find(|(id, _)| *id == env_id).map_or(&[], |(_, places)| places)
}

/// The columns of a start that the file holds: its whole state (`state_*`), and what the task had placed in the model.
fn recorded_start(file: &GoldenFile, spec: &EnvSpec) -> BTreeMap<String, Value> {
    let mut start = BTreeMap::new();
    for column in spec.start_columns {
        if let Some(row) = recorded(file, &format!("state_{column}"), 0) {
            start.insert((*column).to_owned(), Value::vector(&row));
        }
    }
    for (key, index, column) in placed_in_model(&spec.id) {
        if let Some(row) = recorded(file, key, *index) {
            start.insert((*column).to_owned(), Value::vector(&row));
        }
    }
    start
}

fn clamp(values: &[f64], low: &[f64], high: &[f64]) -> Vec<f64> {
    values.iter().zip(low.iter().zip(high)).map(|(v, (low, high))| v.clamp(*low, *high)).collect()
}
