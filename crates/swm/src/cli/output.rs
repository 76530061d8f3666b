//! What a command prints: JSON or tables to stdout, progress and notes to stderr, failures in one readable block.

use std::fmt;
use std::io::IsTerminal as _;
use std::path::Path;
use std::time::Duration;

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use swm_core::error::{BatchError, BoxError};
use swm_core::{EnvError, PolicyError, UnknownName, WorldError};
use swm_data::DataError;
use swm_files::WriterLock;
use swm_tasks::request::TaskError;

use super::program_name;
pub(super) use super::streams::{print, print_of_clap, print_to_stderr};
pub(crate) use super::table::table;
use super::words::Options;
use crate::jobs::JobError;

/// A command that did not succeed.
#[derive(Debug)]
pub(crate) struct Failure {
    source: BoxError,
    /// The request is wrong, rather than its execution.
    usage: bool,
}

impl Failure {
    /// Whether the command was asked to stop.
    pub(crate) fn is_cancelled(&self) -> bool {
        matches!(self.source.downcast_ref(), Some(WorldError::Cancelled))
    }

    /// Whether the printed result already gives the reason.
    pub(super) fn is_reported(&self) -> bool {
        self.source.is::<AlreadyReported>()
    }

    pub(crate) fn exit_code(&self) -> u8 {
        match self.usage {
            _ if self.source.is::<Postponed>() => 75,
            true => 2,
            false => 1,
        }
    }

    /// Why, without its causes.
    pub(super) fn reason(&self) -> String {
        self.source.to_string()
    }

    /// Why, for who is no person at a terminal.
    pub(super) fn into_source(self) -> BoxError {
        self.source
    }

    /// Whether another process is at it.
    pub(super) fn is_busy(&self) -> bool {
        matches!(self.source.downcast_ref(), Some(DataError::Busy { .. }))
    }

    /// Whether the file system failed in a way that may pass.
    pub(super) fn is_passing(&self) -> bool {
        let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(self.source.as_ref());
        while let Some(error) = cause {
            if let Some(error) = error.downcast_ref::<std::io::Error>() {
                use std::io::ErrorKind::{
                    AlreadyExists, NotFound, PermissionDenied, QuotaExceeded, StorageFull,
                };
                let stays = [AlreadyExists, NotFound, PermissionDenied, QuotaExceeded, StorageFull];
                return !self.usage && !stays.contains(&error.kind());
            }
            cause = error.source();
        }
        false
    }
}

/// What is left is to be done later, for this reason: the same command continues.
#[derive(Debug, thiserror::Error)]
#[error("{0}; start the task again to continue")]
pub(super) struct Postponed(pub(super) String);

/// A command completed with exit status 1, and the result that it printed gives the reason.
#[derive(Debug, thiserror::Error)]
#[error("the result says what was found")]
pub(super) struct AlreadyReported;

/// A wrong request.
pub(crate) fn usage(reason: impl Into<BoxError>) -> Failure {
    Failure { source: reason.into(), usage: true }
}

impl<E: Into<BoxError>> From<E> for Failure {
    fn from(error: E) -> Self {
        let source: BoxError = error.into();
        let source = match source.downcast::<JobError>().map(|error| *error) {
            Ok(JobError::Task(error)) => error.into(),
            Ok(error) => error.into(),
            Err(source) => source,
        };
        let source = match TaskError::from(source) {
            TaskError::Request(message) => return usage(message.in_words(&Options)),
            error => error.into_source(),
        };
        let usage = is_usage(source.as_ref()) || is_denied(source.as_ref());
        // A wrong request is wrong for every environment: the first that met it says nothing.
        let source = match source.downcast::<WorldError>().map(|error| *error) {
            Ok(WorldError::Env { source, .. }) if usage => source.into(),
            Ok(error) => error.into(),
            Err(source) => source,
        };
        Self { source, usage }
    }
}

