//! `swm train` at work, in builds that have baselines.

use std::path::{Path, PathBuf};
use std::time::Duration;

use indicatif::{HumanDuration, ProgressBar};
use serde_json::{Map, Value as Json, json};
use swm_baselines::online::AGENTS;
use swm_baselines::train::{
    Diagnosis, End, FitSettings, MetricSink, NewRun, Part, PreparedRun, Record, RunConfig, Split, State,
    Training, with_images,
};
use swm_baselines::{BASELINES, Baseline, BaselineError, Precision};
use swm_core::error::{did_you_mean, nearest};
use swm_core::{ImageSize, Registry, WorldError};
use swm_data::Dataset;

use super::Train;
use crate::cli::args::{assignment, json_value};
use crate::cli::output::{key_values, table};
use crate::cli::train_quality::OnTheWay;
use crate::cli::{Failure, Output, images, inputs, interrupt, memory, usage};

/// How long an interrupted training may take to end its step and to write a checkpoint. Slurm waits 30 s.
pub(super) const SAVING: Duration = Duration::from_secs(25);

impl Train {
    pub(in crate::cli) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        if self.list {
            return list(output);
        }
        let out = self.folder()?;
        if self.is_online(out)? {
            return self.run_online(out, registry, output);
        }
        if self.batch == Some(0) {
            return Err(usage("--batch 0: a step learns from 1 clip or more; leave it out for the preset's"));
        }
        let opening = self.opening()?;
        let device = self.device.parse().map_err(failure)?;
        let precision: Option<Precision> =
            self.precision.as_deref().map(str::parse).transpose().map_err(failure)?;
        let measured = |model: &dyn Baseline, config: &RunConfig| {
            (config.fit.quality_every > 0).then(|| on_the_way(registry, model, config)).transpose()
        };
        let (mut training, mut measured) = if self.resume.is_some() {
            let training = Training::resume(registry, out, device, self.dataset.as_deref(), |fit| {
                self.apply(fit, precision);
            })
            .map_err(failure)?;
            let measured = measured(training.model(), training.config())?;
            (training, measured)
        } else {
            let (Some(baseline), Some(path)) = (self.baseline.as_deref(), &self.dataset) else {
                let name = self.baseline.as_deref().unwrap_or("a baseline");
                return Err(usage(format!("--dataset: name the dataset that {name} learns from")));
            };
            let mut fit = FitSettings::default();
            self.apply(&mut fit, precision);
            let split = Split { train: self.split, held_out: self.held_out, seed: fit.seed };
            let changes = changes(&self.set)?;
            let of_baseline = BASELINES.iter().find(|entry| entry.name == baseline);
            let first = of_baseline.map_or("", |entry| entry.presets[0]);
            let preset = self.preset.as_deref().unwrap_or(first);
            let dataset = inputs::open_with(registry, path, &opening)?;
            let looks = self.looks.looks(dataset.as_ref(), registry, fit.seed, output)?;
            let drawn = match (baseline, &self.encoder) {
                (KEYPOINT_WM, None) => {
                    let fit =
                        FitSettings { epochs: 1, steps: Some(self.encoder_steps), batch: 0, ..fit.clone() };
                    let new = NewRun {
                        baseline: KEYPOINTS,
                        preset: "small",
                        changes: of_encoder(&changes),
                        encoder: None,
                        looks: looks.clone(),
                        split,
                        fit: FitSettings { quality_every: 0, patience: 0, ..fit },
                        device,
                    };
                    Some(train_encoder(registry, dataset.as_ref(), &new, &out.join("encoder"), output)?)
                }
                _ => None,
            };
            let encoder = self.encoder.as_deref().or(drawn.as_deref());
            let new = NewRun { baseline, preset, changes, encoder, looks, split, fit, device };
            let prepared = PreparedRun::new(registry, dataset.as_ref(), &new).map_err(failure)?;
            if !images::holds_images(dataset.as_ref()) {
                let image = prepared.config().data.image;
                let size = ImageSize { height: image, width: image };
                output.note(images::note(path, size, "the model's size"));
            }
            // What cannot be measured is refused before anything is written.
            let measured = measured(prepared.model(), prepared.config())?;
            (prepared.create(out).map_err(failure)?, measured)
        };
        output.note(beginning(&training));
        for note in self.cautions(&training) {
            output.note(note);
        }
        let bar = output.bar_alone(0, "steps");
        let has_phases = training.model().phases().len() > 1;
        let begun_at = training.done().map_err(failure)?;
        let shown = Shown::new(&bar, output, Pace::Clips, has_phases, begun_at);
        let run = out.display().to_string();
        interrupt::allow(SAVING);
        let how = format!("run: swm train --resume {run}");
        let cancel = interrupt::watch_resumable(move || format!("the last checkpoint is safe in {run}"), how);
        let diagnosis = measured.as_mut().map(|measured| measured as &mut dyn Diagnosis);
        let state = training.run_with(vec![Box::new(shown)], diagnosis, &cancel).map_err(failure)?;
        bar.finish_and_clear();
        if state.end == Some(End::Interrupted) {
            return Err(WorldError::Cancelled.into());
        }
        if state.step == begun_at {
            output.note(format_args!(
                "finished before: {begun_at} steps are done; a greater --epochs or --steps continues it"
            ));
        }
        output.result(&state, || text(&state, &out.display().to_string()))
    }

    /// The files that a run reads, before it is submitted as a job.
    pub(in crate::cli) fn inputs(&self) -> Result<Vec<PathBuf>, Failure> {
        let Self { baseline, dataset, encoder, resume, .. } = self;
        let name = baseline.as_deref().unwrap_or_default();
        if resume.is_none() && !trainable().any(|(known, ..)| known == name) {
            return Err(unknown(name));
        }
        changes(&self.set)?;
        Ok(dataset.iter().chain(encoder).cloned().collect())
    }

    /// What a new run should be told about before it takes hours.
    fn cautions(&self, training: &Training) -> Vec<String> {
        let (model, config) = (training.model().model_config(), training.config());
        let mut notes = Vec::new();
        if model.preset == "paper" && self.device == "cpu" {
            notes.push("the preset paper is made for a GPU; --preset small is for a CPU".to_owned());
        }
        let input = training.model().input_spec();
        let (wanted, usual) = (config.fit.batch, input.batch);
        let clips = training.clips().into_iter().map(|[train, _]| train).min().unwrap_or(wanted);
        let batch = wanted.min(clips);
        if batch < wanted {
            notes.push(format!("a step takes all {clips} clips that there are to learn from, not {wanted}"));
        }
        if self.device == "cpu" {
            let image = input.image as u64;
            let clip_bytes = input.num_steps as u64 * image * image * 3 * size_of::<f32>() as u64;
            notes.extend(memory::step_note(batch, clip_bytes, memory::machine_bytes()));
        }
        let weight = model.settings.pointer("/sigreg/weight").and_then(Json::as_f64);
        let is_set = self.set.iter().any(|option| option.starts_with("sigreg"));
        if let Some(weight) = weight.filter(|_| self.resume.is_none() && !is_set && batch != usual) {
            // The statistic is proportional to the number of clips: docs/baselines.md.
            let same = short(weight * usual as f64 / batch.max(1) as f64);
            notes.push(format!(
                "SIGReg grows with the batch: with {batch} clips instead of {usual}, --set sigreg.weight={same} keeps its share of the loss"
            ));
        }
        notes
    }

    /// The settings that were given.
    fn apply(&self, fit: &mut FitSettings, precision: Option<Precision>) {
        let Self {
            epochs,
            steps,
            batch,
            seed,
            log_every,
            checkpoint_every,
            keep,
            norm_batches,
            patience,
            quality_every,
            ..
        } = self;
        if let Some(epochs) = *epochs {
            (fit.epochs, fit.steps) = (epochs, None);
        }
        fit.steps = steps.or(fit.steps);
        fit.batch = batch.unwrap_or(fit.batch);
        fit.seed = seed.unwrap_or(fit.seed);
        fit.log_every = log_every.unwrap_or(fit.log_every);
        fit.checkpoint_every = checkpoint_every.unwrap_or(fit.checkpoint_every);
        fit.keep = keep.unwrap_or(fit.keep);
        fit.norm_batches = norm_batches.unwrap_or(fit.norm_batches);
        fit.patience = patience.unwrap_or(fit.patience);
        fit.quality_every = quality_every.unwrap_or(fit.quality_every);
        fit.precision = precision.unwrap_or(fit.precision);
    }
}

