//! The parts of the page, one per tab, but for the receipts.

use std::fmt::Write as _;

use swm_core::evaluate::{EpisodeResult, PairedTest, Summary};

use super::charts::{self, Bar, Curve, Strip};
use super::replay::{Replayed, VideoCard};
use crate::evaluation::{Receipt, Role, Sweep};
use crate::svg::{escape, number};

pub(super) type Shown<'a> = (&'a Receipt, Replayed);

/// A table; the first row of cells is the head.
fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let cells = |tag: &str, cells: &[String]| -> String {
        cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect()
    };
    let head: Vec<String> = head.iter().map(|&cell| cell.to_owned()).collect();
    let mut html = format!("<div class=\"wide\"><table>\n<tr>{}</tr>\n", cells("th", &head));
    for row in rows {
        let _ = writeln!(html, "<tr>{}</tr>", cells("td", row));
    }
    html + "</table></div>\n"
}

/// A chart, and the same as a table.
fn chart(svg: &str, head: &[&str], rows: &[Vec<String>]) -> String {
    format!("<figure>{svg}</figure>\n<details><summary>As a table</summary>{}</details>\n", table(head, rows))
}

fn interval([low, high]: [f64; 2]) -> String {
    format!("{low:.1} to {high:.1}")
}

fn p_value(p: f64) -> String {
    if p < 0.0001 { "< 0.0001".to_owned() } else { format!("{p:.4}") }
}

/// Results of one manifest, which can be compared.
fn by_manifest<'a>(receipts: &'a [Shown<'a>]) -> Vec<Vec<&'a Receipt>> {
    let mut groups: Vec<Vec<&Receipt>> = Vec::new();
    for (receipt, _) in receipts {
        match groups.iter_mut().find(|group| group[0].manifest_hash == receipt.manifest_hash) {
            Some(group) => group.push(receipt),
            None => groups.push(vec![receipt]),
        }
    }
    groups
}

/// The name of a result: its policy, and its seed if it has one of its own.
pub(super) fn name(receipt: &Receipt) -> String {
    match receipt.candidate.seed {
        0 => receipt.policy.clone(),
        seed => format!("{} (seed {seed})", receipt.policy),
    }
}

/// Every policy of a manifest, reference policies once.
fn policies<'a>(group: &[&'a Receipt]) -> Vec<(String, &'a Summary, &'a [EpisodeResult], bool)> {
    let mut all: Vec<_> =
        group.iter().map(|receipt| (name(receipt), &receipt.summary, &receipt.episodes[..], false)).collect();
    for receipt in group {
        for reference in &receipt.references {
            let own = reference.candidate == receipt.candidate;
            let label = match reference.role {
                Role::Oracle => format!("oracle: {}", reference.candidate.policy.name),
                role => role.name().to_owned(),
            };
            if !own && !all.iter().any(|(known, ..)| *known == label) {
                all.push((label, &reference.summary, &reference.episodes[..], true));
            }
        }
    }
    all
}

