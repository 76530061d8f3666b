//! Ctrl-C and SIGTERM: the running command stops at its next step, says in one line what is safe and how to continue, and
//! ends with exit status 130. What does not stop by itself soon is ended: all files survive a kill.

use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Duration;

use swm_core::Cancel;

/// The exit status of an interrupted command, as shells give it for SIGINT.
pub(super) const STATUS: u8 = 130;
/// How long a command may take to stop by itself.
const GRACE: Duration = Duration::from_millis(200);

type Advice = Box<dyn Fn() -> String + Send>;

static CANCEL: OnceLock<Cancel> = OnceLock::new();
static ADVICE: Mutex<Option<Advice>> = Mutex::new(None);

/// From now on a signal sets the returned flag. `advice` says what is safe and how to continue.
pub(super) fn watch(advice: impl Fn() -> String + Send + 'static) -> &'static Cancel {
    *ADVICE.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(advice));
    CANCEL.get_or_init(|| {
        let cancel = Cancel::new();
        let flag = cancel.clone();
        let handler = move || {
            flag.cancel();
            std::thread::sleep(GRACE);
            say();
            std::process::exit(i32::from(STATUS));
        };
        // A program that embeds this command and handles signals itself keeps its handler.
        let _ = ctrlc::set_handler(handler);
        cancel
    })
}

/// Says, once, what is safe and how to continue.
pub(super) fn say() {
    let mut advice = ADVICE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(advice) = advice.take() {
        eprintln!("interrupted: {}", advice());
    }
}
