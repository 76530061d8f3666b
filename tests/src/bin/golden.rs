//! `cargo xtask golden --check [DIR]`: replays recorded trajectories of the reference and prints, per file and
//! column, the worst difference. Exit status 1 above the stated tolerance.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result, bail};
use clap::Parser;
use swm_tests::golden::{GoldenFile, Report, check_file, rules};

/// Replay golden trajectories of the reference.
#[derive(Parser)]
struct Args {
    /// Replay and compare (the only mode).
    #[arg(long)]
    check: bool,
    /// Folder of `.npz` files, searched recursively. Default: the committed ones.
    dir: Option<PathBuf>,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn run(args: &Args) -> Result<bool> {
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/trajectories");
    let dir = args.dir.as_deref().unwrap_or(&committed);
    let mut files = Vec::new();
    find(dir, &mut files).with_context(|| format!("cannot read {}", dir.display()))?;
    files.sort();
    let registry = swm::registry();
    let (mut passed, mut failed, mut skipped) = (0, 0, 0);
    for path in &files {
        let shown = path.strip_prefix(dir).unwrap_or(path).display();
        let runs = match GoldenFile::read_all(path) {
            Ok(runs) => runs,
            Err(error) => {
                println!("{shown}: skipped, not a golden trajectory ({error:#})");
                skipped += 1;
                continue;
            }
        };
        let several = runs.len() > 1;
        for file in runs {
            let shown = match several {
                true => file.name.clone(),
                false => shown.to_string(),
            };
            if !file.numbers.contains_key("actions") {
                println!("{shown}: skipped, it holds no actions");
                skipped += 1;
                continue;
            }
            let Some(rules) = rules(&file.env_id) else {
                println!("{shown}: skipped, `{}` does not exist here yet", file.env_id);
                skipped += 1;
                continue;
            };
            let report = check_file(&registry, rules, &file).with_context(|| shown.clone())?;
            print(&shown, &report);
            if report.passes() { passed += 1 } else { failed += 1 }
        }
    }
    println!("\n{passed} passed, {failed} failed, {skipped} skipped");
    if passed + failed == 0 {
        bail!("{} holds no golden trajectory of an environment that exists here", dir.display());
    }
    Ok(failed == 0)
}

fn find(dir: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(dir)? {
        let path = entry?.path();
        if path.is_dir() {
            find(&path, files)?;
        } else if path.extension().is_some_and(|extension| extension == "npz") {
            files.push(path);
        }
    }
    Ok(())
}

fn print(name: &str, report: &Report) {
    println!("{name}: {}", if report.passes() { "ok" } else { "FAILED" });
    for words in &report.expected {
        println!("  expected difference: {words}");
    }
    for comparison in &report.comparisons {
        let (column, note) = (&comparison.column, &comparison.note);
        match comparison.tolerance {
            None => println!("  {column:16} {note}"),
            Some(tolerance) => {
                let verdict = if comparison.passes() { "ok" } else { "above tolerance" };
                println!(
                    "  {column:16} worst {:9.2e} at row {:3} (tolerance {tolerance:.1e}) {verdict} {note}",
                    comparison.worst, comparison.row
                );
            }
        }
    }
}
