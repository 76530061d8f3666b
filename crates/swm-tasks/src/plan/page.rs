//! The folder of a report on plans: `result.json`, figures, videos and a page that shows them.

use std::path::{Path, PathBuf};

use minijinja::value::Serde;
use minijinja::{Value, context};

use super::figures::{PlanFigure, Report, render_figures};
use super::summary::PlanSummary;
use crate::error::{TaskError, cannot};
use crate::html;
use crate::report::save_video;
use crate::svg::number;

/// Writes `result.json`, the figures, the videos and `index.html` into `dir`, and returns their paths.
///
/// # Errors
///
/// A file cannot be written, or a video cannot be encoded.
pub fn write_report(dir: &Path, report: &Report<'_>) -> Result<Vec<PathBuf>, TaskError> {
    let mut written = Vec::new();
    let mut write = |name: &str, text: &str| -> Result<(), TaskError> {
        let path = dir.join(name);
        std::fs::write(&path, text).map_err(cannot("write", &path))?;
        written.push(path);
        Ok(())
    };
    write("result.json", &serde_json::to_string_pretty(report.summary)?)?;
    let figures = render_figures(report)?;
    write("costs.svg", &figures.costs)?;
    for figure in &figures.plans {
        write(&format!("{}_elites.svg", figure.name), &figure.elites)?;
        if let Some(paths) = &figure.paths {
            write(&format!("{}_paths.svg", figure.name), paths)?;
        }
    }
    let mut videos = Vec::new();
    for (episode, scene) in report.video.scenes().filter(|(_, scene)| !scene.clip.is_empty()) {
        let path = save_video(dir, episode, scene, report.format)?;
        let name = |part: Option<&std::ffi::OsStr>| part.map(|part| part.to_string_lossy().into_owned());
        let caption = name(path.file_stem()).map(|stem| stem.replace('_', " "));
        let goal = scene.goal_address()?.map(Value::from_safe_string);
        videos.push(context! { file => name(path.file_name()), caption, goal, episode });
        written.push(path);
    }
    let path = dir.join("index.html");
    let summary = report.summary;
    let page = html::render(
        "plan.html",
        context! {
            title => format!("Planning in {}", summary.env), policy => &summary.policy, outcome => outcome(summary),
            seed => summary.seed, videos, costs => Value::from_safe_string(figures.costs),
            table => Serde(&summary.plans),
            plans => figures.plans.iter().map(PlanFigure::context).collect::<Vec<_>>(),
        },
    )?;
    std::fs::write(&path, page).map_err(cannot("write", &path))?;
    written.insert(0, path);
    Ok(written)
}

/// One sentence.
fn outcome(summary: &PlanSummary) -> String {
    let episodes = summary.episodes.len();
    let judged = summary.episodes.iter().filter_map(|episode| episode.success);
    let (count, won) = judged.fold((0, 0), |(count, won), success| (count + 1, won + u32::from(success)));
    let times: f64 = summary.plans.iter().map(|plan| plan.wall_time_s).sum();
    let plans = summary.plans.len();
    let each = times / plans.max(1) as f64;
    let success = if count > 0 { format!(", {won} of them successful") } else { String::new() };
    format!(
        "{episodes} {}{success}; {plans} {}, {} s each.",
        if episodes == 1 { "episode" } else { "episodes" },
        if plans == 1 { "plan" } else { "plans" },
        number(each),
    )
}