/// Errors that say that what was asked for does not exist or is not allowed.
fn is_usage(error: &(dyn std::error::Error + 'static)) -> bool {
    if let Some(error) = error.downcast_ref::<WorldError>() {
        return match error {
            WorldError::Option { .. } => true,
            WorldError::Make(source) | WorldError::Env { source, .. } => is_usage(source),
            WorldError::Policy(source) => is_usage(source),
            _ => false,
        };
    }
    if let Some(error) = error.downcast_ref::<PolicyError>() {
        return match error {
            PolicyError::Argument { .. } | PolicyError::Unsupported { .. } => true,
            PolicyError::Other(source) => is_usage(source.as_ref()),
            _ => false,
        };
    }
    if let Some(error) = error.downcast_ref::<DataError>() {
        return matches!(
            error,
            DataError::UnknownFormat { .. } | DataError::Option { .. } | DataError::Loader { .. }
        ) || std::error::Error::source(error).is_some_and(is_usage);
    }
    let wrong_env = |e: &EnvError| {
        matches!(e, EnvError::Setting { .. } | EnvError::Reset { .. } | EnvError::Constraint { .. })
    };
    let unknown_field = |e: &BatchError| matches!(e, BatchError::UnknownField { .. });
    error.downcast_ref::<EnvError>().is_some_and(wrong_env)
        || error.downcast_ref::<BatchError>().is_some_and(unknown_field)
        || error.is::<UnknownName>()
}

/// How texts of errors end that the system refused: for lack of permission, or on a file system that is read-only.
const DENIED: &[&str] =
    if cfg!(windows) { &["(os error 5)"] } else { &["(os error 1)", "(os error 13)", "(os error 30)"] };

/// Whether the system does not let this process read or write a file: somewhere among the causes, or in the text that a cause became.
fn is_denied(error: &(dyn std::error::Error + 'static)) -> bool {
    use std::io::ErrorKind::{PermissionDenied, ReadOnlyFilesystem};
    let is_kind = error
        .downcast_ref::<std::io::Error>()
        .is_some_and(|error| matches!(error.kind(), PermissionDenied | ReadOnlyFilesystem));
    let text = error.to_string();
    is_kind || DENIED.iter().any(|code| text.contains(code)) || error.source().is_some_and(is_denied)
}

/// `error: …`, then each cause that says more.
impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut said = format!("error: {}", self.source);
        let mut shown = self.source.to_string();
        let mut cause = self.source.source();
        while let Some(error) = cause {
            let text = error.to_string();
            if !shown.contains(&text) {
                said += &format!("\n  because: {text}");
                shown = text;
            }
            cause = error.source();
        }
        f.write_str(&program_name::with_name(&said))
    }
}

/// Where and how results go.
#[derive(Clone)]
pub(crate) struct Output {
    json: bool,
    quiet: bool,
}

impl Output {
    pub(crate) fn new(json: bool, quiet: bool) -> Self {
        Self { json, quiet }
    }

    /// Prints the result: `json` if asked for, else `text`.
    pub(crate) fn result(
        &self,
        json: &impl serde::Serialize,
        text: impl FnOnce() -> String,
    ) -> Result<(), Failure> {
        print(&if self.json {
            serde_json::to_string_pretty(json)?
        } else {
            program_name::with_name(&text()).into_owned()
        })
    }

    /// Prints a part of the result as soon as it is known; with `--json`, nothing.
    pub(super) fn line(&self, text: impl FnOnce() -> String) -> Result<(), Failure> {
        if self.json { Ok(()) } else { print(&program_name::with_name(&text())) }
    }

    /// Prints the result whose parts [`Output::line`] has printed: with `--json` alone.
    pub(super) fn json(&self, json: &impl serde::Serialize) -> Result<(), Failure> {
        if self.json { print(&serde_json::to_string_pretty(json)?) } else { Ok(()) }
    }

    /// A note for people.
    pub(crate) fn note(&self, text: impl fmt::Display) {
        if !self.quiet {
            let line = format!("{text}\n");
            print_to_stderr(&program_name::with_name(&line));
        }
    }