/// The world model whose encoder is trained first, where none is given, and that encoder.
const KEYPOINT_WM: &str = "keypoint-wm";
const KEYPOINTS: &str = "keypoints";

/// What settings of a world model say of its encoder.
fn of_encoder(changes: &Json) -> Json {
    let shared = ["image", "encoder"]
        .iter()
        .filter_map(|&name| Some((name.to_owned(), changes.pointer(&format!("/model/{name}"))?.clone())));
    json!({ "model": shared.collect::<Map<_, _>>() })
}

/// Trains an encoder in the folder `out`, or to its end there; that folder.
fn train_encoder(
    registry: &Registry,
    dataset: &dyn Dataset,
    new: &NewRun<'_>,
    out: &Path,
    output: &Output,
) -> Result<PathBuf, Failure> {
    let mut training = match out.join("config.json").exists() {
        false => Training::create(registry, out, dataset, new),
        true => Training::resume(registry, out, new.device, None, |_| {}),
    }
    .map_err(failure)?;
    output.note(format!("first its encoder, in {}: {}", out.display(), beginning(&training)));
    let bar = output.bar_alone(0, "steps");
    let begun_at = training.done().map_err(failure)?;
    let shown = Shown::new(&bar, output, Pace::Clips, false, begun_at);
    let run = out.display().to_string();
    interrupt::allow(SAVING);
    let how = "run the same command".to_owned();
    let cancel = interrupt::watch_resumable(move || format!("the last checkpoint is safe in {run}"), how);
    let state = training.run_with(vec![Box::new(shown)], None, &cancel).map_err(failure)?;
    bar.finish_and_clear();
    match state.end {
        Some(End::Interrupted) => Err(WorldError::Cancelled.into()),
        _ => Ok(out.to_owned()),
    }
}

