//! `cargo xtask demo`: the main job from end to end. Records PushT episodes, evaluates an expert, a random policy and a
//! planner from goals of that dataset, prints a table, and leaves a folder with images and videos.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, anyhow};
use serde_json::Value as Json;

use crate::{process, setup};

/// Options of `cargo xtask demo`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A quick pass over every stage, for CI: few episodes, the development build
    #[arg(long)]
    pub(crate) short: bool,
    /// Where the report goes
    #[arg(long, default_value = "demo-report", value_name = "DIR")]
    pub(crate) out: PathBuf,
}

/// How much of everything.
struct Size {
    profile: &'static [&'static str],
    recorded: &'static str,
    evaluated: &'static str,
    planner: &'static str,
    planner_evaluated: &'static str,
}

const FULL: Size = Size {
    profile: &["--release"],
    recorded: "200",
    evaluated: "50",
    planner: "cem:samples=128,iterations=8,elites=16,horizon=10,receding_horizon=4,action_block=1",
    planner_evaluated: "50",
};

const SHORT: Size = Size {
    profile: &[],
    recorded: "6",
    evaluated: "4",
    planner: "cem:samples=32,iterations=2,elites=4,horizon=4,receding_horizon=4,action_block=2",
    planner_evaluated: "2",
};

const ENV: &str = "swm/PushT-v1";

/// The whole demonstration.
pub(crate) fn run(args: &Args) -> Result<()> {
    setup::for_demo()?;
    let size = if args.short { &SHORT } else { &FULL };
    process::run(process::cargo(["build"]).args(package()).args(size.profile))?;
    let started = Instant::now();
    let out = std::path::absolute(&args.out)?;
    fs::create_dir_all(&out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let data = out.join("pusht_expert.h5");
    let recorded = swm(
        size,
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
        ];
        results.push((name, folder.clone(), swm(size, &call, &paths)?));
    }
    let table = markdown(&results);
    println!("\n{table}");
    let seconds = started.elapsed().as_secs_f64();
    let page = out.join("index.html");
    fs::write(&page, html(&recorded, &results, &out)?)?;
    fs::write(out.join("results.md"), &table)?;
    println!("{seconds:.0} s after the build; the report with images and videos: {}", page.display());
    Ok(())
}

/// The command `swm`, with videos in MP4 where the machine can build them.
fn package() -> &'static [&'static str] {
    const BIN: &[&str] = &["--package", "swm", "--bin", "swm"];
    const WITHOUT_MP4: &[&str] =
        &["--package", "swm", "--bin", "swm", "--no-default-features", "--features", "cli"];
    if process::has_cxx() { BIN } else { WITHOUT_MP4 }
}

/// Runs the command `swm` and returns what it says as JSON.
fn swm(size: &Size, args: &[&str], paths: &[(&str, &Path)]) -> Result<Json> {
    let mut command = process::cargo(["run", "--quiet"]);
    command.args(package()).args(size.profile).arg("--").args(args);
    for (option, path) in paths {
        command.arg(option).arg(path);
    }
    eprintln!("swm {}", args.join(" "));
    let printed = process::output(command.args(["--json", "--quiet"]))?;
    serde_json::from_slice(&printed).with_context(|| format!("`swm {}` printed no JSON", args.join(" ")))
}

fn number(result: &Json, pointer: &str) -> f64 {
    result.pointer(pointer).and_then(Json::as_f64).unwrap_or(f64::NAN)
}

/// The table of results: goals 25 rows ahead in the recorded episodes, 50 actions.
fn markdown(results: &[(&str, PathBuf, Json)]) -> String {
    let mut text =
        String::from("| policy | success | 95 % interval | episodes | steps to success | wall time |\n");
    text += "|---|---|---|---|---|---|\n";
    for (name, _, result) in results {
        let _ = writeln!(
            text,
            "| {name} | {:.0} % | {:.0} to {:.0} % | {} | {:.1} | {:.1} s |",
            number(result, "/success_rate"),
            number(result, "/ci95/0"),
            number(result, "/ci95/1"),
            number(result, "/episodes"),
            number(result, "/mean_success_steps"),
            number(result, "/wall_time_s"),
        );
    }
    text.replace("NaN", "–")
}

/// One page: the table, then images and videos per policy.
fn html(recorded: &Json, results: &[(&str, PathBuf, Json)], out: &Path) -> Result<String> {
    let mut page = String::from(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>PushT demo</title><style>:root{color-scheme:light dark}body{font:16px system-ui;max-width:70rem;\
         margin:2rem auto;padding:0 1rem}td,th{padding:.3rem .8rem;text-align:left}img,video{max-width:100%;\
         margin:.2rem}</style><h1>PushT: expert, random, planner</h1>",
    );
    let _ = write!(
        page,
        "<p>{} recorded expert episodes, {} rows. Each policy starts at a recorded row and must reach what was \
         recorded 25 rows later, within 50 actions.</p><table>",
        number(recorded, "/episodes"),
        number(recorded, "/rows"),
    );
    for (index, line) in markdown(results).lines().enumerate().filter(|(index, _)| *index != 1) {
        let tag = if index == 0 { "th" } else { "td" };
        let cells = line.trim_matches('|').split('|').map(|cell| format!("<{tag}>{}</{tag}>", cell.trim()));
        let _ = write!(page, "<tr>{}</tr>", cells.collect::<String>());
    }
    page += "</table>";
    for (name, folder, _) in results {
        let _ = write!(
            page,
            "<h2>{name}</h2><p>One row per episode: the goal in an orange frame, then moments from first to last. The green shape is a decoration that the reference draws, \
             not the goal.</p>"
        );
        let mut files: Vec<PathBuf> =
            fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
        files.sort();
        for file in files {
            let relative =
                file.strip_prefix(out).map_err(|_| anyhow!("a file outside of the report"))?.display();
            let caption = file.file_stem().unwrap_or_default().to_string_lossy().replace('_', " ");
            let extension = file.extension().and_then(|extension| extension.to_str());
            let element = match extension {
                Some("png" | "gif") => format!("<img src=\"{relative}\" alt=\"{caption}\"><br>"),
                Some("mp4") => {
                    format!(
                        "<video src=\"{relative}\" title=\"{caption}\" controls autoplay loop muted playsinline></video>"
                    )
                }
                _ => continue,
            };
            page += &element;
        }
    }
    Ok(page + "</html>\n")
}