    /// Whether a person watches the progress.
    pub(crate) fn shows_bars(&self) -> bool {
        !self.quiet && std::io::stderr().is_terminal()
    }

    /// Whether lines tell of the progress, since no person watches it.
    pub(crate) fn shows_lines(&self) -> bool {
        !self.quiet && !self.shows_bars()
    }

    /// A progress bar of `len` units on stderr. Without a terminal, a line every ten seconds; with `--quiet`, nothing.
    pub(crate) fn bar(&self, len: u64, unit: &str) -> ProgressBar {
        let bar = self.bar_alone(len, unit);
        if self.shows_lines() {
            report(&bar, unit, REPORT_EVERY, |line| print_to_stderr(&format!("{line}\n")));
        }
        bar
    }

    /// As [`Output::bar`], where the command itself says how far it is without a terminal.
    pub(crate) fn bar_alone(&self, len: u64, unit: &str) -> ProgressBar {
        let bar = ProgressBar::new(len);
        if !self.shows_bars() {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        let template = format!("{{bar:32}} {{pos}}/{{len}} {unit} {{pace}} {{msg}}");
        let style = ProgressStyle::with_template(&template).expect("the template is constant");
        bar.set_style(style.with_key("pace", pace));
        bar.enable_steady_tick(Duration::from_millis(200));
        bar
    }
}

/// How often a line tells of progress where no bar is shown.
const REPORT_EVERY: Duration = Duration::from_secs(10);

/// Tells now and then how far `bar` is, until it is finished or gone.
fn report(bar: &ProgressBar, unit: &str, every: Duration, tell: impl Fn(String) + Send + 'static) {
    let (bar, unit) = (bar.downgrade(), unit.to_owned());
    let reporting = move || loop {
        std::thread::sleep(every);
        match bar.upgrade() {
            Some(bar) if !bar.is_finished() => tell(progress(&bar, &unit)),
            _ => return,
        }
    };
    // Without this thread the work goes on all the same.
    let _ = std::thread::Builder::new().name("progress".to_owned()).spawn(reporting);
}

/// `3 of 7 episodes, 2 successful`.
fn progress(bar: &ProgressBar, unit: &str) -> String {
    let all = bar.length().map_or(String::new(), |len| format!(" of {len}"));
    let message = bar.message();
    let comma = if message.is_empty() { "" } else { ", " };
    format!("{}{all} {unit}{comma}{message}", bar.position())
}

/// Speed and remaining time; nothing before the first unit is done, when neither is known.
fn pace(state: &ProgressState, out: &mut dyn fmt::Write) {
    let pace = state.per_sec();
    if state.pos() > 0 && pace > 0.0 {
        // A writer that fails shows no bar.
        let _ = write!(out, "{pace:.1}/s, {:#} left", HumanDuration(state.eta()));
    }
}

/// Keeps other processes from writing the file or folder `path`, which need not be there yet, until the lock is dropped.
pub(super) fn claim(path: &Path) -> Result<WriterLock, Failure> {
    match WriterLock::take(path) {
        Err(DataError::Io { source, .. }) => {
            Err(usage(format!("cannot write to the folder {}: {source}", path.display())))
        }
        taken => Ok(taken?),
    }
}

/// A difference as people write it: whole numbers as such, others by four digits or more.
pub(super) fn compact(value: f64) -> String {
    match value {
        value if value.is_infinite() => "NaN or infinite".to_owned(),
        value if value.fract() == 0.0 && value < 1e6 => format!("{value}"),
        value if (1e-3..1e6).contains(&value) => {
            let decimals = (3.0 - value.log10().floor()).max(4.0) as usize;
            format!("{value:.decimals$}")
        }
        value => format!("{value:.3e}"),
    }
}

/// `1 frame`, `2 frames`.
pub(crate) fn counted(count: impl fmt::Display, one: &str) -> String {
    let count = count.to_string();
    let plural = if count == "1" { "" } else { "s" };
    format!("{count} {one}{plural}")
}

/// Names and values below each other, both from the left: for values of any length.
pub(crate) fn key_values(rows: &[(&str, String)]) -> String {
    let width = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    rows.iter().map(|(name, value)| format!("{name:width$}  {value}\n")).collect()
}

#[cfg(test)]
mod tests {
    use swm_tasks::request::{Message, cannot};

