//! Results of policies on manifests, as the templates of the tabs *Overview* and *Episodes* show them.

use minijinja::{Value, context};
use swm_core::evaluate::{EpisodeResult, PairedTest, Summary};

use super::charts::{Curve, curves};
use super::labels::Label;
use crate::evaluation::{Receipt, Role};
use crate::svg::number;

/// One group per manifest: only results of one manifest can be compared.
pub(super) fn groups(receipts: &[(&Receipt, &Label)]) -> Vec<Value> {
    let mut groups: Vec<Vec<(&Receipt, &Label)>> = Vec::new();
    for &(receipt, label) in receipts {
        match groups.iter_mut().find(|group| group[0].0.manifest_hash == receipt.manifest_hash) {
            Some(group) => group.push((receipt, label)),
            None => groups.push(vec![(receipt, label)]),
        }
    }
    groups.iter().map(|group| group_context(group)).collect()
}

fn group_context(group: &[(&Receipt, &Label)]) -> Value {
    let manifest = &group[0].0.manifest;
    let rows = rows(group);
    let marks: Vec<u64> = (0..=4).map(|quarter| (u128::from(manifest.budget) * quarter / 4) as u64).collect();
    let chart: Vec<Curve> = rows
        .iter()
        .map(|row| Curve {
            name: &row.label.name,
            steps: row.episodes.iter().filter_map(|episode| episode.first_success_step).collect(),
            episodes: row.episodes.len(),
            is_reference: row.is_reference,
        })
        .collect();
    context! {
        env => &manifest.env,
        tier => manifest.tier.name(),
        results => group.iter().map(|(receipt, label)| context! {
            rate => receipt.summary.success_rate, lines => lines(receipt), ..label.context()
        }).collect::<Vec<_>>(),
        differences => differences(group),
        curves => Value::from_safe_string(curves(&chart, manifest.budget)),
        pairs => rows.iter().map(|row| row.episodes.len()).max(),
        rows => rows.iter().zip(&chart).map(|(row, curve)| context! {
            rate => row.summary.success_rate,
            interval => row.summary.ci95.to_vec(),
            successes => row.summary.successes,
            solved_at_start => row.summary.solved_at_start,
            is_reference => row.is_reference,
            outcomes => row.episodes.iter().map(outcome).collect::<Vec<_>>(),
            shares => marks.iter().map(|&step| curve.share(step)).collect::<Vec<_>>(),
            ..row.label.context()
        }).collect::<Vec<_>>(),
        marks,
    }
}

fn outcome(episode: &EpisodeResult) -> &'static str {
    match (episode.success, episode.solved_at_start) {
        (true, true) => "success at reset",
        (true, false) => "success",
        (false, _) => "failure",
    }
}

/// A policy on the pairs of a group.
struct Row<'a> {
    label: Label,
    summary: &'a Summary,
    episodes: &'a [EpisodeResult],
    is_reference: bool,
}

/// Every policy of a manifest, each reference policy once.
fn rows<'a>(group: &[(&'a Receipt, &Label)]) -> Vec<Row<'a>> {
    let mut rows: Vec<Row<'a>> = group
        .iter()
        .map(|&(receipt, label)| Row {
            label: label.clone(),
            summary: &receipt.summary,
            episodes: &receipt.episodes,
            is_reference: false,
        })
        .collect();
    for (receipt, _) in group {
        for reference in receipt.references.iter().filter(|other| other.candidate != receipt.candidate) {
            let name = match reference.role {
                Role::Oracle => format!("oracle: {}", reference.candidate.policy.name),
                role => format!("baseline: {}", role.name()),
            };
            if !rows.iter().any(|row| row.is_reference && row.label.name == name) {
                rows.push(Row {
                    label: Label { name, detail: String::new(), warning: None },
                    summary: &reference.summary,
                    episodes: &reference.episodes,
                    is_reference: true,
                });
            }
        }
    }
    rows
}

/// What a card says below the rate of success.
fn lines(receipt: &Receipt) -> Vec<String> {
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
    lines
}

/// The first result against all others of its manifest.
fn differences(group: &[(&Receipt, &Label)]) -> Vec<Value> {
    let first = group[0].0;
    let row = |name: &str, test: &PairedTest| {
        context! {
            name, difference => test.difference, interval => test.interval95.to_vec(),
            only_first => test.only_first, only_second => test.only_second, p_value => test.p_value,
        }
    };
    let others = group[1..]
        .iter()
        .map(|(other, label)| row(&label.name, &PairedTest::of(&first.successes(), &other.successes())));
    let references = first.references.iter().filter(|other| other.candidate != first.candidate);
    others.chain(references.map(|other| row(other.role.name(), &other.test))).collect()
}
