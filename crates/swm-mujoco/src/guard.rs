//! MuJoCo's error and warning handlers, the border at which an error becomes a `Result`, and warnings in words.
//!
//! `mju_error` must not return: the code behind it counts on that. So it unwinds, as MuJoCo's own Python
//! package leaves by `longjmp`. It is sound because every function is bound as `C-unwind`, the C frames in between
//! have unwind tables (the published libraries carry `.eh_frame`) and no destructors, and MuJoCo's C++ parts (parser
//! and compiler) intercept errors themselves and return them as text. Where Rust itself is built with
//! `panic = "abort"` there is no unwinding: the message is printed and the process aborts.
//!
//! What such an error leaves behind in an `mjData` (its stack pointer) is fixed by `mj_resetData`; `Simulation`
//! refuses every other use until then.

use std::cell::Cell;
use std::ffi::{CStr, c_char};
use std::io::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use super::bindings::{self as mj, Api, mjWarningStat, mjtWarning};
use crate::error::MujocoError;

/// What travels from the handler to [`guarded`].
struct Raised(String);

thread_local! {
    /// Calls to MuJoCo under way on this thread that catch what the handler throws.
    static GUARDS: Cell<usize> = const { Cell::new(0) };
}

/// Replaces the handlers, which are process-wide.
pub(super) fn install(api: &Api) {
    // SAFETY: both are pointers to variables of the library, which is never unloaded. Every call of this function
    // writes the same two values, and `Library` writes them under a lock before anything else calls MuJoCo.
    unsafe {
        *api.mju_user_error = Some(on_error);
        *api.mju_user_warning = Some(on_warning);
    }
}

/// Calls MuJoCo; an error that it raises on the way becomes an `Err`.
pub(super) fn guarded<R>(call: impl FnOnce() -> R) -> Result<R, MujocoError> {
    GUARDS.set(GUARDS.get() + 1);
    let result = catch_unwind(AssertUnwindSafe(call));
    GUARDS.set(GUARDS.get() - 1);
    result.map_err(|payload| match payload.downcast::<Raised>() {
        Ok(raised) => MujocoError::Raised(raised.0),
        // A Rust panic, which no call here should cause, is passed on unchanged.
        Err(payload) => resume_unwind(payload),
    })
}

unsafe extern "C-unwind" fn on_error(message: *const c_char) {
    // SAFETY: MuJoCo passes its own null-terminated text that lives during the call.
    let message = unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned();
    if cfg!(panic = "unwind") && GUARDS.get() > 0 {
        // No panic message is printed: this is an error on its way to its `Result`.
        resume_unwind(Box::new(Raised(message)));
    }
    // A thread of MuJoCo's own, or a program without unwinding.
    let _ = writeln!(std::io::stderr(), "MuJoCo cannot continue: {message}");
    std::process::abort();
}

/// Warnings are counted in `mjData`; the default handler would write `MUJOCO_LOG.TXT`.
unsafe extern "C-unwind" fn on_warning(_message: *const c_char) {}

/// The first kind of warning that was counted between two looks at the counters of `mjData`, in words.
pub(super) fn warned(before: &[mjWarningStat], after: &[mjWarningStat]) -> Option<String> {
    let kind = before.iter().zip(after).position(|(before, after)| after.number > before.number)?;
    Some(warning_text(kind, after[kind].lastinfo))
}

fn warning_text(kind: usize, info: i32) -> String {
    match kind as mjtWarning {
        mj::mjWARN_INERTIA => format!("the inertia matrix is nearly singular (degree of freedom {info})"),
        mj::mjWARN_CONTACTFULL => format!("no memory for more than {info} contacts"),
        mj::mjWARN_CNSTRFULL => format!("no memory for more than {info} constraints"),
        mj::mjWARN_BADQPOS => format!("a position is not finite or huge (qpos {info})"),
        mj::mjWARN_BADQVEL => format!("a velocity is not finite or huge (qvel {info})"),
        mj::mjWARN_BADQACC => format!("an acceleration is not finite or huge (qacc {info})"),
        mj::mjWARN_BADCTRL => format!("a control is not finite (ctrl {info})"),
        other => format!("warning {other} ({info})"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Library;

    #[test]
    fn an_error_of_mujoco_becomes_a_result_with_its_message() {
        let api = Library::get().unwrap().api();
        // SAFETY: the format names one text, which follows; both are null-terminated. The handler unwinds out of it.
        let result = guarded(|| unsafe { (api.mju_error)(c"arena of %s".as_ptr(), c"cheetah".as_ptr()) });
        assert_eq!(result.unwrap_err().to_string(), "MuJoCo: arena of cheetah");
        assert_eq!(GUARDS.get(), 0);
    }
}
