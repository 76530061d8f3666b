//! Baselines that learn from clips of a dataset.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json, json};
use swm_core::{BoxError, Registry};
use swm_data::Dataset;
use swm_tasks::memory::machine_bytes;
use swm_tasks::request::{
    Assignment, Fix, Message, Report, TaskError, Train, Trained, apart, holds_images, open_dataset_with,
};
use swm_tasks::threads::within;

use super::looks::looks;
use super::memory::step_note;
use super::quality::OnTheWay;
use super::shown::{Pace, Shown, many, short};
use super::{failed, interrupted};
use crate::baseline::Baseline;
use crate::device::Device;
use crate::models::table::BASELINES;
use crate::precision::Precision;
use crate::train::{
    Diagnosis, End, FitSettings, NewRun, PreparedRun, RunConfig, RunFolder, Split, State, Training,
};

/// Trains a baseline, or resumes its run.
pub(super) fn train(
    request: &Train,
    registry: &Registry,
    report: &mut dyn Report,
) -> Result<Trained, TaskError> {
    let device: Device = request.device.parse().map_err(failed)?;
    let precision: Option<Precision> =
        request.precision.as_deref().map(str::parse).transpose().map_err(failed)?;
    let (mut training, mut measured) = match &request.resume {
        Some(run) => apart(report, || {
            let moved = request.dataset.as_deref();
            let change = |fit: &mut FitSettings| apply(request, fit, precision);
            let training = Training::resume(registry, run, device, moved, change).map_err(failed)?;
            let measured = on_the_way(registry, training.model(), training.config())?;
            Ok::<_, TaskError>((training, measured))
        })??,
        None => begin(request, registry, (device, precision), report)?,
    };
    report.info(&Message::new(beginning(&training)));
    cautions(request, &training).iter().for_each(|note| report.note(note));
    let diagnosis = measured.as_mut().map(|measured| measured as &mut (dyn Diagnosis + Send));
    let (state, done) = fit(request, request.folder(), &mut training, diagnosis, report)?;
    if state.step == done {
        let more = Fix::Set { setting: Assignment::name("steps"), to: "beyond them to continue it" };
        let note = Message::new(format!("finished before: {done} steps are done"));
        report.info(&note.fix(Fix::Any(vec![Fix::give("epochs"), more])));
    }
    let run = request.folder();
    Ok(Trained::new(run, summary(&state, run), serde_json::to_value(&state).map_err(BoxError::from)?))
}

/// Trains to the end: the state there, and the steps that were done before.
fn fit(
    request: &Train,
    run: &Path,
    training: &mut Training,
    diagnosis: Option<&mut (dyn Diagnosis + Send)>,
    report: &mut dyn Report,
) -> Result<(State, u64), TaskError> {
    let has_phases = training.model().phases().len() > 1;
    let done = training.done().map_err(failed)?;
    let shown = Shown::begin(report, run, Pace::Clips, has_phases, [done, training.total()])?;
    let cancel = report.cancel();
    let state = apart(report, || {
        within(request.threads, || {
            let diagnosis = diagnosis.map(|diagnosis| diagnosis as &mut dyn Diagnosis);
            training.run_with(vec![Box::new(shown)], diagnosis, &cancel)
        })
    })??;
    let state = state.map_err(failed)?;
    if state.end == Some(End::Interrupted) { Err(interrupted()) } else { Ok((state, done)) }
}

/// Begins a new run.
fn begin(
    request: &Train,
    registry: &Registry,
    (device, precision): (Device, Option<Precision>),
    report: &mut dyn Report,
) -> Result<(Training, Option<OnTheWay>), TaskError> {
    let known = request.from_run.as_deref().map(known).transpose()?;
    let baseline = known.as_ref().map_or(request.baseline.as_str(), |known| &known.model_config.baseline);
    let out = request.out.as_path();
    let path = request.dataset.as_deref().unwrap_or(Path::new(""));
    let mut fit = FitSettings::default();
    apply(request, &mut fit, precision);
    let split = Split { train: request.split, held_out: request.held_out, seed: fit.seed };
    let changes = request.changes()?;
    let of_baseline = BASELINES.iter().find(|entry| entry.name == baseline);
    let first = of_baseline.map_or("", |entry| entry.presets[0]);
    let preset = request.preset.as_deref().unwrap_or(first);
    let dataset = open_dataset_with(registry, path, &request.opening)?;
    let looks = looks(request, dataset.as_ref(), registry, fit.seed, report)?;
    let drawn = match (baseline, &request.encoder) {
        (KEYPOINT_WM, None) if known.is_none() => {
            let fit = FitSettings { epochs: 1, steps: Some(request.encoder_steps), batch: 0, ..fit.clone() };
            let new = NewRun {
                baseline: KEYPOINTS,
                preset: "small",
                changes: of_encoder(&changes),
                from: None,
                encoder: None,
                looks: looks.clone(),
                split,
                fit: FitSettings { quality_every: 0, patience: 0, ..fit },
                device,
            };
            Some(train_encoder(request, registry, dataset.share(), &new, report)?)
        }
        _ => None,
    };
    let encoder = request.encoder.as_deref().or(drawn.as_deref());
    let from = request.from_run.as_deref();
    let new = NewRun { baseline, preset, changes, from, encoder, looks, split, fit, device };
    let is_blind = !holds_images(dataset.as_ref());
    // What cannot be measured is refused before anything is written.
    let (prepared, measured) = apart(report, move || {
        let prepared = PreparedRun::new(registry, dataset.as_ref(), &new).map_err(failed)?;
        let measured = on_the_way(registry, prepared.model(), prepared.config())?;
        Ok::<_, TaskError>((prepared, measured))
    })??;
    if is_blind {
        let (path, image) = (path.display(), prepared.config().data.image);
        report.note(&Message::new(format!(
            "{path} holds no images; they are rendered at {image}x{image} (the model's size)"
        )));
    }
    if let (Some(run), Some(imported)) = (from, known.and_then(|known| known.imported))
        && !imported.lacks.is_empty()
    {
        let (run, lacks) = (run.display(), imported.lacks.len());
        report.note(&Message::new(format!(
            "{run} was imported without {lacks} tensors of training; they begin random"
        )));
    }
    Ok((prepared.create(out).map_err(failed)?, measured))
}

