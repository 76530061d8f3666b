//! The tab of receipts: what it takes to repeat the results, to be read and to be saved from the page.

use serde_json::json;
use swm_core::error::BoxError;

use super::sections::{Shown, name};
use crate::evaluation::Sweep;
use crate::svg::escape;

/// What it takes to repeat them.
pub(super) fn tab(receipts: &[Shown<'_>], sweeps: &[&Sweep]) -> Result<String, BoxError> {
    let mut html = String::new();
    for (index, (receipt, _)) in receipts.iter().enumerate() {
        let manifest = &receipt.manifest;
        let prints = &receipt.fingerprints;
        let commit = receipt.code.commit.as_deref().map(|commit| format!(", {commit}")).unwrap_or_default();
        let facts = [
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
            ("policy", receipt.policy.clone()),
            ("seed of the policy", receipt.candidate.seed.to_string()),
            ("models", json!(receipt.files).to_string()),
            ("tables", prints.tables.clone()),
            ("physics", prints.physics.clone()),
            ("images", prints.images.clone().unwrap_or_default()),
            ("noise", prints.noise.clone()),
            ("code", format!("stable-worldmodel {}{commit}, {}", receipt.code.version, receipt.code.target)),
            ("seconds", format!("{:.1}", receipt.wall_time_s)),
        ];
        html += &facts_of(&name(receipt), &facts);
        html += &saved(index, "receipt", &serde_json::to_string(receipt)?);
    }
    for (index, sweep) in sweeps.iter().enumerate() {
        let facts = [
            ("environment", sweep.env.clone()),
            ("tier", sweep.tier.clone()),
            ("manifest", sweep.manifest_hash.clone()),
            ("values", json!(sweep.values).to_string()),
            ("code", format!("stable-worldmodel {}, {}", sweep.code.version, sweep.code.target)),
        ];
        html += &facts_of(&format!("Sweep of {}", sweep.policy), &facts);
        html += &saved(index, "sweep", &serde_json::to_string(sweep)?);
    }
    Ok(html)
}

fn facts_of(title: &str, facts: &[(&str, String)]) -> String {
    let known = facts.iter().filter(|(_, value)| !value.is_empty() && value != "{}");
    let rows: String = known
        .map(|(name, value)| format!("<tr><td>{name}</td><td><code>{}</code></td></tr>\n", escape(value)))
        .collect();
    format!("<h2>{}</h2>\n<div class=\"wide\"><table class=\"facts\">\n{rows}</table></div>\n", escape(title))
}

/// The whole JSON, in the page, to be saved from it.
fn saved(index: usize, kind: &str, json: &str) -> String {
    let json = json.replace("</", "<\\/");
    format!(
        "<p><button class=\"save\" data-save=\"{kind}-{index}\" data-name=\"{kind}-{index}.json\">Save {kind}.json</button></p>\n\
         <script type=\"application/json\" id=\"{kind}-{index}\">{json}</script>\n"
    )
}