/// What it came to.
pub(super) fn overview(receipts: &[Shown<'_>]) -> String {
    let groups = by_manifest(receipts);
    let mut html = String::new();
    for group in &groups {
        if groups.len() > 1 {
            let first = &group[0].manifest;
            let _ = writeln!(html, "<h2>{}, {} tier</h2>", escape(&first.env), first.tier.name());
        }
        html += "<div class=\"cards\">";
        for receipt in group {
            let [low, high] = receipt.summary.ci95;
            let mut lines = vec![format!("{low:.1} to {high:.1} % (95 %)")];
            let baseline = receipt.references.iter().filter(|other| other.role != Role::Oracle);
            let baseline = baseline.max_by(|a, b| a.summary.success_rate.total_cmp(&b.summary.success_rate));
            if let Some(baseline) = baseline {
                let over = receipt.summary.success_rate - baseline.summary.success_rate;
                lines.push(format!("{over:+.1} points over {}", baseline.role.name()));
            }
            if let Some(regret) = receipt.references.iter().find_map(|other| other.regret.as_ref()) {
                let plans: Vec<String> = regret.by_plan.iter().map(|lost| number(*lost)).collect();
                let plans = if plans.is_empty() { number(regret.first_plan) } else { plans.join(", ") };
                lines.push(format!("planner regret {plans} (after each plan)"));
            }
            if let Some(steps) = receipt.summary.mean_success_steps {
                lines.push(format!("{steps:.1} actions to success"));
            }
            let lines: String = lines.iter().map(|line| format!("<span>{}</span>", escape(line))).collect();
            let _ = write!(
                html,
                "<div class=\"card\"><span class=\"name\">{}</span><b>{:.1} %</b>{lines}</div>",
                escape(&name(receipt)),
                receipt.summary.success_rate
            );
        }
        html += "</div>\n<h2>Success</h2>\n<p>Bars with 95 % Wilson intervals; gray bars are the reference policies on the same pairs.</p>\n";
        let all = policies(group);
        let bars: Vec<Bar> = all
            .iter()
            .map(|(name, summary, _, reference)| Bar {
                name: name.clone(),
                rate: summary.success_rate,
                interval: summary.ci95,
                reference: *reference,
            })
            .collect();
        let rows: Vec<Vec<String>> = all
            .iter()
            .map(|(name, summary, ..)| {
                vec![
                    name.clone(),
                    format!("{:.1}", summary.success_rate),
                    interval(summary.ci95),
                    format!("{} of {}", summary.successes, summary.episodes),
                    summary.solved_at_start.to_string(),
                ]
            })
            .collect();
        let head = ["policy", "success, %", "95 % interval", "episodes", "success at reset"];
        html += &chart(&charts::bars(&bars), &head, &rows);
        html += &differences(group);
    }
    html
}

/// The first result against all others of its manifest.
fn differences(group: &[&Receipt]) -> String {
    let first = group[0];
    let row = |name: String, test: &PairedTest| {
        vec![
            name,
            format!("{:+.1}", test.difference),
            interval(test.interval95),
            test.only_first.to_string(),
            test.only_second.to_string(),
            p_value(test.p_value),
        ]
    };
    let mut rows: Vec<Vec<String>> = group[1..]
        .iter()
        .map(|other| row(name(other), &PairedTest::of(&first.successes(), &other.successes())))
        .collect();
    let references = first.references.iter().filter(|other| other.candidate != first.candidate);
    rows.extend(references.map(|other| row(other.role.name().to_owned(), &other.test)));
    if rows.is_empty() {
        return String::new();
    }
    let head = ["against", "difference, points", "95 % interval", "only the first", "only it", "McNemar p"];
    format!(
        "<h2>Differences, pair by pair</h2>\n<p>{} minus each other policy on the same pairs.</p>\n{}",
        escape(&name(first)),
        table(&head, &rows)
    )
}

/// How the episodes went.
pub(super) fn episodes(receipts: &[Shown<'_>]) -> String {
    let mut html = String::new();
    for group in by_manifest(receipts) {
        let all = policies(&group);
        let budget = group[0].manifest.budget;
        let curves: Vec<Curve> = all
            .iter()
            .map(|(name, _, episodes, _)| Curve {
                name: name.clone(),
                steps: episodes.iter().filter_map(|episode| episode.first_success_step).collect(),
                episodes: episodes.len(),
            })
            .collect();
        let marks: Vec<u64> = (0..=4).map(|quarter| budget * quarter / 4).collect();
        let rows: Vec<Vec<String>> = curves
            .iter()
            .map(|curve| {
                let share = |step: &u64| {
                    let done = curve.steps.iter().filter(|&first| first <= step).count();
                    format!("{:.1}", 100.0 * done as f64 / curve.episodes.max(1) as f64)
                };
                std::iter::once(curve.name.clone()).chain(marks.iter().map(share)).collect()
            })
            .collect();
        let head: Vec<String> = std::iter::once("policy".to_owned())
            .chain(marks.iter().map(|step| format!("by {step}, %")))
            .collect();
        let head: Vec<&str> = head.iter().map(String::as_str).collect();
        html += "<h2>Success by step</h2>\n<p>The share of episodes that have succeeded after so many actions.</p>\n";
        html += &chart(&charts::curves(&curves, budget), &head, &rows);
        let strips: Vec<Strip> = all
            .iter()
            .map(|(name, _, episodes, _)| Strip {
                name: name.clone(),
                episodes: episodes.iter().map(|episode| [episode.success, episode.solved_at_start]).collect(),
            })
            .collect();
        html += "<h2>Every pair</h2>\n<p>One column per pair, the same for all policies.</p>\n";
        let names: Vec<&str> =
            std::iter::once("pair").chain(strips.iter().map(|strip| strip.name.as_str())).collect();
        let outcome = |strip: &Strip, pair: usize| match strip.episodes.get(pair) {
            Some([true, true]) => "success at reset",
            Some([true, false]) => "success",
            Some([false, _]) => "failure",
            None => "–",
        };
        let count = strips.iter().map(|strip| strip.episodes.len()).max().unwrap_or(0);
        let rows: Vec<Vec<String>> = (0..count)
            .map(|pair| {
                let cells = strips.iter().map(|strip| outcome(strip, pair).to_owned());
                std::iter::once(pair.to_string()).chain(cells).collect()
            })
            .collect();
        html += &chart(&charts::episode_map(&strips), &names, &rows);
    }
    html
}

/// Robustness.
pub(super) fn factors(sweeps: &[&Sweep]) -> String {
    let mut html = String::new();
    for sweep in sweeps {
        let _ = writeln!(
            html,
            "<h2>{}</h2>\n<p>Success in percent on the same pairs, one factor changed at a time, then groups, then all.</p>",
            escape(&sweep.policy)
        );
        let rows: Vec<Vec<String>> = sweep
            .cells
            .iter()
            .map(|cell| {
                let (summary, test) = (cell.summary.as_ref(), cell.test.as_ref());
                vec![
                    cell.name.clone(),
                    cell.value.clone(),
                    summary.map_or("–".to_owned(), |summary| format!("{:.1}", summary.success_rate)),
                    summary.map_or(String::new(), |summary| interval(summary.ci95)),
                    test.map_or(String::new(), |test| format!("{:+.1}", test.difference)),
                    test.map_or(String::new(), |test| p_value(test.p_value)),
                    cell.note.clone().unwrap_or_default(),
                ]
            })
            .collect();
        let head =
            ["changed", "values", "success, %", "95 % interval", "minus unchanged", "McNemar p", "note"];
        html += &chart(&charts::heat_map(sweep), &head, &rows);
    }
    html
}

/// Videos beside their goals.
pub(super) fn videos(receipts: &[Shown<'_>]) -> String {
    let mut html = String::new();
    for (receipt, replayed) in receipts.iter().filter(|(_, replayed)| !replayed.videos.is_empty()) {
        let _ = writeln!(html, "<h2>{}</h2>\n<div class=\"videos\">", escape(&name(receipt)));
        for card in &replayed.videos {
            html += &video(card);
        }
        html += "</div>\n";
    }
    html
}

fn video(card: &VideoCard) -> String {
    let (class, word) = if card.success { ("won", "success") } else { ("lost", "failure") };
    let label = format!("video of pair {}, {word}", card.pair);
    let moving = if card.is_video {
        format!(
            "<video src=\"{}\" controls loop muted playsinline aria-label=\"{label}\"></video>",
            card.video
        )
    } else {
        format!("<img src=\"{}\" alt=\"{label}\">", card.video)
    };
    let goal = card.goal.as_ref().map_or(String::new(), |goal| {
        format!("<div><img src=\"{goal}\" alt=\"goal of pair {}\"><small>goal</small></div>", card.pair)
    });
    format!(
        "<figure class=\"video\"><div class=\"side\"><div>{moving}<small>episode</small></div>{goal}</div>\
         <figcaption>pair {} · <span class=\"tag {class}\">{word}</span> · {} actions</figcaption></figure>\n",
        card.pair, card.steps
    )
}

/// The planner at work.
pub(super) fn plans(receipts: &[Shown<'_>]) -> String {
    let mut html = String::new();
    for (index, (receipt, replayed)) in receipts.iter().enumerate() {
        for (pair, figures) in &replayed.plans {
            let word =
                if receipt.episodes.get(*pair).is_some_and(|e| e.success) { "success" } else { "failure" };
            let _ = writeln!(
                html,
                "<h2>{}: pair {pair}, {word}</h2>\n<p>Cost of the candidates of each iteration; lower is better.</p>\n<figure>{}</figure>",
                escape(&name(receipt)),
                figures.costs
            );
            let rows: Vec<Vec<String>> = figures.rows.clone();
            let head = ["plan", "at step", "first best", "last best", "cost of plan", "iterations"];
            html += &format!("<details><summary>As a table</summary>{}</details>\n", table(&head, &rows));
            for plan in &figures.plans {
                let _ = writeln!(html, "<h3>{}</h3>", escape(&plan.title));
                // Images are known by name on the page, and two results may have the same episode.
                let paths = plan.paths.as_ref().map(|paths| {
                    paths
                        .replace("\"start-", &format!("\"r{index}-start-"))
                        .replace("#start-", &format!("#r{index}-start-"))
                });
                if let Some(paths) = paths {
                    let _ = writeln!(
                        html,
                        "<p>Where the elites would lead, iteration by iteration.</p>\n<figure>{paths}</figure>"
                    );
                }
                let _ = writeln!(
                    html,
                    "<p>What the elites would do over the steps of the plan.</p>\n<figure>{}</figure>",
                    plan.elites
                );
            }
        }
    }
    html
}