/// The run with whose weights another one begins.
fn known(run: &Path) -> Result<RunConfig, TaskError> {
    RunFolder::open(run).and_then(|run| RunConfig::read(&run)).map_err(failed)
}

/// Measurements of what is trained, on the episodes of its dataset that validate, where they are asked for.
fn on_the_way(
    registry: &Registry,
    model: &dyn Baseline,
    config: &RunConfig,
) -> Result<Option<OnTheWay>, TaskError> {
    (config.fit.quality_every > 0).then(|| OnTheWay::of(registry, model, config)).transpose()
}

/// What the user of a new run should know before it takes hours.
fn cautions(request: &Train, training: &Training) -> Vec<Message> {
    let (model, config) = (training.model().model_config(), training.config());
    let mut notes = Vec::new();
    let is_on_cpu = request.device == "cpu";
    if model.preset == "paper" && is_on_cpu && request.from_run.is_none() {
        let small = Fix::set_to("preset", "small", "for a CPU");
        notes.push(Message::new("the preset paper is made for a GPU").fix(small));
    }
    let input = training.model().input_spec();
    let (wanted, usual) = (config.fit.batch, input.batch);
    let clips = training.clips().into_iter().map(|[train, _]| train).min().unwrap_or(wanted);
    let batch = wanted.min(clips);
    if batch < wanted {
        notes.push(Message::new(format!(
            "a step takes all {clips} clips that there are to learn from, not {wanted}"
        )));
    }
    if is_on_cpu {
        let image = input.image as u64;
        let clip_bytes = input.num_steps as u64 * image * image * 3 * size_of::<f32>() as u64;
        notes.extend(step_note(batch, clip_bytes, machine_bytes()));
    }
    let weight = model.settings.pointer("/sigreg/weight").and_then(Json::as_f64);
    let is_set = request.set.keys().any(|name| name.starts_with("sigreg"));
    if let Some(weight) = weight.filter(|_| request.resume.is_none() && !is_set && batch != usual) {
        // The statistic is proportional to the number of clips: docs/baselines.md.
        let same = short(weight * usual as f64 / batch.max(1) as f64);
        let same = json!({ "sigreg.weight": same.parse::<f64>().unwrap_or(weight) });
        let text = format!("SIGReg grows with the batch: here {batch} clips instead of {usual}");
        notes.push(Message::new(text).fix(Fix::set_to("set", same, "to keep its share of the loss")));
    }
    notes
}

/// The settings that were given.
fn apply(request: &Train, fit: &mut FitSettings, precision: Option<Precision>) {
    let Train {
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
    } = *request;
    if let Some(epochs) = epochs {
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

/// The world model whose encoder is trained first, where none is given, and that encoder.
const KEYPOINT_WM: &str = "keypoint-wm";
const KEYPOINTS: &str = "keypoints";

/// Settings of a world model that are its encoder's, too.
fn of_encoder(changes: &Json) -> Json {
    let shared = ["image", "encoder"]
        .iter()
        .filter_map(|&name| Some((name.to_owned(), changes.pointer(&format!("/model/{name}"))?.clone())));
    json!({ "model": shared.collect::<Map<_, _>>() })
}

/// Trains an encoder in a folder within that of the run, or to its end there; that folder.
fn train_encoder(
    request: &Train,
    registry: &Registry,
    dataset: Box<dyn Dataset>,
    new: &NewRun<'_>,
    report: &mut dyn Report,
) -> Result<PathBuf, TaskError> {
    let out = request.out.join("encoder");
    let training = apart(report, || {
        let dataset = dataset;
        match out.join("config.json").exists() {
            false => Training::create(registry, &out, dataset.as_ref(), new),
            true => Training::resume(registry, &out, new.device, None, |_| {}),
        }
    })?;
    let mut training = training.map_err(failed)?;
    report.info(&Message::new(format!("first its encoder, in {}: {}", out.display(), beginning(&training))));
    fit(request, &out, &mut training, None, report)?;
    Ok(out)
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

fn summary(state: &State, run: &Path) -> Vec<(&'static str, String)> {
    let value = |values: &[(String, f64)]| values.first().map_or("–".to_owned(), |(_, loss)| short(*loss));
    let why = match state.end {
        Some(End::EarlyStop) => " (stopped early: validation got no better)",
        _ => "",
    };
    let best = state.best.map_or("–".to_owned(), |(step, loss)| format!("{} at step {step}", short(loss)));
    vec![
        ("steps", format!("{}{why}", state.step)),
        ("loss", value(&state.train)),
        ("validation", value(&state.validation)),
        ("best validation", best),
        ("run", run.display().to_string()),
    ]
}