/// Measurements of what is trained, on the episodes of its dataset that validate.
fn on_the_way(registry: &Registry, model: &dyn Baseline, config: &RunConfig) -> Result<OnTheWay, Failure> {
    let RunConfig { data, fit, .. } = config;
    if model.planner().is_none() {
        let name = model.name();
        return Err(usage(format!(
            "--quality-every measures world models, and {name} is a policy; leave it out"
        )));
    }
    let dataset = inputs::open_with(registry, &data.path, &data.opening)?;
    let image = model.input_spec().image;
    let dataset =
        with_images(dataset.as_ref(), registry, model.name(), image, &data.looks).map_err(failure)?;
    OnTheWay::new(registry, dataset.as_ref(), data.split, model.input_spec(), fit.seed)
}

/// Wrong settings and folders are wrong requests.
pub(super) fn failure(error: BaselineError) -> Failure {
    match error {
        BaselineError::UnknownBaseline { .. }
        | BaselineError::UnknownPreset { .. }
        | BaselineError::Settings { .. }
        | BaselineError::Training { .. }
        | BaselineError::Columns { .. }
        | BaselineError::Device { .. }
        | BaselineError::Run { .. } => usage(error),
        BaselineError::World(error) => error.into(),
        BaselineError::Dataset(error) => error.into(),
        error => error.into(),
    }
}

/// `--set a.b=1` as nested objects.
pub(super) fn changes(set: &[String]) -> Result<Json, Failure> {
    let mut changes = Json::Object(Map::new());
    for option in set {
        let (name, value) = assignment(option, "--set")?;
        let mut place = &mut changes;
        for part in name.split('.') {
            let Json::Object(fields) = place else {
                return Err(usage(format!("--set {option}: a part of `{name}` was set as a whole before")));
            };
            place = fields.entry(part.to_owned()).or_insert_with(|| Json::Object(Map::new()));
        }
        *place = json_value(value);
    }
    Ok(changes)
}

/// Name, presets and description of all that can be trained: baselines, then agents.
pub(super) fn trainable() -> impl Iterator<Item = (&'static str, &'static [&'static str], &'static str)> {
    let agents = AGENTS.iter().map(|agent| (agent.name, agent.presets, agent.about));
    BASELINES.iter().map(|entry| (entry.name, entry.presets, entry.about)).chain(agents)
}

/// The refusal of a name that can be trained nowhere.
pub(super) fn unknown(name: &str) -> Failure {
    let names: Vec<&str> = trainable().map(|(name, ..)| name).collect();
    let meant = did_you_mean(nearest(name, names.iter().copied()).as_deref());
    usage(format!("unknown baseline or agent `{name}`{meant}; there are: {}", names.join(", ")))
}

fn list(output: &Output) -> Result<(), Failure> {
    let all: Vec<Json> = trainable()
        .map(|(name, presets, about)| json!({ "name": name, "about": about, "presets": presets }))
        .collect();
    let rows: Vec<Vec<String>> = trainable()
        .map(|(name, presets, about)| vec![name.to_owned(), presets.join(", "), about.to_owned()])
        .collect();
    output.result(&all, || table(&["baseline", "presets", "what it is"], &rows))
}

/// What is trained, and on how much.
fn beginning(training: &Training) -> String {
    let (model, clips) = (training.model(), training.clips());
    let same = clips.iter().all(|of| *of == clips[0]);
    let phases =
        model.phases().iter().map(|phase| if same { String::new() } else { format!("{}: ", phase.name) });
    let clips: Vec<String> = phases
        .zip(&clips)
        .map(|(phase, [train, validation])| {
            format!("{phase}{train} to learn from, {validation} to validate with")
        })
        .take(if same { 1 } else { clips.len() })
        .collect();
    let numbers = many(model.parameters());
    let (name, preset) = (model.name(), &model.model_config().preset);
    let first = if model.trains_on_latents() { "; first, its encoder sees each image once" } else { "" };
    format!("{name}, preset {preset}, {numbers} parameters; clips: {}{first}", clips.join("; "))
}

/// A number of parameters.
pub(super) fn many(count: usize) -> String {
    match count {
        few @ ..1_000_000 => few.to_string(),
        many => format!("{:.2} million", many as f64 / 1e6),
    }
}

/// A loss or another value, to four digits or so.
pub(super) fn short(value: f64) -> String {
    match value.abs() {
        size if size.fract() == 0.0 && size < 1e6 => format!("{value:.0}"),
        size if size < 1e-3 => format!("{value:.1e}"),
        size if size < 10.0 => format!("{value:.4}"),
        size if size < 1e3 => format!("{value:.2}"),
        size if size < 1e6 => format!("{value:.0}"),
        _ => format!("{value:.3e}"),
    }
}

/// Progress for people: a bar where somebody watches, else lines.
pub(super) struct Shown<'a> {
    bar: ProgressBar,
    output: &'a Output,
    /// Whether nobody watches a bar.
    lines: bool,
    pace: Pace,
    /// Whether there is more than one phase, so that a loss alone does not tell what it is of.
    has_phases: bool,
    /// Steps that were done at the last record, or before; and the time since the beginning.
    last: (u64, Duration),
}

