//! The training loop: phases one after another, batches in order, steps, records, validation, checkpoints, early stop, and
//! going on after a kill exactly where the last checkpoint stood. What is learnt, and how, is behind [`Baseline`].

use std::time::Instant;

use serde::{Deserialize, Serialize};
use swm_core::Cancel;
use swm_data::BatchOptions;
use swm_data::loader::Position;

use super::checkpoints::Checkpoint;
use super::clips::ClipFeed;
use super::data::{PhaseClips, TrainData};
use super::diagnosis::Diagnosis;
use super::folder::RunFolder;
use super::latents;
use super::metrics::{MetricSink, Part, Record};
use super::settings::FitSettings;
use super::sums::{Sums, values};
use crate::baseline::{Baseline, Losses, Step};
use crate::error::BaselineError;

/// Where training stands: what a checkpoint holds in addition to weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// The phase of the baseline's training.
    pub phase: usize,
    /// Optimizer steps done, in all phases.
    pub step: u64,
    /// Of these, in this phase.
    pub done: u64,
    /// The next batch; `None` at the beginning of a phase.
    pub position: Option<Position>,
    /// Sums of values since the last record.
    sums: Sums,
    /// The last record's means, by name.
    pub train: Vec<(String, f64)>,
    /// Of the last validation; empty before it.
    pub validation: Vec<(String, f64)>,
    /// The step and loss of the phase's best validation.
    pub best: Option<(u64, f64)>,
    /// Validations since then.
    pub since_best: u64,
    /// Whether and why training is over.
    pub end: Option<End>,
}

/// Why training ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum End {
    /// All steps are done.
    Complete,
    /// Validation did not get better any more.
    EarlyStop,
    /// Somebody asked to stop; it goes on from here.
    Interrupted,
}

/// Trains `model` in `run`, measured by `diagnosis` on its way if there is one, from the last checkpoint if there is one, and returns where it ended.
/// Once `cancel` is set, the step at work is the last one, and a checkpoint follows it.
///
/// # Errors
///
/// Settings that [`FitSettings::check`] refuses, a loss that is not finite, or whatever reading clips and writing
/// checkpoints may meet.
pub fn fit(
    run: &RunFolder,
    model: &mut dyn Baseline,
    data: &TrainData,
    settings: &FitSettings,
    sinks: &mut [Box<dyn MetricSink + '_>],
    diagnosis: Option<&mut (dyn Diagnosis + '_)>,
    cancel: &Cancel,
) -> Result<State, BaselineError> {
    settings.check()?;
    let settings = &FitSettings { batch: batch_of(settings, model), ..settings.clone() };
    let totals = totals(data, settings, model);
    model.set_precision(settings.precision);
    let state = begin(run, model, totals.len())?;
    let encoded = latents::encoded(data, model)?;
    let data = encoded.as_ref().unwrap_or(data);
    let pace = Pace { started: Instant::now(), last: Instant::now(), clips: 0 };
    let mut fit = Fit { run, model, data, settings, sinks, diagnosis, cancel, totals, state, pace };
    fit.state.end = None;
    fit.go_on_or_end();
    while fit.state.end.is_none() {
        fit.phase()?;
    }
    Ok(fit.state)
}

/// Clips of a step.
fn batch_of(settings: &FitSettings, model: &dyn Baseline) -> usize {
    if settings.batch == 0 { model.input_spec().batch } else { settings.batch }
}

/// Optimizer steps of each phase.
pub(super) fn totals(data: &TrainData, settings: &FitSettings, model: &dyn Baseline) -> Vec<u64> {
    let batch = batch_of(settings, model);
    data.phases.iter().map(|clips| settings.total(clips.steps_per_epoch(batch))).collect()
}

/// Where the run stands: at its last checkpoint, which the model takes up, or at its beginning.
fn begin(run: &RunFolder, model: &mut dyn Baseline, phases: usize) -> Result<State, BaselineError> {
    let Some(&step) = run.steps()?.last() else { return Ok(State::new()) };
    let checkpoint: Checkpoint<State> = run.checkpoint(step)?;
    let State { phase, step: stood, done, .. } = checkpoint.state;
    if stood != step || done > step || phase >= phases {
        return Err(run.wrong(format!(
            "the checkpoint at step {step} is damaged: it describes step {stood} in phase {phase} of {phases}; remove it, or make a new run"
        )));
    }
    model.load_weights(&run.checked_weights(&checkpoint)?)?;
    model.load_training(&run.checked_training(&checkpoint)?)?;
    Ok(checkpoint.state)
}

impl State {
    /// That of weights that were trained elsewhere.
    pub fn imported() -> Self {
        Self { end: Some(End::Complete), ..Self::new() }
    }

    fn new() -> Self {
        Self {
            phase: 0,
            step: 0,
            done: 0,
            position: None,
            sums: Sums::default(),
            train: Vec::new(),
            validation: Vec::new(),
            best: None,
            since_best: 0,
            end: None,
        }
    }
}

/// A training at work.
struct Fit<'a, 's, 'd> {
    run: &'a RunFolder,
    model: &'a mut dyn Baseline,
    data: &'a TrainData,
    settings: &'a FitSettings,
    sinks: &'a mut [Box<dyn MetricSink + 's>],
    diagnosis: Option<&'a mut (dyn Diagnosis + 'd)>,
    cancel: &'a Cancel,
    /// Steps of each phase.
    totals: Vec<u64>,
    state: State,
    pace: Pace,
}