    use super::*;

    #[test]
    fn a_place_without_permission_is_a_wrong_request() {
        let at = |kind: std::io::ErrorKind| {
            let source = std::io::Error::from(kind);
            Failure::from(DataError::io(Path::new("/locked/a.h5"), "create", source)).exit_code()
        };
        assert_eq!(at(std::io::ErrorKind::PermissionDenied), 2);
        assert_eq!(at(std::io::ErrorKind::ReadOnlyFilesystem), 2);
        assert_eq!(at(std::io::ErrorKind::StorageFull), 1);
        let text = |code: i32| {
            let error = std::io::Error::from_raw_os_error(code);
            Failure::from(format!("cannot write /locked/a.h5: {error}")).exit_code()
        };
        let codes = if cfg!(windows) { [5, 5, 112] } else { [13, 30, 28] };
        assert_eq!(codes.map(text), [2, 2, 1]);
    }

    #[test]
    fn errors_of_jobs_count_as_what_is_within() {
        let request = TaskError::from(Message::about("seed", 1, "is taken"));
        let failure = Failure::from(JobError::from(request));
        assert_eq!((failure.exit_code(), failure.reason().as_str()), (2, "--seed 1: is taken"));
        let file = |kind: std::io::ErrorKind| {
            Failure::from(JobError::from(cannot("write", Path::new("job.json"))(kind.into())))
        };
        assert_eq!(file(std::io::ErrorKind::PermissionDenied).exit_code(), 2);
        let failure = file(std::io::ErrorKind::TimedOut);
        assert!(
            failure.exit_code() == 1
                && failure.is_passing()
                && failure.reason().starts_with("cannot write job.json: ")
        );
    }

    #[test]
    fn without_a_bar_lines_tell_how_far_the_work_is() {
        let bar = ProgressBar::hidden();
        bar.set_length(7);
        bar.inc(3);
        assert_eq!(progress(&bar, "episodes"), "3 of 7 episodes");
        bar.set_message("2 successful");
        let (send, told) = std::sync::mpsc::channel();
        report(&bar, "episodes", Duration::from_millis(1), move |line| drop(send.send(line)));
        let patience = Duration::from_secs(60);
        assert_eq!(told.recv_timeout(patience).unwrap(), "3 of 7 episodes, 2 successful");
        bar.finish_and_clear();
        // Then the other end of the channel goes away, and with it the thread.
        while told.recv_timeout(patience).is_ok() {}
        assert!(told.recv_timeout(patience).is_err());
    }

    #[test]
    fn differences_are_written_as_people_do() {
        for (value, text) in [
            (19.0, "19"),
            (0.25, "0.2500"),
            (0.001_234_56, "0.001235"),
            (557.5545, "557.5545"),
            (1e-9, "1.000e-9"),
            (0.0, "0"),
            (f64::INFINITY, "NaN or infinite"),
        ] {
            assert_eq!(compact(value), text);
        }
    }

    #[test]
    fn one_is_not_many() {
        assert_eq!([counted(1, "frame"), counted(0, "frame")], ["1 frame", "0 frames"]);
    }

    #[test]
    fn keys_and_values_align() {
        assert_eq!(key_values(&[("a", "1 of 2".into()), ("long", "x".into())]), "a     1 of 2\nlong  x\n");
    }

    #[test]
    fn unknown_names_are_wrong_requests() {
        let error = swm_core::Registry::new().env("x").unwrap_err();
        assert_eq!(Failure::from(error).exit_code(), 2);
        assert_eq!(Failure::from(std::io::Error::other("disk")).exit_code(), 1);
    }
}
