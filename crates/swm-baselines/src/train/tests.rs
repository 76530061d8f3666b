//! The loop with a learner of two parameters: what is trained does not matter here, only that it goes on exactly.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use swm_core::env::PIXELS;
use swm_core::{Batch, Cancel, Dtype, Field, Schema};
use swm_data::MemoryDataset;

use super::*;
use crate::baseline::{Baseline, GoalPolicy, InputSpec, Losses, ModelConfig, Phase, PlanModel, Step};
use crate::data::{ClipBatch, DataDims};
use crate::error::BaselineError;
use swm_nn::optim::OptimConfig;

/// Moves its two weights to the mean of the actions that it sees, with momentum.
struct Toy {
    weights: [f32; 2],
    momentum: [f32; 2],
    phases: Vec<Phase>,
    model_config: ModelConfig,
    input_spec: InputSpec,
    /// The step at which its loss is NaN.
    breaks_at: Option<u64>,
    /// Whether its validation loss is NaN.
    is_blind: bool,
    /// How long a step takes.
    pause: Duration,
    /// The losses of steps that wait, if they wait as on a GPU.
    waiting: Option<Vec<Result<Losses, BaselineError>>>,
}

/// A phase without a goal.
pub(super) fn toy_phase() -> Phase {
    let optim = OptimConfig::default();
    Phase { name: "toy", optim, goals: None, trains: &[], targets: &[], momentum: 0.0 }
}

impl Toy {
    fn new() -> Self {
        let dims = DataDims { action_dim: 2, proprio_dim: 0 };
        let (baseline, preset) = ("toy".to_owned(), "toy".to_owned());
        Self {
            weights: [0.0; 2],
            momentum: [0.0; 2],
            phases: vec![toy_phase(), toy_phase()],
            model_config: ModelConfig { baseline, preset, settings: serde_json::Value::Null, dims, seed: 0 },
            input_spec: InputSpec { num_steps: 2, frameskip: 1, image: 1, proprio: false, batch: 16 },
            breaks_at: None,
            is_blind: false,
            pause: Duration::ZERO,
            waiting: None,
        }
    }

    fn gradient(&self, batch: &ClipBatch<'_>) -> [f32; 2] {
        let actions = batch.action.values;
        let mut gradient = [0.0; 2];
        for row in actions.chunks_exact(2) {
            for (axis, gradient) in gradient.iter_mut().enumerate() {
                *gradient += (self.weights[axis] - 1.0 - row[axis]) / actions.len() as f32;
            }
        }
        gradient
    }
}

fn losses([x, y]: [f32; 2]) -> Losses {
    Losses { total: x * x + y * y, parts: vec![("first", x), ("second", y)] }
}

fn save(path: &Path, values: [f32; 2]) -> Result<(), BaselineError> {
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    std::fs::write(path, bytes).unwrap();
    Ok(())
}

fn load(path: &Path) -> [f32; 2] {
    let bytes = std::fs::read(path).unwrap();
    [0, 4].map(|at| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()))
}

