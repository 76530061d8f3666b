//! The metrics of training, and where that goes: sinks that each get every record. How a terminal shows it is the
//! command's business.

use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, Write as _};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};

use super::events::EventWriter;
use super::folder::RunFolder;
use crate::error::BaselineError;

/// Which clips a record is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Training clips.
    Train,
    /// Those of the episodes that are kept apart.
    Validation,
    /// No clips: what a [`Diagnosis`](super::Diagnosis) measures.
    Quality,
    /// No clips: episodes of an agent that learns online.
    Evaluation,
}

impl Part {
    /// Its name, as it stands before the names of values.
    pub fn name(self) -> &'static str {
        match self {
            Part::Train => "train",
            Part::Validation => "validation",
            Part::Quality => "quality",
            Part::Evaluation => "evaluation",
        }
    }
}

/// What there is to say after some steps.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Record {
    /// What it is about.
    pub part: Part,
    /// The phase of the training, by its name.
    pub phase: String,
    /// Optimizer steps done, in all phases.
    pub step: u64,
    /// Steps that the run will have.
    pub total: u64,
    /// Passes over the training clips that are complete, in this phase.
    pub epoch: u64,
    /// Means since the last record, by name: `loss`, its terms, `lr`, `gradient_norm`.
    pub values: Vec<(String, f64)>,
    /// Clips per second since the last record, as long as this process trains.
    pub clips_per_s: f64,
    /// Since this process began to train.
    pub elapsed: Duration,
}

impl Record {
    /// The value of this name.
    pub fn value(&self, name: &str) -> Option<f64> {
        self.values.iter().find(|(known, _)| known == name).map(|&(_, value)| value)
    }
}

/// Takes records.
pub trait MetricSink {
    /// Takes one.
    ///
    /// # Errors
    ///
    /// Any ends the training.
    fn record(&mut self, record: &Record) -> Result<(), BaselineError>;

    /// Called after every optimizer step: what a progress bar needs.
    fn step(&mut self, _step: u64, _total: u64) {}

    /// Called before a checkpoint is written: what was taken must be where a kill cannot get it.
    ///
    /// # Errors
    ///
    /// As of [`MetricSink::record`].
    fn flush(&mut self) -> Result<(), BaselineError> {
        Ok(())
    }
}

/// The file `metrics.jsonl`: a JSON object per record, in the order of steps. Beside `clips_per_s` and `elapsed_s`, a
/// function of the run's settings alone.
pub struct JsonLines {
    run: RunFolder,
    out: BufWriter<File>,
}

const METRICS: &str = "metrics.jsonl";

impl JsonLines {
    /// Goes on with the file, from which lines about later steps than `step` are removed.
    ///
    /// # Errors
    ///
    /// The file cannot be read or written.
    pub fn after(run: &RunFolder, step: u64) -> Result<Self, BaselineError> {
        let path = run.file(METRICS);
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(run.io("read", &path, error)),
        };
        // A kill leaves at most one line that is not whole, the last.
        let kept = |line: &&str| step_of(line).is_some_and(|at| at <= step);
        let lines: String = text.lines().filter(kept).flat_map(|line| [line, "\n"]).collect();
        run.replace(&path, lines.as_bytes())?;
        let file =
            OpenOptions::new().append(true).open(&path).map_err(|error| run.io("open", &path, error))?;
        Ok(Self { run: run.clone(), out: BufWriter::new(file) })
    }

    fn checked(&self, written: std::io::Result<()>) -> Result<(), BaselineError> {
        written.map_err(|error| self.run.io("write", &self.run.file(METRICS), error))
    }
}

fn step_of(line: &str) -> Option<u64> {
    serde_json::from_str::<Json>(line).ok()?.get("step")?.as_u64()
}

impl MetricSink for JsonLines {
    fn record(&mut self, record: &Record) -> Result<(), BaselineError> {
        let mut line = Map::new();
        line.insert("step".to_owned(), record.step.into());
        line.insert("epoch".to_owned(), record.epoch.into());
        line.insert("part".to_owned(), record.part.name().into());
        line.insert("phase".to_owned(), record.phase.clone().into());
        for (name, value) in &record.values {
            line.insert(name.clone(), Json::from(*value));
        }
        line.insert("clips_per_s".to_owned(), Json::from(record.clips_per_s));
        line.insert("elapsed_s".to_owned(), Json::from(record.elapsed.as_secs_f64()));
        // Whole and at once, as others read the file while it grows.
        let written = writeln!(self.out, "{}", Json::Object(line)).and_then(|()| self.out.flush());
        self.checked(written)
    }

    fn flush(&mut self) -> Result<(), BaselineError> {
        let written = self.out.flush();
        self.checked(written)
    }
}

/// An event file for TensorBoard, made at the first record: a run that is resumed at its end gets none.
pub struct TensorBoard {
    run: RunFolder,
    resumed: Option<u64>,
    events: Option<EventWriter>,
}

impl TensorBoard {
    /// `resumed`: the step that is gone on after.
    pub fn new(run: &RunFolder, resumed: Option<u64>) -> Self {
        Self { run: run.clone(), resumed, events: None }
    }
}

impl MetricSink for TensorBoard {
    fn record(&mut self, record: &Record) -> Result<(), BaselineError> {
        let speed = ("clips_per_s".to_owned(), record.clips_per_s);
        let tag = |(name, value): &(String, f64)| {
            (format!("{}/{}/{name}", record.part.name(), record.phase), *value)
        };
        let tags: Vec<(String, f64)> = record.values.iter().chain([&speed]).map(tag).collect();
        let points = tags.iter().map(|(tag, value)| (tag.as_str(), *value));
        let events = match &mut self.events {
            Some(events) => events,
            none => none.insert(
                EventWriter::create(self.run.path(), self.resumed)
                    .map_err(|error| self.run.io("write an event file in", self.run.path(), error))?,
            ),
        };
        events.scalars(record.step, points).map_err(|error| self.run.io("write", events.path(), error))
    }

    fn flush(&mut self) -> Result<(), BaselineError> {
        let Some(events) = &mut self.events else { return Ok(()) };
        events.flush().map_err(|error| self.run.io("write", events.path(), error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(step: u64) -> Record {
        let values = vec![("loss".to_owned(), 1.0 / step as f64)];
        let (total, epoch, clips_per_s) = (9, 0, 3.0);
        let (part, phase, elapsed) = (Part::Train, "world".to_owned(), Duration::ZERO);
        Record { part, phase, step, total, epoch, values, clips_per_s, elapsed }
    }

    #[test]
    fn lines_after_the_checkpoint_are_written_anew() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::create(folder.path(), &()).unwrap().0;
        let mut lines = JsonLines::after(&run, 0).unwrap();
        for step in 1..=4 {
            lines.record(&record(step)).unwrap();
        }
        lines.flush().unwrap();
        let whole = fs::read_to_string(run.file(METRICS)).unwrap();
        fs::write(run.file(METRICS), &whole[..whole.len() - 7]).unwrap();

        let mut lines = JsonLines::after(&run, 2).unwrap();
        for step in 3..=4 {
            lines.record(&record(step)).unwrap();
        }
        lines.flush().unwrap();
        assert_eq!(fs::read_to_string(run.file(METRICS)).unwrap(), whole);
        let first: Json = serde_json::from_str(whole.lines().next().unwrap()).unwrap();
        assert_eq!(
            (&first["step"], &first["loss"], &first["part"]),
            (&1.into(), &1.0.into(), &"train".into())
        );
    }
}
