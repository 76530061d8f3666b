//! The program around the library: its command line, the files it brings along, and what its environments are.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use pyo3::prelude::*;
use swm::cli::{Launcher, set_launcher};
use swm::core::{EnvEntry, PolicyEntry};
use swm::envs_mujoco::mujoco::assets;

use crate::errors::SwmError;
use crate::world::registry;

/// Runs the command `swm` with these arguments, the program's name first; gives its exit status. `launcher`: the interpreter with
/// the arguments that start this package, and the file of this module; tasks of jobs are started so.
///
/// The command handles SIGINT itself, and may end the process.
#[pyfunction]
#[pyo3(signature = (arguments, launcher=None))]
fn run_command(py: Python<'_>, arguments: Vec<OsString>, launcher: Option<(Vec<String>, PathBuf)>) -> u8 {
    if let Some((words, library)) = launcher {
        let package = concat!("stable-worldmodel-rs==", env!("CARGO_PKG_VERSION"));
        set_launcher(Launcher::new(words, library, package));
    }
    let code = py.detach(|| swm::cli::run(registry(), arguments));
    // An exit code tells no number, but it can be compared with those of all numbers.
    (0..=u8::MAX).find(|&number| ExitCode::from(number) == code).unwrap_or(1)
}

/// Says where MuJoCo's library and the folder of models are, what errors tell a user to do about a missing file, and which interpreter
/// this is: that of the package `onnxruntime`.
#[pyfunction]
#[pyo3(signature = (library=None, folder=None, fix=None, python=None))]
fn set_files(
    library: Option<PathBuf>,
    folder: Option<PathBuf>,
    fix: Option<String>,
    python: Option<PathBuf>,
) -> PyResult<()> {
    if let Some(library) = library {
        assets::set_library(library).map_err(|error| SwmError::new_err(error.to_string()))?;
    }
    if let Some(folder) = folder {
        assets::set_folder(folder);
    }
    if let Some(fix) = fix {
        assets::set_fix(fix);
    }
    if let Some(python) = python {
        swm::onnx::set_python(python);
    }
    Ok(())
}

/// Where the package looks for MuJoCo's library and for models: (library, folder), None where nothing says so; and the
/// versions of MuJoCo, dm_control, OGBench and Meta-World that it takes.
#[pyfunction]
fn files() -> (Option<PathBuf>, Option<PathBuf>, [&'static str; 4]) {
    let versions = [
        assets::MUJOCO_VERSION,
        assets::DM_CONTROL_VERSION,
        assets::OGBENCH_VERSION,
        assets::METAWORLD_VERSION,
    ];
    (assets::library_path().ok(), assets::data_folder(), versions)
}

/// All environments as JSON: id, summary, settings (name, doc, default), names of policies.
#[pyfunction]
fn environments() -> String {
    let entries: Vec<_> = registry().all::<EnvEntry>().map(environment).collect();
    serde_json::Value::from(entries).to_string()
}

fn environment(entry: &EnvEntry) -> serde_json::Value {
    let setting =
        |setting: &swm::core::Setting| serde_json::json!([setting.name, setting.doc, setting.default]);
    let policies: Vec<&str> = registry().policies(entry).map(|policy: &PolicyEntry| policy.name).collect();
    serde_json::json!({
        "id": entry.id,
        "summary": entry.summary,
        "settings": entry.settings.iter().map(setting).collect::<Vec<_>>(),
        "policies": policies,
    })
}

/// Adds this file's functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(run_command, m)?)?;
    m.add_function(wrap_pyfunction!(set_files, m)?)?;
    m.add_function(wrap_pyfunction!(files, m)?)?;
    m.add_function(wrap_pyfunction!(environments, m)?)
}
