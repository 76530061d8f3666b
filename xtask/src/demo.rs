//! `cargo xtask demo`: the main job from end to end. Records PushT episodes, evaluates an expert, a random policy and a
//! planner from goals of that dataset, prints a table, and leaves a folder with images and videos.

mod robustness;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context as _, Result};
use serde_json::{Value as Json, json};

use crate::metadata::Metadata;
use crate::{process, setup, test};

/// Options of `cargo xtask demo`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A quick pass over every stage, for CI: few episodes, the development build
    #[arg(long)]
    pub(crate) short: bool,
    /// Also train a LeWM on TwoRoom and evaluate it under changed colors and speeds. Builds a tensor library: some minutes
    #[arg(long)]
    pub(crate) robustness: bool,
    /// Where the report goes
    #[arg(long, default_value = "demo-report", value_name = "DIR")]
    pub(crate) out: PathBuf,
}

/// How much of everything.
struct Size {
    recorded: &'static str,
    evaluated: &'static str,
    planner: &'static str,
    planner_evaluated: &'static str,
    robustness: robustness::Amount,
}

const FULL: Size = Size {
    recorded: "200",
    evaluated: "50",
    planner: "cem:samples=128,iterations=8,elites=16,horizon=10,receding_horizon=4,action_block=1",
    planner_evaluated: "50",
    robustness: robustness::FULL,
};

const SHORT: Size = Size {
    recorded: "6",
    evaluated: "4",
    planner: "cem:samples=32,iterations=2,elites=4,horizon=4,receding_horizon=4,action_block=2",
    planner_evaluated: "2",
    robustness: robustness::SHORT,
};

const ENV: &str = "swm/PushT-v1";

