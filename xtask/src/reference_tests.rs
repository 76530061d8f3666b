//! `cargo xtask reference-tests`: the reference's own tests, run on the Python package through its module `compat`.
//!
//! The tests are not in this repository: `--path` names a checkout of the reference. A table says how many pass.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};

/// Options of `cargo xtask reference-tests`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A checkout of the reference
    #[arg(long, value_name = "CHECKOUT")]
    path: PathBuf,
    /// A Python with the wheel of `cargo xtask wheel`, pytest and torch
    #[arg(long, value_name = "PYTHON", default_value = "python3")]
    python: PathBuf,
}

/// Files of tests that must pass whole, below the reference's folder of tests.
const WHOLE: &[&str] = &[
    "test_spaces.py",
    "test_env_pool.py",
    "test_world.py",
    "test_new_world.py",
    "test_policy.py",
    "test_protocols.py",
    "test_buffer.py",
    "planning/test_evaluator.py",
    "planning/test_objective.py",
    "planning/solver/test_continuous.py",
    "planning/solver/test_callbacks.py",
    "planning/solver/test_categorical_cem.py",
    "planning/solver/test_warm_start_device_mismatch.py",
    "data/test_data.py",
    "data/test_protocol.py",
    "data/test_merge.py",
    "data/test_normalization.py",
    "data/test_stress.py",
    "data/test_integration_real.py",
];
/// Files of tests that touch private parts of the reference as well, or formats that the wheel lacks.
const IN_PART: &[&str] = &[
    "planning/solver/test_lagrangian.py",
    "planning/solver/test_pgd.py",
    "data/test_datasets.py",
    "data/test_replay_buffer.py",
    "data/test_format.py",
    "data/test_episode_data.py",
    "data/test_lance.py",
    "data/test_lerobot_adapter.py",
    "data/test_convert_video_formats.py",
    "test_utils.py",
    "envs/test_pusht_env.py",
];
/// The part of the second group that has to pass.
const WANTED: f64 = 0.85;

/// How the tests of one file ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    passed: u32,
    failed: u32,
    skipped: u32,
}

/// Runs them file by file and prints a table; an error if fewer pass than have to.
pub(crate) fn run(args: &Args) -> Result<()> {
    let tests = std::path::absolute(args.path.join("tests"))?;
    ensure!(
        tests.is_dir(),
        "{} is no checkout of the reference: it has no folder `tests`",
        args.path.display()
    );
    println!("| file | passed | of | skipped |\n|---|---|---|---|");
    let whole = group(&args.python, &tests, WHOLE)?;
    let part = group(&args.python, &tests, IN_PART)?;
    let total = f64::from(part.passed + part.failed);
    if whole.failed > 0 || f64::from(part.passed) < WANTED * total {
        bail!(
            "{} of the first group's tests failed, and {} of {total} of the second passed",
            whole.failed,
            part.passed
        );
    }
    Ok(())
}

fn group(python: &Path, tests: &Path, files: &[&str]) -> Result<Counts> {
    let mut sum = Counts::default();
    for file in files {
        let counts = run_file(python, &tests.join(file)).with_context(|| format!("failed to run {file}"))?;
        print_line(file, counts);
        sum.passed += counts.passed;
        sum.failed += counts.failed;
        sum.skipped += counts.skipped;
    }
    print_line("**all of these**", sum);
    Ok(sum)
}

fn print_line(name: &str, counts: Counts) {
    println!("| {name} | {} | {} | {} |", counts.passed, counts.passed + counts.failed, counts.skipped);
}

fn run_file(python: &Path, file: &Path) -> Result<Counts> {
    // Not in the checkout: Python would find the reference's own modules there.
    let folder = tempfile::tempdir()?;
    let mut command = Command::new(python);
    command.args([
        "-m",
        "pytest",
        "-q",
        "--tb=no",
        "-p",
        "stable_worldmodel_rs.compat",
        "-p",
        "no:cacheprovider",
    ]);
    command.arg("--rootdir").arg(folder.path()).arg(file).current_dir(folder.path());
    let output = command.env("PYTHONDONTWRITEBYTECODE", "1").output().context("pytest does not start")?;
    let text = String::from_utf8_lossy(&output.stdout);
    let counts = text.lines().rev().find_map(counts);
    counts.with_context(|| {
        format!("pytest says nothing of its tests:\n{text}{}", String::from_utf8_lossy(&output.stderr))
    })
}

/// Counts of pytest's last line: `1 failed, 140 passed, 2 skipped in 2.11s`. Errors count as failures.
fn counts(line: &str) -> Option<Counts> {
    let (list, _) = line.trim_matches(['=', ' ']).rsplit_once(" in ")?;
    let mut counts = Counts::default();
    for part in list.split(", ") {
        let (number, what) = part.split_once(' ')?;
        let number: u32 = number.parse().ok()?;
        match what {
            "passed" | "xpassed" => counts.passed += number,
            "failed" | "error" | "errors" => counts.failed += number,
            "skipped" | "xfailed" | "deselected" => counts.skipped += number,
            _ => {}
        }
    }
    Some(counts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pytests_last_line_is_read() {
        let all = Counts { passed: 140, failed: 3, skipped: 2 };
        assert_eq!(counts("1 failed, 140 passed, 2 skipped, 5 warnings, 2 errors in 2.11s"), Some(all));
        assert_eq!(counts("===== 1 passed in 0.01s ====="), Some(Counts { passed: 1, ..Counts::default() }));
        assert_eq!(counts("no tests ran in 0.01s"), None);
        assert_eq!(counts("FAILED ::test_it - assert 1 in 2"), None);
    }

    #[test]
    fn no_file_is_named_twice() {
        let mut files: Vec<_> = WHOLE.iter().chain(IN_PART).collect();
        files.sort_unstable();
        files.dedup();
        assert_eq!(files.len(), WHOLE.len() + IN_PART.len());
    }
}
