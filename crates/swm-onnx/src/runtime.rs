//! Where ONNX Runtime is, and one environment of it per process.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, OnceLock, PoisonError};

use ort::environment::Environment;
use ort::session::Session;

use crate::error::OnnxError;

/// The variable that names the library.
pub const ORT_DYLIB_PATH: &str = "ORT_DYLIB_PATH";

/// Prints the library of the Python package.
const ASK: &str = "\
import glob, os, onnxruntime
here = os.path.join(os.path.dirname(onnxruntime.__file__), 'capi')
names = ['libonnxruntime.so*', 'libonnxruntime*.dylib', 'onnxruntime.dll']
print(next(path for name in names for path in sorted(glob.glob(os.path.join(here, name)))))";

static PYTHON: OnceLock<PathBuf> = OnceLock::new();

/// Sets the interpreter of this process, whose package `onnxruntime` is taken before that of `python3`. The first call counts.
pub fn set_python(interpreter: impl Into<PathBuf>) {
    PYTHON.get_or_init(|| interpreter.into());
}

/// The library: what [`ORT_DYLIB_PATH`] names, else that of the Python package `onnxruntime`, if the interpreter that [`set_python`]
/// named, `python3` or `python` has it.
///
/// # Errors
///
/// [`OnnxError::NoRuntime`].
pub fn find_library() -> Result<PathBuf, OnnxError> {
    if let Some(path) = std::env::var_os(ORT_DYLIB_PATH) {
        return Ok(PathBuf::from(path));
    }
    let known = ["python3", "python"].map(PathBuf::from);
    for python in PYTHON.get().into_iter().chain(&known) {
        let Ok(output) = Command::new(python).args(["-c", ASK]).output() else { continue };
        let path = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        if output.status.success() && !path.is_empty() {
            return Ok(path.into());
        }
    }
    let python = PYTHON.get().map_or("python3".to_owned(), |python| python.display().to_string());
    Err(OnnxError::NoRuntime { reason: format!("{python} has no package `onnxruntime`") })
}

/// Loads a model. It runs on one thread: candidates are independent, and bits must not depend on threads.
pub(crate) fn session(path: &Path) -> Result<Session, OnnxError> {
    let failed = |error: ort::Error| OnnxError::unreadable(path, &error);
    let environment = environment()?;
    let builder = Session::builder(&environment).map_err(failed)?;
    let builder = builder.with_intra_threads(1).map_err(|error| failed(error.into()))?;
    builder
        .with_inter_threads(1)
        .map_err(|error| failed(error.into()))?
        .commit_from_file(path)
        .map_err(failed)
}

/// The environment, made at the first call that finds the library.
fn environment() -> Result<Environment, OnnxError> {
    static KNOWN: OnceLock<Mutex<Option<Environment>>> = OnceLock::new();
    let mut known = KNOWN.get_or_init(Mutex::default).lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(environment) = &*known {
        return Ok(environment.clone());
    }
    let library = find_library()?;
    let reason = |error: &dyn std::fmt::Display| format!("{}: {error}", library.display());
    let builder =
        ort::init_from(&library).map_err(|error| OnnxError::NoRuntime { reason: reason(&error) })?;
    let environment =
        builder.with_name("swm").build().map_err(|error| OnnxError::NoRuntime { reason: reason(&error) })?;
    *known = Some(environment.clone());
    Ok(environment)
}
