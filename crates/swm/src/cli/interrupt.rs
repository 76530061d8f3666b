//! Ctrl-C and SIGTERM: the running command stops at its next step, says in one line what is safe and how to continue, and
//! ends. What does not stop by itself soon is ended: recordings are ended first, and all files survive a kill.
//!
//! The exit status is 130 after Ctrl-C, as shells give it. After SIGTERM, by which schedulers stop a job, it is 75 where the same
//! command continues (`EX_TEMPFAIL` of BSD's `sysexits.h`), and else 143, as shells give it.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Duration;

use swm_core::Cancel;

use super::output::print_to_stderr;
use super::program_name;

/// How long the recordings of a command that does not stop by itself may take to end.
const RECORDINGS_END: Duration = Duration::from_secs(1);

/// How long a command may take to stop by itself, in ms.
static GRACE_MS: AtomicU64 = AtomicU64::new(200);

type Advice = Box<dyn Fn() -> String + Send>;

static CANCEL: OnceLock<Cancel> = OnceLock::new();
static ADVICE: Mutex<Option<Advice>> = Mutex::new(None);
/// Whether the same command continues what is interrupted.
static IS_RESUMABLE: AtomicBool = AtomicBool::new(false);
/// How a task of a job is continued, whatever command it runs.
static TASK: OnceLock<String> = OnceLock::new();
/// Whether SIGTERM came, and not Ctrl-C.
static IS_TERMINATED: AtomicBool = AtomicBool::new(false);

/// From now on a signal sets the returned flag. `advice` says what is safe. Nothing of it is continued.
pub(super) fn watch(advice: impl Fn() -> String + Send + 'static) -> Cancel {
    begin(false, Box::new(advice))
}

/// A command that is interrupted may take so long to save what it holds.
pub(super) fn allow(grace: Duration) {
    GRACE_MS.store(grace.as_millis() as u64, Ordering::SeqCst);
}

/// As [`watch`], for a command that continues where it stopped: `safe` says what is safe, `how` what continues it.
pub(super) fn watch_resumable(safe: impl Fn() -> String + Send + 'static, how: impl Into<String>) -> Cancel {
    let how = how.into();
    begin(true, Box::new(move || format!("{}; to continue, {}", safe(), TASK.get().unwrap_or(&how))))
}

/// From now on this process is a task of a job, which is continued by `how`, and not by repeating a command.
pub(super) fn within_task(how: String) {
    let _ = TASK.set(how);
}

/// The advice for evaluations whose finished episodes are in files of the folder `dir`.
pub(super) fn episodes_are_in(dir: &Path) -> impl Fn() -> String + Send + 'static {
    let dir = dir.display().to_string();
    move || format!("finished episodes are safe in {dir}")
}

/// The exit status of the interrupted command.
pub(super) fn status() -> u8 {
    match (IS_TERMINATED.load(Ordering::SeqCst), IS_RESUMABLE.load(Ordering::SeqCst)) {
        (false, _) => 130,
        (true, true) => 75,
        (true, false) => 143,
    }
}

/// What continues a command that finds by itself where it stopped.
pub(super) const REPEAT: &str = "repeat the command";

/// Says, once, what is safe and how to continue.
pub(super) fn say() {
    let mut advice = ADVICE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(advice) = advice.take() {
        print_to_stderr(&format!("interrupted: {}\n", program_name::with_name(&advice())));
    }
}

fn begin(is_resumable: bool, advice: Advice) -> Cancel {
    IS_RESUMABLE.store(is_resumable, Ordering::SeqCst);
    *ADVICE.lock().unwrap_or_else(PoisonError::into_inner) = Some(advice);
    let mut is_new = false;
    let cancel = CANCEL.get_or_init(|| {
        is_new = true;
        Cancel::new()
    });
    if is_new {
        let flag = cancel.clone();
        // A program that embeds this command and handles Ctrl-C itself keeps its handler.
        let _ = ctrlc::set_handler(move || stop(&flag, false));
        #[cfg(unix)]
        listen(cancel.clone());
    }
    cancel.clone()
}

/// Waits for SIGTERM on a thread. Without it the signal ends the process at once, which all files survive.
#[cfg(unix)]
fn listen(cancel: Cancel) {
    let Ok(mut signals) = signal_hook::iterator::Signals::new([signal_hook::consts::SIGTERM]) else { return };
    std::thread::spawn(move || {
        // Schedulers send some twice: the first one counts.
        if signals.forever().next().is_some() {
            stop(&cancel, true);
        }
    });
}

/// Asks the command to stop, and ends it if it does not.
fn stop(cancel: &Cancel, is_terminated: bool) {
    IS_TERMINATED.store(is_terminated, Ordering::SeqCst);
    cancel.cancel();
    std::thread::sleep(Duration::from_millis(GRACE_MS.load(Ordering::SeqCst)));
    // A policy may be amid a long step: nothing else would free the locks, and remove a dataset without an episode.
    swm_data::recording::end_all(RECORDINGS_END);
    say();
    std::process::exit(i32::from(status()));
}
