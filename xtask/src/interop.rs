//! The virtual environments of the interoperability tests: h5py, Pillow and PyAV as the reference uses them, the packages
//! of MCAP and Parquet; pylance in one of its own; and what builds and tests the Python package. All are pinned by version, and all but the reference by hash.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context as _, Result};

use crate::{process, python};

/// A virtual environment.
pub(crate) struct Environment {
    /// Where it lies.
    folder: &'static str,
    /// What pip installs; a change of it makes the environment anew.
    pub(crate) requirements: &'static str,
    /// What that is, in words.
    about: &'static str,
    /// How pip installs it.
    pip: &'static [&'static str],
}

/// Each package by its version and hash, as it was built.
const HASHED: &[&str] = &["--require-hashes", "--only-binary", ":all:"];
/// Each package by its version, and no other.
const LISTED: &[&str] = &["--no-deps"];

/// What reads and writes the formats that are built by default.
pub(crate) const FORMATS: Environment = Environment {
    folder: ".tools/interop",
    requirements: "tests/interop/requirements.txt",
    about: "h5py, PyAV, mcap and pyarrow",
    pip: HASHED,
};

/// What reads and writes Lance tables.
pub(crate) const LANCE: Environment = Environment {
    folder: ".tools/lance",
    requirements: "tests/interop/lance.txt",
    about: "pylance and PyAV",
    pip: HASHED,
};

/// What makes wheels of the Python package.
pub(crate) const WHEEL_BUILD: Environment = Environment {
    folder: ".tools/wheel",
    requirements: "crates/swm-py/build.txt",
    about: "maturin",
    pip: HASHED,
};

/// The same with zig, whose linker knows older C libraries than this system's.
pub(crate) const WHEEL_ZIG: Environment = Environment {
    folder: ".tools/wheel-zig",
    requirements: "crates/swm-py/zig.txt",
    about: "maturin and zig",
    pip: HASHED,
};

/// What the tests of the Python package need next to it; the wheel itself is installed into this one.
pub(crate) const WHEEL_TESTS: Environment = Environment {
    folder: ".tools/wheel-tests",
    requirements: "crates/swm-py/tests/requirements.txt",
    about: "NumPy, Gymnasium and pytest",
    pip: HASHED,
};

/// The reference, with torch and what its checkpoints name: gigabytes.
pub(crate) const REFERENCE: Environment = Environment {
    folder: ".tools/reference",
    requirements: "tests/interop/reference.txt",
    about: "the reference and torch",
    pip: LISTED,
};

/// Makes the environment if it is missing or outdated, and returns its Python.
pub(crate) fn python(environment: &Environment) -> Result<PathBuf> {
    let Environment { folder, requirements, about, pip: options } = environment;
    let home = process::root().join(folder);
    let interpreter = home.join("bin/python");
    let stamp = home.join("requirements.txt");
    let wanted = fs::read_to_string(process::root().join(requirements))
        .with_context(|| format!("{requirements} is missing from the checkout"))?;
    if interpreter.is_file() && fs::read_to_string(&stamp).is_ok_and(|installed| installed == wanted) {
        return Ok(interpreter);
    }
    eprintln!("test: making a virtual environment with {about} in {folder}");
    process::output(Command::new(python::find()?).args(["-m", "venv", "--clear"]).arg(&home)).context(
        "python3 cannot make a virtual environment; install its `venv` module (Debian: python3-venv)",
    )?;
    let mut pip = Command::new(&interpreter);
    pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]).args(*options);
    process::output(pip.args(["-r", requirements]).current_dir(process::root()))?;
    fs::write(&stamp, wanted).with_context(|| format!("cannot write {}", stamp.display()))?;
    Ok(interpreter)
}