impl Baseline for Toy {
    fn name(&self) -> &'static str {
        "toy"
    }
    fn model_config(&self) -> &ModelConfig {
        &self.model_config
    }
    fn input_spec(&self) -> &InputSpec {
        &self.input_spec
    }
    fn phases(&self) -> &[Phase] {
        &self.phases
    }
    fn tensors(&self) -> Vec<(String, Vec<usize>)> {
        Vec::new()
    }

    fn parameters(&self) -> usize {
        2
    }

    fn train_step(&mut self, batch: &ClipBatch<'_>, at: &Step) -> Result<Losses, BaselineError> {
        std::thread::sleep(self.pause);
        if self.breaks_at == Some(at.step) {
            return Err(BaselineError::NotFinite { step: at.step, value: f32::NAN });
        }
        let gradient = self.gradient(batch);
        let rate = 0.3 * (1.0 - at.step as f32 / at.total as f32);
        for ((momentum, weight), slope) in self.momentum.iter_mut().zip(&mut self.weights).zip(gradient) {
            *momentum = 0.5 * *momentum + slope;
            *weight -= rate * *momentum;
        }
        Ok(losses(gradient))
    }

    fn start_step(&mut self, batch: &ClipBatch<'_>, at: &Step) -> Result<Option<Losses>, BaselineError> {
        let losses = self.train_step(batch, at);
        match &mut self.waiting {
            Some(waiting) => {
                waiting.push(losses);
                Ok(None)
            }
            None => losses.map(Some),
        }
    }

    fn take_losses(&mut self) -> Result<Vec<Losses>, BaselineError> {
        self.waiting.as_mut().map(std::mem::take).unwrap_or_default().into_iter().collect()
    }

    fn validate(&self, batch: &ClipBatch<'_>, _phase: usize) -> Result<Losses, BaselineError> {
        Ok(losses(if self.is_blind { [f32::NAN; 2] } else { self.gradient(batch) }))
    }
    fn save_weights(&self, path: &Path) -> Result<(), BaselineError> {
        save(path, self.weights)
    }
    fn load_weights(&mut self, path: &Path) -> Result<(), BaselineError> {
        self.weights = load(path);
        Ok(())
    }
    fn has_frozen_encoder(&self) -> bool {
        false
    }
    fn load_encoder(&mut self, _path: &Path) -> Result<(), BaselineError> {
        Ok(())
    }
    fn save_training(&self, path: &Path) -> Result<(), BaselineError> {
        save(path, self.momentum)
    }
    fn load_training(&mut self, path: &Path) -> Result<(), BaselineError> {
        self.momentum = load(path);
        Ok(())
    }
    fn planner(&self) -> Option<Box<dyn PlanModel>> {
        None
    }
    fn policy(&self) -> Option<Box<dyn GoalPolicy>> {
        None
    }
}

/// 20 episodes of 9 steps with actions that differ.
fn data() -> TrainData {
    let fields = vec![Field::step(PIXELS, Dtype::U8, &[1, 1, 3]), Field::step(ACTION, Dtype::F32, &[2])];
    let schema = Schema::new(fields).unwrap();
    let episode = |number: usize| {
        let mut episode = Batch::new(schema.clone(), 9);
        for row in 0..9 {
            let action = [(number * 9 + row) as f32 * 0.37 % 2.0, number as f32 / 20.0];
            episode.rows_mut().select(row).write(1, &action);
        }
        Arc::new(episode)
    };
    let dataset = MemoryDataset::new("toy", schema.clone(), None, (0..20).map(episode)).unwrap();
    let Toy { input_spec, phases, .. } = Toy::new();
    TrainData::new(&dataset, "toy", &input_spec, &phases, Split::default(), 0).unwrap()
}

/// 18 × 8 clips to learn from: 9 steps per epoch, 2 epochs in each of 2 phases.
fn settings() -> FitSettings {
    FitSettings { epochs: 2, log_every: 4, checkpoint_every: 5, ..FitSettings::default() }
}

fn train(run: &RunFolder, mut model: Toy, settings: &FitSettings) -> Result<State, BaselineError> {
    let from = run.steps()?.last().copied();
    let mut sinks: Vec<Box<dyn MetricSink>> =
        vec![Box::new(JsonLines::after(run, from.unwrap_or(0))?), Box::new(TensorBoard::new(run, from))];
    fit(run, &mut model, &data(), settings, &mut sinks, None, &Cancel::new())
}

/// Asks to stop after so many steps.
struct StopAt(u64, Cancel);

impl MetricSink for StopAt {
    fn record(&mut self, _record: &Record) -> Result<(), BaselineError> {
        Ok(())
    }
    fn step(&mut self, step: u64, _total: u64) {
        if step == self.0 {
            self.1.cancel();
        }
    }
}

