//! The virtual environment of the interoperability tests: h5py, Pillow and PyAV as the reference uses them, and the
//! package of MCAP, pinned by version and hash.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context as _, Result};

use crate::{process, python};

/// What pip installs; a change of it makes the environment anew.
const REQUIREMENTS: &str = "tests/interop/requirements.txt";

/// Makes the environment if it is missing or outdated, and returns its Python.
pub(crate) fn python() -> Result<PathBuf> {
    let home = process::root().join(".tools/interop");
    let interpreter = home.join("bin/python");
    let stamp = home.join("requirements.txt");
    let wanted = fs::read_to_string(process::root().join(REQUIREMENTS))
        .with_context(|| format!("{REQUIREMENTS} is missing from the checkout"))?;
    if interpreter.is_file() && fs::read_to_string(&stamp).is_ok_and(|installed| installed == wanted) {
        return Ok(interpreter);
    }
    eprintln!("test: making a virtual environment with h5py, PyAV and mcap in .tools/interop");
    process::output(Command::new(python::find()?).args(["-m", "venv", "--clear"]).arg(&home)).context(
        "python3 cannot make a virtual environment; install its `venv` module (Debian: python3-venv)",
    )?;
    let mut pip = Command::new(&interpreter);
    pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--require-hashes"]);
    process::output(pip.args(["--only-binary", ":all:", "-r", REQUIREMENTS]).current_dir(process::root()))?;
    fs::write(&stamp, wanted).with_context(|| format!("cannot write {}", stamp.display()))?;
    Ok(interpreter)
}