impl Fit<'_, '_, '_> {
    /// Trains until the phase or the whole training is over.
    fn phase(&mut self) -> Result<(), BaselineError> {
        let phase = self.state.phase;
        let (data, settings) = (self.data, self.settings);
        let clips = &data.phases[phase];
        let options = BatchOptions::default()
            .size(settings.batch.min(clips.train.len()))
            .shuffle(Some(settings.seed))
            .drop_last(true);
        let mut batches = match &self.state.position {
            None => clips.train.batches(&options)?,
            Some(position) => clips.train.batches_from(&options, position)?,
        };
        let mut batch = batches.new_batch();
        let mut feed = ClipFeed::new(&data.config.scales);
        while self.state.end.is_none() && self.state.phase == phase {
            let epoch_ended = !batches.next_batch(&mut batch)?;
            self.state.position = Some(batches.position());
            let mut look = epoch_ended && settings.checkpoint_every == 0;
            if !epoch_ended {
                let (state, total) = (&self.state, self.totals[phase]);
                let at = Step { seed: settings.seed, phase, step: state.done, total };
                let losses = self.model.start_step(&feed.clips(&batch)?, &at);
                self.took(losses, batch.rows())?;
                self.diagnose(clips)?;
                look |= settings.checkpoint_every > 0
                    && self.state.step.is_multiple_of(settings.checkpoint_every);
            }
            let looks = look || self.state.done >= self.totals[phase];
            if looks {
                self.look(clips)?;
            }
            if self.cancel.is_cancelled() && self.state.end.is_none() {
                if !looks {
                    self.save()?;
                }
                self.state.end = Some(End::Interrupted);
            }
        }
        Ok(())
    }

    /// After a step, whose losses may still wait on the device.
    fn took(
        &mut self,
        losses: Result<Option<Losses>, BaselineError>,
        clips: usize,
    ) -> Result<(), BaselineError> {
        let known = losses.map(|losses| losses.into_iter().collect());
        self.count_losses(known)?;
        let state = &mut self.state;
        state.step += 1;
        state.done += 1;
        self.pace.clips += clips as u64;
        let total = self.totals.iter().sum();
        self.sinks.iter_mut().for_each(|sink| sink.step(state.step, total));
        if state.step.is_multiple_of(self.settings.log_every) || state.done == self.totals[state.phase] {
            self.settle()?;
            let state = &mut self.state;
            state.train = state.sums.take();
            self.tell(Part::Train, self.state.train.clone())?;
            self.pace.lap();
        }
        Ok(())
    }

    /// Measures the model, if it is time to.
    fn diagnose(&mut self, clips: &PhaseClips) -> Result<(), BaselineError> {
        let (step, every) = (self.state.step, self.settings.quality_every);
        let is_time = step.is_multiple_of(every) || step == self.totals.iter().sum::<u64>();
        if every == 0 || self.diagnosis.is_none() || !is_time {
            return Ok(());
        }
        self.estimate_statistics(clips)?;
        let Self { model, data, diagnosis, .. } = self;
        let Some(diagnosis) = diagnosis else { return Ok(()) };
        let values = diagnosis.measure(&**model, &data.config);
        let values = values.map_err(|source| BaselineError::Diagnosis { step, source })?;
        self.tell(Part::Quality, values)?;
        self.pace.lap();
        Ok(())
    }

    /// Validates, decides whether to go on, and writes a checkpoint.
    fn look(&mut self, clips: &PhaseClips) -> Result<(), BaselineError> {
        // Weights of a step whose loss is not finite are not to be looked at.
        self.settle()?;
        self.estimate_statistics(clips)?;
        if clips.validation.is_some() {
            self.state.validation = self.validate(clips)?;
            // Weights with a NaN loss are no good checkpoint.
            if let Some((name, value)) = self.state.validation.iter().find(|(_, value)| !value.is_finite()) {
                let (step, name, value) = (self.state.step, name.clone(), *value);
                return Err(self.stopped(BaselineError::NotFiniteValidation { step, name, value })?);
            }
            self.tell(Part::Validation, self.state.validation.clone())?;
            let state = &mut self.state;
            let loss = state.validation.first().map_or(f64::NAN, |&(_, loss)| loss);
            if state.best.is_none_or(|(_, best)| loss < best) {
                (state.best, state.since_best) = (Some((state.step, loss)), 0);
            } else {
                state.since_best += 1;
            }
        }
        self.go_on_or_end();
        self.save()?;
        self.pace.lap();
        Ok(())
    }

    /// Writes a checkpoint, and removes those that are no longer kept.
    fn save(&mut self) -> Result<(), BaselineError> {
        self.settle()?;
        for sink in &mut *self.sinks {
            sink.flush()?;
        }
        let Self { run, model, state, .. } = self;
        let (weights, training) = (&**model, &**model);
        run.write_checkpoint(
            state.step,
            |path| weights.save_weights(path),
            |path| training.save_training(path),
            state,
        )?;
        run.tidy(self.settings.keep, state.best.map(|(step, _)| step))
    }

    /// Whether the phase is over; then the next begins, or training ends.
    fn go_on_or_end(&mut self) {
        let Self { state, totals, settings, .. } = self;
        let why = if state.done >= totals[state.phase] {
            End::Complete
        } else if settings.patience > 0 && state.since_best >= settings.patience {
            End::EarlyStop
        } else {
            return;
        };
        if state.phase + 1 == totals.len() {
            state.end = Some(why);
            return;
        }
        state.phase += 1;
        (state.done, state.position) = (0, None);
        (state.best, state.since_best) = (None, 0);
    }

    /// Estimates the statistics of batch normalization anew, from the same batches every time.
    fn estimate_statistics(&mut self, clips: &PhaseClips) -> Result<(), BaselineError> {
        if self.settings.norm_batches == 0 {
            return Ok(());
        }
        let options = BatchOptions::default()
            .size(self.settings.batch.min(clips.train.len()))
            .shuffle(Some(self.settings.seed))
            .epochs(Some(1))
            .drop_last(true);
        let mut feed = ClipFeed::new(&self.data.config.scales);
        let mut batches = clips.train.batches(&options)?;
        let mut batch = batches.new_batch();
        for before in 0..self.settings.norm_batches as u64 {
            if !batches.next_batch(&mut batch)? {
                break;
            }
            self.model.estimate_statistics(&feed.clips(&batch)?, self.state.phase, before)?;
        }
        Ok(())
    }

    /// Means over the validation clips, each clip counting once.
    fn validate(&self, clips: &PhaseClips) -> Result<Vec<(String, f64)>, BaselineError> {
        let Some(loader) = &clips.validation else { return Ok(Vec::new()) };
        let size = self.settings.batch.min(loader.len());
        let options = BatchOptions::default().size(size).shuffle(Some(0)).epochs(Some(1));
        let most = match self.settings.validation_clips {
            0 => usize::MAX,
            most => most,
        };
        let (mut sums, mut seen) = (Sums::default(), 0);
        let mut feed = ClipFeed::new(&self.data.config.scales);
        let mut batches = loader.batches(&options)?;
        let mut batch = batches.new_batch();
        while seen < most && batches.next_batch(&mut batch)? {
            let losses = self.model.validate(&feed.clips(&batch)?, self.state.phase)?;
            sums.add(&values(&losses), batch.rows() as f64);
            seen += batch.rows();
        }
        Ok(sums.take())
    }

    /// Counts the losses that wait on the device.
    fn settle(&mut self) -> Result<(), BaselineError> {
        let losses = self.model.take_losses();
        self.count_losses(losses)
    }

    /// Adds the losses of steps to the sums; one that is not finite ends the training with an error.
    fn count_losses(&mut self, losses: Result<Vec<Losses>, BaselineError>) -> Result<(), BaselineError> {
        let losses = match losses {
            Ok(losses) => losses,
            Err(error @ BaselineError::NotFinite { .. }) => return Err(self.stopped(error)?),
            Err(error) => return Err(error),
        };
        for losses in losses {
            if let Some(&(_, value)) = losses.parts.iter().find(|(_, value)| !value.is_finite()) {
                let step = self.state.step;
                return Err(self.stopped(BaselineError::NotFinite { step, value })?);
            }
            self.state.sums.add(&values(&losses), 1.0);
        }
        Ok(())
    }

    /// Why training ends here, and what is left of it.
    fn stopped(&self, source: BaselineError) -> Result<BaselineError, BaselineError> {
        let kept = self.run.steps()?.last().map(|&kept| self.run.weights(kept));
        Ok(BaselineError::Stopped { kept, source: Box::new(source) })
    }

    fn tell(&mut self, part: Part, values: Vec<(String, f64)>) -> Result<(), BaselineError> {
        let state = &self.state;
        let record = Record {
            part,
            phase: self.model.phases()[state.phase].name.to_owned(),
            step: state.step,
            total: self.totals.iter().sum(),
            epoch: state.position.as_ref().map_or(0, |position| position.epoch),
            values,
            clips_per_s: self.pace.clips as f64 / self.pace.last.elapsed().as_secs_f64().max(1e-9),
            elapsed: self.pace.started.elapsed(),
        };
        self.sinks.iter_mut().try_for_each(|sink| sink.record(&record))
    }
}

/// How fast it goes.
struct Pace {
    started: Instant,
    last: Instant,
    clips: u64,
}

impl Pace {
    /// Validations and checkpoints do not count.
    fn lap(&mut self) {
        (self.last, self.clips) = (Instant::now(), 0);
    }
}
