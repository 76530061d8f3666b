//! `cargo xtask ui`: the page of `swm ui`: built again from its sources and compared, and opened in a headless Chromium with data
//! that the program made. Skipped, with the reason, where there is no npm or no Chromium.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context as _, Result, bail};

use crate::{process, test};

/// Options of `cargo xtask ui`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// Where screenshots go
    #[arg(long)]
    shots: Option<PathBuf>,
    /// Build the page and leave it in `web/dist`, in place of comparing
    #[arg(long)]
    build: bool,
}

/// Builds, compares, tests.
pub(crate) fn run(args: &Args) -> Result<()> {
    let web = process::root().join("crates/swm-ui/web");
    if !answers("npm") {
        println!("ui: skipped: there is no npm, which builds the page from crates/swm-ui/web/src");
        return Ok(());
    }
    process::run(npm().args(["ci", "--no-fund", "--no-audit"]).current_dir(&web))?;
    let folder = tempfile::tempdir()?;
    // Beside the page that is there: cargo would build all that holds it anew.
    let (dist, built) = (web.join("dist"), folder.path().join("dist"));
    let out = if args.build { &dist } else { &built };
    process::run(npm().args(["run", "build", "--"]).arg(out).current_dir(&web))?;
    if args.build {
        return Ok(());
    }
    if files(&dist)? != files(&built)? {
        bail!(
            "crates/swm-ui/web/dist is not what its sources build: run `cargo xtask ui --build`, and commit it"
        );
    }
    println!("ui: web/dist is what its sources build");
    let known = ["chromium", "chromium-browser", "google-chrome"];
    let Some(chromium) = std::env::var("CHROMIUM")
        .ok()
        .or_else(|| known.into_iter().find(|name| answers(name)).map(str::to_owned))
    else {
        println!("ui: the page is not opened: there is no Chromium (Debian: apt install chromium)");
        return Ok(());
    };
    let program = demo_data(folder.path())?;
    let mut test = Command::new("node");
    test.arg("test.mjs").arg(program).arg(folder.path()).env("CHROMIUM", which(&chromium)).current_dir(&web);
    if let Some(shots) = &args.shots {
        test.arg(std::path::absolute(shots)?);
    }
    process::run(&mut test)
}

fn npm() -> Command {
    Command::new(if cfg!(windows) { "npm.cmd" } else { "npm" })
}

/// Whether a program is there.
fn answers(program: &str) -> bool {
    let version = Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    version.is_ok_and(|status| status.success())
}

/// The path of a program that `PATH` leads to.
fn which(program: &str) -> PathBuf {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let found =
        std::env::split_paths(&folders).map(|folder| folder.join(program)).find(|path| path.is_file());
    found.unwrap_or_else(|| program.into())
}

/// Names and contents, by name.
fn files(folder: &Path) -> Result<Vec<(OsString, Vec<u8>)>> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| format!("failed to read {}", folder.display()))? {
        let entry = entry?;
        all.push((entry.file_name(), fs::read(entry.path())?));
    }
    all.sort();
    Ok(all)
}

/// A dataset, a manifest with a receipt, a job of which a part is done, and a training run's metrics below `folder`; the program that
/// made them.
fn demo_data(folder: &Path) -> Result<PathBuf> {
    let program = test::program()?;
    let commands = [
        "collect swm/PushT-v1 --policy expert --episodes 8 --seed 1 --max-steps 200 --out demo.h5 --quiet",
        "manifest make swm/PushT-v1 --tier moderate --episodes 8 --budget 60 --out task.json --quiet",
        "eval --manifest task.json --policy expert --reference random,no-op --out result --quiet",
        "submit --job job --shards 3 --on script --no-copy -- collect swm/TwoRoom-v2 --policy expert --episodes 9 --image-size none",
        "task job --index 2",
    ];
    for line in commands {
        process::run(Command::new(&program).args(line.split(' ')).current_dir(folder))?;
    }
    let run = folder.join("run");
    fs::create_dir(&run)?;
    let line = |step: u32| {
        let loss = 2.0 / (1.0 + f64::from(step) / 50.0);
        format!("{{\"step\":{step},\"epoch\":0,\"part\":\"train\",\"loss\":{loss},\"lr\":0.0003}}\n")
    };
    fs::write(run.join("metrics.jsonl"), (0..400).step_by(5).map(line).collect::<String>())?;
    Ok(program)
}
