//! The page that shows a report together: what it came to, videos, figures.

use std::fmt::Write as _;

use super::PlanSummary;
use crate::svg::{escape, number};

/// The figures, as SVG.
pub(crate) struct Figures {
    pub(crate) costs: String,
    pub(crate) plans: Vec<PlanFigure>,
    /// What the figure of costs shows, as a table: plan, step, first best, last best, cost, iterations.
    pub(crate) rows: Vec<Vec<String>>,
}

/// Those of one plan.
pub(crate) struct PlanFigure {
    /// Of its files.
    pub(crate) name: String,
    pub(crate) title: String,
    pub(crate) elites: String,
    pub(crate) paths: Option<String>,
}

const STYLE: &str = "\
:root{color-scheme:light dark}*{box-sizing:border-box}\
body{font:16px/1.5 system-ui,sans-serif;max-width:68rem;margin:2rem auto;padding:0 1rem;color:#1f2430;background:#fff}\
h1{font-size:1.5rem;margin:0}h2{font-size:1.15rem;margin:2.2rem 0 .4rem}h3{font-size:1rem;margin:1.4rem 0 .3rem}\
p{margin:.3rem 0;color:#5b6475}code{overflow-wrap:anywhere}a{color:#1d5fd1}\
.wide{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums}\
th,td{padding:.25rem .9rem .25rem 0;text-align:right;white-space:nowrap}th{font-weight:600;border-bottom:1px solid #8a93a5}\
figure{margin:.6rem 0;overflow-x:auto}figure svg{display:block}\
.videos{display:flex;flex-wrap:wrap;gap:1rem}.videos figure{margin:0}.videos img,.videos video{width:16rem;max-width:100%;display:block}\
figcaption{color:#5b6475;font-size:.9rem}\
@media(prefers-color-scheme:dark){body{color:#e6e9ef;background:#14171d}p,figcaption{color:#a3acbd}a{color:#76a9ff}}";

/// The page.
pub(super) fn draw(summary: &PlanSummary, figures: &Figures, videos: &[String]) -> String {
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>Planning in {env}</title>\n\
         <style>{STYLE}</style>\n<h1>Planning in {env}</h1>\n<p><code>{policy}</code></p>\n\
         <p>{} Seed {}. Everything tried is in <a href=\"trace.jsonl\">trace.jsonl</a>, the figures below in \
         <a href=\"result.json\">result.json</a>.</p>\n",
        outcome(summary),
        summary.seed,
        env = escape(&summary.env),
        policy = escape(&summary.policy),
    );
    if !videos.is_empty() {
        page += "<h2>What happened</h2>\n<div class=\"videos\">\n";
        for video in videos {
            let name = escape(video);
            let caption = name.rsplit_once('.').map_or(name.as_str(), |(stem, _)| stem).replace('_', " ");
            let element = if name.ends_with(".mp4") {
                format!("<video src=\"{name}\" controls autoplay loop muted playsinline></video>")
            } else {
                format!("<img src=\"{name}\" alt=\"video of {caption}\">")
            };
            let _ = writeln!(page, "<figure>{element}<figcaption>{caption}</figcaption></figure>");
        }
        page += "</div>\n";
    }
    page += "<h2>How the search went</h2>\n<p>Cost of the candidates of each iteration; lower is better. The table shows the cheapest candidate of the first and of the last iteration.</p>\n";
    let _ = writeln!(page, "<figure>{}</figure>", figures.costs);
    page += &table(summary);
    if figures.plans.len() < summary.plans.len() {
        let (drawn, all) = (figures.plans.len(), summary.plans.len());
        let _ = writeln!(page, "<p>The first {drawn} of {all} plans are drawn.</p>");
    }
    for plan in &figures.plans {
        let _ = writeln!(page, "<h2>{}</h2>", escape(&plan.title));
        if let Some(paths) = &plan.paths {
            page += "<h3>Where the elites would lead</h3>\n<p>Simulated from the moment of planning, over its image.</p>\n";
            let _ = writeln!(page, "<figure>{paths}</figure>");
        }
        page += "<h3>What the elites would do</h3>\n<p>Actions over the steps of the plan, as they would be carried out.</p>\n";
        let _ = writeln!(page, "<figure>{}</figure>", plan.elites);
    }
    page + "</html>\n"
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

fn table(summary: &PlanSummary) -> String {
    let head = [
        "episode",
        "plan",
        "at step",
        "first best",
        "last best",
        "cost of plan",
        "iterations",
        "not finite",
        "seconds",
    ];
    let head: String = head.iter().map(|name| format!("<th>{name}</th>")).collect();
    let mut table = format!("<div class=\"wide\"><table>\n<tr>{head}</tr>\n");
    let cost = |cost: Option<f64>| cost.map_or("–".to_owned(), number);
    for plan in &summary.plans {
        let cells = [
            plan.episode.to_string(),
            plan.plan.to_string(),
            plan.step.to_string(),
            cost(plan.first_best),
            cost(plan.last_best),
            cost(plan.cost),
            plan.iterations.to_string(),
            plan.non_finite.to_string(),
            number(plan.wall_time_s),
        ];
        let cells: String = cells.iter().map(|cell| format!("<td>{cell}</td>")).collect();
        let _ = writeln!(table, "<tr>{cells}</tr>");
    }
    table + "</table></div>\n"
}