/// At every step: amid an epoch, where a checkpoint is due anyway, and where a phase ends.
#[test]
fn a_stopped_run_ends_with_its_step_and_goes_on_as_if_nothing_had_been() {
    let whole = tempfile::tempdir().unwrap();
    train(&new_run(whole.path()), Toy::new(), &settings()).unwrap();
    let whole = outcome(&RunFolder::open(whole.path()).unwrap());
    for stop in [1, 4, 7, 9, 15, 18, 19, 35] {
        let folder = tempfile::tempdir().unwrap();
        let run = new_run(folder.path());
        let cancel = Cancel::new();
        let mut sinks: Vec<Box<dyn MetricSink>> =
            vec![Box::new(JsonLines::after(&run, 0).unwrap()), Box::new(StopAt(stop, cancel.clone()))];
        let state = fit(&run, &mut Toy::new(), &data(), &settings(), &mut sinks, None, &cancel).unwrap();
        assert_eq!((state.step, state.end), (stop, Some(End::Interrupted)));
        let steps = run.steps().unwrap();
        assert_eq!(steps.last(), Some(&stop));
        // The last ones, and the best; only the last one can be gone on from.
        assert!(steps.len() <= settings().keep + 1, "{steps:?}");
        let trained = steps.iter().filter(|&&step| run.training(step).exists());
        assert!(trained.eq([&stop]), "stopped after {stop} steps");
        assert_eq!(train(&run, Toy::new(), &settings()).unwrap().end, Some(End::Complete));
        assert_eq!(outcome(&run), whole, "stopped after {stop} steps");
    }
}

/// Everything that must be equal: weights, where training stands, and metrics without times.
fn outcome(run: &RunFolder) -> (Vec<u8>, State, Vec<serde_json::Value>) {
    let step = *run.steps().unwrap().last().unwrap();
    let checkpoint: Checkpoint<State> = run.checkpoint(step).unwrap();
    let text = std::fs::read_to_string(run.file("metrics.jsonl")).unwrap();
    let line = |line: &str| {
        let mut line: serde_json::Value = serde_json::from_str(line).unwrap();
        let fields = line.as_object_mut().unwrap();
        assert!(fields.remove("clips_per_s").is_some() && fields.remove("elapsed_s").is_some());
        line
    };
    (
        std::fs::read(run.checked_weights(&checkpoint).unwrap()).unwrap(),
        checkpoint.state,
        text.lines().map(line).collect(),
    )
}

fn first_loss(run: &RunFolder) -> f64 {
    outcome(run).2[0]["loss"].as_f64().unwrap()
}

fn new_run(folder: &Path) -> RunFolder {
    RunFolder::create(folder, &"toy").unwrap().0
}

#[test]
fn trains_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let run = new_run(folder.path());
    let state = train(&run, Toy::new(), &settings()).unwrap();
    assert_eq!((state.step, state.phase, state.done, state.end), (36, 1, 18, Some(End::Complete)));
    assert!(state.train[0].1 < 0.2 * first_loss(&run), "{:?}", state.train);
    assert!(state.validation.iter().map(|(name, _)| name).eq(["loss", "first", "second"]));
    let (_, _, lines) = outcome(&run);
    let steps = |part: &str| -> Vec<u64> {
        lines.iter().filter(|line| line["part"] == part).map(|line| line["step"].as_u64().unwrap()).collect()
    };
    assert_eq!(steps("train"), [4, 8, 12, 16, 18, 20, 24, 28, 32, 36]);
    assert_eq!(steps("validation"), [5, 10, 15, 18, 20, 25, 30, 35, 36]);
    // The last three, and the best.
    assert!(run.steps().unwrap().ends_with(&[30, 35, 36]));
    // Nothing is left to do.
    assert_eq!(train(&run, Toy::new(), &settings()).unwrap(), state);
}

