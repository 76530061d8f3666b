//! The machine's Python, whose pip fetches what is pinned. Nothing of ours is written in it.

use std::process::Command;

use anyhow::{Result, bail};

/// The first Python 3 with pip that answers.
pub(crate) fn find() -> Result<&'static str> {
    let is_ok = |program: &str, args: &[&str]| {
        Command::new(program).args(args).output().is_ok_and(|output| output.status.success())
    };
    let is_python_3 = |name: &&str| is_ok(name, &["-c", "import sys; sys.exit(sys.version_info < (3, 8))"]);
    let Some(python) = ["python3", "python"].into_iter().find(is_python_3) else {
        bail!(
            "Python 3.8 or newer was not found (tried `python3` and `python` on PATH): install it, with pip"
        );
    };
    if !is_ok(python, &["-m", "pip", "--version"]) {
        bail!(
            "`{python}` was found but has no pip (tried `{python} -m pip --version`): \
             run `{python} -m ensurepip --user`, or install your system's package `python3-pip`"
        );
    }
    Ok(python)
}