/// The whole demonstration.
pub(crate) fn run(args: &Args) -> Result<()> {
    setup::for_build()?;
    let size = if args.short { SHORT } else { FULL };
    let swm = &Swm::build(args)?;
    let started = Instant::now();
    let out = std::path::absolute(&args.out)?;
    fs::create_dir_all(&out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let data = out.join("pusht_expert.h5");
    let recorded = swm.json(
        &[
            "collect",
            ENV,
            "--policy",
            "expert",
            "--episodes",
            size.recorded,
            "--seed",
            "1",
            "--mode",
            "overwrite",
        ],
        &[("--out", &data)],
    )?;
    let video_format = if process::has_cxx() { "mp4" } else { "gif" };
    let mut results = Vec::new();
    let policies = [
        ("expert", "expert", size.evaluated),
        ("random", "random", size.evaluated),
        ("cem on the simulator", size.planner, size.planner_evaluated),
    ];
    for (name, policy, episodes) in policies {
        let folder = out.join(name.split(' ').next().unwrap_or(name));
        let paths = [("--dataset", data.as_path()), ("--out", folder.as_path())];
        let call = [
            "eval",
            ENV,
            "--policy",
            policy,
            "--episodes",
            episodes,
            "--videos",
            "3",
            "--video-format",
            video_format,
            "--seed",
            "42",
            "--again",
        ];
        results.push((name, folder.clone(), swm.json(&call, &paths)?));
    }
    let robustness = if args.robustness { robustness::run(swm, &size.robustness, &out)? } else { Vec::new() };
    let table = markdown(&results, &robustness);
    println!("\n{table}");
    let seconds = started.elapsed().as_secs_f64();
    let page = out.join("index.html");
    fs::write(&page, html(&recorded, &results, &robustness, &out)?)?;
    fs::write(out.join("results.md"), &table)?;
    println!("{seconds:.0} s after the build; the report with images and videos: {}", page.display());
    Ok(())
}

/// The command `swm` of one build.
struct Swm(PathBuf);

impl Swm {
    /// Builds it, with videos in MP4 where the machine can build them. The build of the profile `demo` leaves out what it does not
    /// need: MuJoCo, rapier and faer. The short form takes the program of the tests, which is built already.
    fn build(args: &Args) -> Result<Self> {
        let (profile, folder) = match (args.short, args.robustness) {
            (true, false) => return Ok(Self(test::program()?)),
            (true, true) => (&[][..], "debug"),
            (false, _) => (&["--profile", "demo"][..], "demo"),
        };
        let mut features = vec!["cli"];
        features.extend(process::has_cxx().then_some("mp4"));
        features.extend(args.robustness.then_some("baselines"));
        let package = ["build", "--package", "swm", "--bin", "swm", "--no-default-features", "--features"];
        process::run(process::cargo(package).arg(features.join(",")).args(profile))?;
        let name = format!("swm{}", std::env::consts::EXE_SUFFIX);
        Ok(Self(Metadata::load()?.target_directory.join(folder).join(name)))
    }

    /// Runs it and returns what it prints as JSON.
    fn json(&self, args: &[&str], paths: &[(&str, &Path)]) -> Result<Json> {
        let mut command = Command::new(&self.0);
        command.args(args).current_dir(process::root());
        for (option, path) in paths {
            command.arg(option).arg(path);
        }
        eprintln!("swm {}", args.join(" "));
        let printed = process::output(command.args(["--json", "--quiet"]))?;
        serde_json::from_slice(&printed).with_context(|| format!("`swm {}` printed no JSON", args.join(" ")))
    }
}

const HEAD: [&str; 6] = ["policy", "success", "95 % interval", "episodes", "steps to success", "wall time"];

/// A row of the table of results: goals 25 steps ahead in the recorded episodes, 50 actions.
fn cells(name: &str, result: &Json) -> [String; 6] {
    let number = |pointer: &str| result.pointer(pointer).and_then(Json::as_f64).unwrap_or(f64::NAN);
    let cells = [
        name.to_owned(),
        format!("{:.0} %", number("/success_rate")),
        format!("{:.0} to {:.0} %", number("/ci95/0"), number("/ci95/1")),
        number("/episodes").to_string(),
        format!("{:.1}", number("/mean_success_steps")),
        format!("{:.1} s", number("/wall_time_s")),
    ];
    cells.map(|cell| cell.replace("NaN", "–"))
}

fn markdown(results: &[(&str, PathBuf, Json)], robustness: &[[String; 4]]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let head = |names: &[&str]| format!("| {} |\n{}|\n", names.join(" | "), "|---".repeat(names.len()));
    let rows: String = results.iter().map(|(name, _, result)| line(&cells(name, result))).collect();
    let mut text = head(&HEAD) + &rows;
    if !robustness.is_empty() {
        let rows: String = robustness.iter().map(|row| line(row)).collect();
        text += &format!("\n{}{rows}", head(&robustness::HEAD));
    }
    text
}

/// One page: the table, that of the learned model if there is one, then images and videos per policy.
fn html(
    recorded: &Json,
    results: &[(&str, PathBuf, Json)],
    robustness: &[[String; 4]],
    out: &Path,
) -> Result<String> {
    let shown = results.iter().map(|(name, folder, result)| {
        let mut paths: Vec<PathBuf> =
            fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
        paths.sort();
        let mut files = Vec::new();
        for path in paths {
            let kind = path.extension().unwrap_or_default().to_string_lossy();
            let caption = path.file_stem().unwrap_or_default().to_string_lossy().replace('_', " ");
            if ["png", "gif", "mp4"].contains(&kind.as_ref()) {
                let path = path.strip_prefix(out).context("a file outside of the report")?;
                files.push(json!({ "kind": kind, "caption": caption, "path": path }));
            }
        }
        Ok(json!({ "cells": cells(name, result), "files": files }))
    });
    let page = json!({
        "style": include_str!("../../crates/swm-tasks/templates/style.css"),
        "recorded": recorded,
        "head": HEAD,
        "results": shown.collect::<Result<Vec<_>>>()?,
        "robustness": { "head": robustness::HEAD, "rows": robustness },
    });
    let mut engine = minijinja::Environment::new();
    engine.set_undefined_behavior(minijinja::UndefinedBehavior::SemiStrict);
    Ok(engine.render_named_str("demo.html", include_str!("demo.html"), minijinja::value::Serde(&page))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_shows_the_table_and_every_file() {
        let out = tempfile::tempdir().unwrap();
        let folder = out.path().join("expert");
        fs::create_dir(&folder).unwrap();
        for name in ["episode_000_success.mp4", "episodes.png", "result.json"] {
            fs::write(folder.join(name), "").unwrap();
        }
        let result =
            json!({ "success_rate": 75.0, "ci95": [30.0, 95.0], "episodes": 4, "wall_time_s": 1.25 });
        let results = [("a < b", folder, result)];
        let recorded = json!({ "episodes": 6, "rows": 300 });
        let page = html(&recorded, &results, &[], out.path()).unwrap();
        assert!(
            page.contains(
                "<td>a &lt; b</td><td>75 %</td><td>30 to 95 %</td><td>4</td><td>–</td><td>1.2 s</td>"
            ),
            "{page}"
        );
        assert!(
            page.contains("title=\"episode 000 success\"") && page.contains("alt=\"episodes\""),
            "{page}"
        );
        assert!(
            !page.contains("result.json") && page.contains("<p>6 recorded expert episodes, 300 steps."),
            "{page}"
        );
        assert!(!page.contains("LeWM"), "{page}");
        let last =
            |robustness: &[[String; 4]]| markdown(&results, robustness).lines().last().map(str::to_owned);
        assert_eq!(last(&[]).as_deref(), Some("| a < b | 75 % | 30 to 95 % | 4 | – | 1.2 s |"));
        let changed = [["agent.color", "33.3 %", "-63.3", "0.0001"].map(str::to_owned)];
        assert_eq!(last(&changed).as_deref(), Some("| agent.color | 33.3 % | -63.3 | 0.0001 |"));
        let page = html(&recorded, &results, &changed, out.path()).unwrap();
        assert!(page.contains("LeWM") && page.contains("<td>agent.color</td><td>33.3 %</td>"), "{page}");
    }
}