/// What the speed of a training is counted in.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Pace {
    /// Clips of a dataset.
    Clips,
    /// Steps of an environment.
    EnvSteps,
}

impl<'a> Shown<'a> {
    /// `begun_at`: steps that were done before.
    pub(super) fn new(
        bar: &ProgressBar,
        output: &'a Output,
        pace: Pace,
        has_phases: bool,
        begun_at: u64,
    ) -> Self {
        if begun_at > 0 {
            output.note(format!("continues at step {begun_at}"));
        }
        let lines = !output.shows_bars();
        Self { bar: bar.clone(), output, lines, pace, has_phases, last: (begun_at, Duration::ZERO) }
    }
}

impl MetricSink for Shown<'_> {
    fn record(&mut self, record: &Record) -> Result<(), BaselineError> {
        let losses: Vec<String> =
            record.values.iter().map(|(name, value)| format!("{name} {}", short(*value))).collect();
        let losses = losses.join(", ");
        let Record { step, total, elapsed, clips_per_s, .. } = *record;
        let since = elapsed.saturating_sub(self.last.1).as_secs_f64();
        let seconds_a_step = since / step.saturating_sub(self.last.0).max(1) as f64;
        let speed = match self.pace {
            Pace::Clips => format!("{clips_per_s:.0} clips/s"),
            Pace::EnvSteps => format!("{:.0} steps/s", 1.0 / seconds_a_step.max(1e-9)),
        };
        if record.part == Part::Train {
            self.last = (step, elapsed);
            self.bar
                .set_message(format!("loss {}, {speed}", short(record.value("loss").unwrap_or(f64::NAN))));
        }
        if self.lines || record.part != Part::Train {
            let left = Duration::from_secs_f64(seconds_a_step * total.saturating_sub(step) as f64);
            let speed = match record.part {
                // Steps before the first update say nothing about those after it.
                Part::Train if clips_per_s == 0.0 => String::new(),
                Part::Train => format!("; {speed}, {} left", HumanDuration(left)),
                Part::Validation | Part::Quality | Part::Evaluation => String::new(),
            };
            let phase = if self.has_phases { format!(" ({})", record.phase) } else { String::new() };
            let line = format!("{step} of {total}{phase}: {} {losses}{speed}", record.part.name());
            self.bar.suspend(|| self.output.note(line));
        }
        Ok(())
    }

    fn step(&mut self, step: u64, total: u64) {
        self.bar.set_length(total);
        self.bar.set_position(step);
    }
}

fn text(state: &State, run: &str) -> String {
    let value = |values: &[(String, f64)]| values.first().map_or("–".to_owned(), |(_, loss)| short(*loss));
    let why = match state.end {
        Some(End::EarlyStop) => " (stopped early: validation got no better)",
        _ => "",
    };
    let best = state.best.map_or("–".to_owned(), |(step, loss)| format!("{} at step {step}", short(loss)));
    key_values(&[
        ("steps", format!("{}{why}", state.step)),
        ("loss", value(&state.train)),
        ("validation", value(&state.validation)),
        ("best validation", best),
        ("run", run.to_owned()),
    ])
}

#[cfg(test)]
#[path = "train_tests.rs"]
mod tests;
