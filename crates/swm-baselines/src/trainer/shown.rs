//! The progress of a training, for the report of its request.

use std::path::Path;
use std::time::Duration;

use swm_tasks::request::{Figures, Message, Progress, Report, Stage, TaskError};

use crate::error::BaselineError;
use crate::train::{MetricSink, Part, Record};

/// Shows records and steps to whoever watches.
pub(super) struct Shown {
    progress: Box<dyn Progress>,
    pace: Pace,
    /// Whether there is more than one phase, so that a loss alone does not tell what it is of.
    has_phases: bool,
    /// Steps that were counted.
    counted: u64,
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

impl Shown {
    /// Begins the stage of a training in the folder `run`, of which so many steps were done before, of all.
    pub(super) fn begin(
        report: &mut dyn Report,
        run: &Path,
        pace: Pace,
        has_phases: bool,
        [done, total]: [u64; 2],
    ) -> Result<Self, TaskError> {
        if done > 0 {
            report.info(&Message::new(format!("continues at step {done}")));
        }
        let name = run.display().to_string();
        let progress = report.begin(&Stage { name: &name, role: None, unit: "steps", total })?;
        progress.advance(done);
        Ok(Self { progress, pace, has_phases, counted: done, last: (done, Duration::ZERO) })
    }
}

impl MetricSink for Shown {
    fn record(&mut self, record: &Record) -> Result<(), BaselineError> {
        let losses: Vec<String> =
            record.values.iter().map(|(name, value)| format!("{name} {}", short(*value))).collect();
        let losses = losses.join(", ");
        let Record { part, step, total, elapsed, clips_per_s, .. } = *record;
        let since = elapsed.saturating_sub(self.last.1).as_secs_f64();
        let seconds_a_step = since / step.saturating_sub(self.last.0).max(1) as f64;
        let speed = match self.pace {
            Pace::Clips => format!("{clips_per_s:.0} clips/s"),
            Pace::EnvSteps => format!("{:.0} steps/s", 1.0 / seconds_a_step.max(1e-9)),
        };
        let is_train = part == Part::Train;
        if is_train {
            self.last = (step, elapsed);
        }
        // Steps before the first update say nothing about those after it.
        let is_timed = is_train && clips_per_s > 0.0;
        let left = seconds_a_step * total.saturating_sub(step) as f64;
        let left = Duration::try_from_secs_f64(left).unwrap_or(Duration::MAX);
        let phase = if self.has_phases { format!(" ({})", record.phase) } else { String::new() };
        let timed = if is_timed { format!("; {speed}") } else { String::new() };
        let line = format!("{step} of {total}{phase}: {} {losses}{timed}", part.name());
        let brief = || format!("loss {}, {speed}", short(record.value("loss").unwrap_or(f64::NAN)));
        let (brief, left) = (is_train.then(brief), is_timed.then_some(left));
        self.progress.figures(&Figures { line, brief, left });
        Ok(())
    }

    fn step(&mut self, step: u64, _total: u64) {
        self.progress.advance(step.saturating_sub(self.counted));
        self.counted = step;
    }
}

/// A number of parameters.
pub(super) fn many(count: usize) -> String {
    match count {
        few @ ..1_000_000 => few.to_string(),
        many => format!("{:.2} million", many as f64 / 1e6),
    }
}

/// A loss or another value, to four digits or so.
pub fn short(value: f64) -> String {
    match value.abs() {
        size if size.fract() == 0.0 && size < 1e6 => format!("{value:.0}"),
        size if size < 1e-3 => format!("{value:.1e}"),
        size if size < 10.0 => format!("{value:.4}"),
        size if size < 1e3 => format!("{value:.2}"),
        size if size < 1e6 => format!("{value:.0}"),
        _ => format!("{value:.3e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_digits() {
        let shown = [0.0, 5e-5, 0.0123, -1.5, 15.5682, 200.0, 12345.6, 2e9, f64::NAN].map(short);
        assert_eq!(shown, ["0", "5.0e-5", "0.0123", "-1.5000", "15.57", "200", "12346", "2.000e9", "NaN"]);
    }
}
