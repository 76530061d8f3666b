//! The tab *Receipts*: everything it takes to repeat the results, to be read and to be saved from the page.

use minijinja::{Value, context};
use serde::Serialize;
use serde_json::json;

use super::labels::Label;
use crate::evaluation::{Receipt, Sweep};

/// What the tab shows: a table of entries, and the whole JSON, for each receipt and each sweep.
pub(super) fn saved(
    receipts: &[(&Receipt, &Label)],
    sweeps: &[(&Sweep, &Label)],
) -> serde_json::Result<Vec<Value>> {
    let receipts = receipts.iter().enumerate().map(|(index, (receipt, label))| {
        saved_as("receipt", index, label.name.clone(), &receipt_entries(receipt), receipt)
    });
    let sweeps = sweeps.iter().enumerate().map(|(index, (sweep, label))| {
        let entries = [
            ("environment", sweep.env.clone()),
            ("tier", sweep.tier.clone()),
            ("manifest", sweep.manifest_hash.clone()),
            ("policy", sweep.candidate.policy.to_string()),
            ("values", json!(sweep.values).to_string()),
            ("code", format!("stable-worldmodel {}, {}", sweep.code.version, sweep.code.target)),
        ];
        saved_as("sweep", index, format!("Sweep: {}", label.name), &entries, sweep)
    });
    receipts.chain(sweeps).collect()
}

fn saved_as(
    kind: &str,
    index: usize,
    title: String,
    entries: &[(&str, String)],
    whole: &impl Serialize,
) -> serde_json::Result<Value> {
    let json = serde_json::to_string(whole)?.replace("</", "<\\/");
    let entries: Vec<Vec<Value>> =
        entries.iter().map(|(name, value)| vec![Value::from(*name), Value::from(value)]).collect();
    let id = format!("{kind}-{index}");
    Ok(context! { kind, id, title, entries, json => Value::from_safe_string(json) })
}

fn receipt_entries(receipt: &Receipt) -> [(&'static str, String); 19] {
    let Receipt { manifest, fingerprints, code, .. } = receipt;
    let commit = code.commit.as_deref().map(|commit| format!(", {commit}")).unwrap_or_default();
    [
        ("environment", manifest.env.clone()),
        ("settings", json!(manifest.settings).to_string()),
        ("tier", manifest.tier.name().to_owned()),
        ("success", manifest.success.describe()),
        ("pairs", manifest.pairs.len().to_string()),
        ("actions allowed", manifest.budget.to_string()),
        ("left out", manifest.excluded.describe()),
        ("source", manifest.source.describe()),
        ("distractors", manifest.distractors.join(" ")),
        ("manifest", receipt.manifest_hash.clone()),
        ("policy", receipt.candidate.policy.to_string()),
        ("seed of the policy", receipt.candidate.seed.to_string()),
        ("models", json!(receipt.files).to_string()),
        ("tables", fingerprints.tables.clone()),
        ("physics", fingerprints.physics.clone()),
        ("images", fingerprints.images.clone().unwrap_or_default()),
        ("noise", fingerprints.noise.clone()),
        ("code", format!("stable-worldmodel {}{commit}, {}", code.version, code.target)),
        ("seconds", format!("{:.1}", receipt.wall_time_s)),
    ]
}