#[test]
fn losses_that_are_no_numbers_stop_and_keep_the_last_good_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let run = new_run(folder.path());
    let broken = Toy { breaks_at: Some(13), ..Toy::new() };
    let message = train(&run, broken, &settings()).unwrap_err().to_string();
    for part in ["loss is NaN", "step 13", "step-00000010.safetensors", "learning rate"] {
        assert!(message.contains(part), "{message}");
    }
    assert_eq!(run.steps().unwrap(), [5, 10]);
    let message = train(&run, Toy { is_blind: true, ..Toy::new() }, &settings()).unwrap_err().to_string();
    for part in ["step 15", "validation's loss is NaN", "step-00000010.safetensors"] {
        assert!(message.contains(part), "{message}");
    }
    assert_eq!(run.steps().unwrap(), [5, 10]);
    assert_eq!(train(&run, Toy::new(), &settings()).unwrap().end, Some(End::Complete));
}

#[test]
fn losses_that_wait_on_a_device_are_counted_as_those_that_do_not() {
    let waits = || Toy { waiting: Some(Vec::new()), ..Toy::new() };
    let [whole, other] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    train(&new_run(whole.path()), Toy::new(), &settings()).unwrap();
    let run = new_run(other.path());
    let cancel = Cancel::new();
    let mut sinks: Vec<Box<dyn MetricSink>> =
        vec![Box::new(JsonLines::after(&run, 0).unwrap()), Box::new(StopAt(7, cancel.clone()))];
    fit(&run, &mut waits(), &data(), &settings(), &mut sinks, None, &cancel).unwrap();
    let broken = Toy { breaks_at: Some(16), ..waits() };
    let message = train(&run, broken, &settings()).unwrap_err().to_string();
    assert!(message.contains("step 16") && message.contains("step-00000015.safetensors"), "{message}");
    train(&run, waits(), &settings()).unwrap();
    assert_eq!(outcome(&run), outcome(&RunFolder::open(whole.path()).unwrap()));
}

#[test]
fn stops_early_when_validation_gets_no_better() {
    let folder = tempfile::tempdir().unwrap();
    let run = new_run(folder.path());
    let settings = FitSettings { epochs: 100, patience: 3, checkpoint_every: 0, ..settings() };
    let state = train(&run, Toy::new(), &settings).unwrap();
    assert_eq!((state.end, state.since_best), (Some(End::EarlyStop), 3));
    let (best, _) = state.best.unwrap();
    assert!(run.steps().unwrap().contains(&best) && state.step == best + 3 * 9);
    assert_eq!(train(&run, Toy::new(), &settings).unwrap(), state);
}

/// What the process that is killed does; nothing in an ordinary run of the tests.
#[test]
fn victim() {
    let Some(folder) = std::env::var_os(VICTIM) else { return };
    let run = RunFolder::open(Path::new(&folder)).unwrap();
    let _lock = run.lock().unwrap();
    let slow = Toy { pause: Duration::from_millis(20), ..Toy::new() };
    train(&run, slow, &settings()).unwrap();
}

const VICTIM: &str = "SWM_TEST_TRAINING_VICTIM";

#[test]
fn a_killed_run_goes_on_as_if_nothing_had_been() {
    let whole = tempfile::tempdir().unwrap();
    train(&new_run(whole.path()), Toy::new(), &settings()).unwrap();

    let folder = tempfile::tempdir().unwrap();
    let run = new_run(folder.path());
    for kills in 1..=3 {
        let known = run.steps().unwrap();
        let mut victim = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "train::tests::victim", "--quiet"])
            .env(VICTIM, folder.path())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let patience = Instant::now();
        while run.steps().unwrap().last() <= known.last() {
            assert!(patience.elapsed() < Duration::from_secs(60), "no checkpoint came");
            std::thread::sleep(Duration::from_millis(5));
        }
        std::thread::sleep(Duration::from_millis(15 * kills));
        victim.kill().unwrap();
        victim.wait().unwrap();
    }
    assert!(run.steps().unwrap().last() < Some(&36), "killed before the end");
    train(&run, Toy::new(), &settings()).unwrap();
    assert_eq!(outcome(&run), outcome(&RunFolder::open(whole.path()).unwrap()));
}
