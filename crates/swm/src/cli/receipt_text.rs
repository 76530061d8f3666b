//! A receipt in few words, for people.

use std::path::Path;

use swm_core::evaluate::Summary;

use super::output::{counted, table};
use super::rates::{at_reset, difference, rate};
use super::regret::regret_line;
use crate::evaluation::{Receipt, Reference, Role};

/// The results of a receipt, and its file.
pub(super) fn receipt_text(receipt: &Receipt, path: Option<&Path>) -> String {
    let steps = |summary: &Summary| {
        summary.mean_success_steps.map_or("–".to_owned(), |steps| format!("{steps:.1}"))
    };
    let mut rows = vec![vec![
        receipt.candidate.policy.to_string(),
        rate(&receipt.summary),
        steps(&receipt.summary),
        String::new(),
        String::new(),
    ]];
    let is_itself = |other: &Reference| other.role == Role::Oracle && other.candidate == receipt.candidate;
    for other in receipt.references.iter().filter(|other| !is_itself(other)) {
        let test = &other.test;
        let [difference, p] = difference(test.difference, test.interval95, test.p_value);
        rows.push(vec![
            other.role.name().to_owned(),
            rate(&other.summary),
            steps(&other.summary),
            difference,
            p,
        ]);
    }
    let mut text = format!(
        "{}, {} tier, {} pairs{}\n\n{}",
        receipt.manifest.env,
        receipt.manifest.tier.name(),
        receipt.summary.episodes,
        at_reset(receipt.summary.solved_at_start),
        table(&["policy", "success (95 %)", "steps", "difference (95 %)", "McNemar"], rows),
    );
    for (phase, summary) in receipt.phases.iter().enumerate() {
        text += &format!("phase {phase}: {}, {}\n", rate(summary), counted(summary.episodes, "episode"));
    }
    if receipt.references.iter().any(is_itself) {
        text += "\nThe policy plans on the true dynamics: it is its own oracle.\n";
    }
    let others = receipt.references.iter().filter(|other| !is_itself(other));
    if let Some((oracle, regret)) = others.into_iter().find_map(|other| Some((other, other.regret.as_ref()?)))
    {
        text += &format!("\n{}\n", regret_line(regret));
        text += &oracle.negative_regret(&receipt.episodes).map(|why| format!("{why}\n")).unwrap_or_default();
    }
    let seed = Some(receipt.candidate.seed).filter(|&seed| seed != 0);
    text += &seed.map(|seed| format!("policy seed {seed}\n")).unwrap_or_default();
    text += &format!(
        "manifest {}\nwall time of the policy: {:.1} s\n",
        receipt.manifest_hash, receipt.wall_time_s
    );
    text + &path.map(|path| format!("{}\n", path.display())).unwrap_or_default()
}
