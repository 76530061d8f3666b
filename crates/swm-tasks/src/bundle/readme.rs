//! The texts of a bundle for people: what it is, how it is repeated, and the card of its model.

use serde_json::{Value as Json, json};
use swm_core::evaluate::Summary;

use super::BundleInfo;
use crate::error::TaskError;
use crate::evaluation::Receipt;

/// `README.md`, with metadata as the Hugging Face Hub reads it.
pub(super) fn readme(receipt: &Receipt, info: &BundleInfo) -> Result<String, TaskError> {
    let Receipt { manifest, summary, .. } = receipt;
    let mut text = metadata(receipt, info)?;
    text += &format!(
        "# {} in {}\n\n{} over {} pairs of start and goal, {} tier.\n",
        code(&receipt.policy),
        manifest.env,
        rate(summary),
        manifest.pairs.len(),
        manifest.tier.name(),
    );
    if summary.solved_at_start > 0 {
        text +=
            &format!("\n{} of the pairs are a success before the first action.\n", summary.solved_at_start);
    }
    if !receipt.references.is_empty() {
        text += "\n| reference policy | success | difference, percentage points |\n|---|---|---|\n";
        for reference in &receipt.references {
            let (test, [low, high]) = (&reference.test, reference.test.interval95);
            text += &format!(
                "| {} | {} | {:+.1} ({low:+.1} to {high:+.1}) |\n",
                reference.role.name(),
                rate(&reference.summary),
                test.difference
            );
        }
    }
    if let Some(reported) = &info.reported {
        let source =
            reported.source.as_deref().map(|source| format!(" by {}", plain(source))).unwrap_or_default();
        text += &format!("\nReported{source}: {:.1} %.\n", reported.success_rate);
    }
    Ok(text + "\n" + &repeat(receipt, info) + "\n" + &made_by(receipt, info) + "\n" + &files(receipt))
}

/// What the Hub parses, between two lines of dashes.
fn metadata(receipt: &Receipt, info: &BundleInfo) -> Result<String, TaskError> {
    let license = match &info.license {
        Some(license) => format!("license: {}\n", quoted(license)?),
        None => String::new(),
    };
    let env = quoted(&receipt.manifest.env)?;
    Ok(format!(
        "---\n{license}library_name: stable-worldmodel-rs\npipeline_tag: robotics\ntags:\n- world-model\n- planning\n- {env}\n---\n\n"
    ))
}

fn repeat(receipt: &Receipt, info: &BundleInfo) -> String {
    let mut text =
        "## Repeat it\n\nThe folder holds everything but the program: no dataset and no clone is needed.\n\n"
            .to_owned();
    if info.is_foreign {
        text += "The policy is an object of the program that evaluated it, of which the receipt has the settings and the files below `model`. With \
                 that object:\n\n```python\nimport stable_worldmodel_rs as swm\n\nswm.verify(\"FOLDER\", policy=POLICY, weights=[FILES])\n```\n";
    } else {
        text += "```bash\nswm verify-result FOLDER\n```\n\nor in Python\n\n```python\nimport stable_worldmodel_rs as swm\n\nprint(swm.verify(\"FOLDER\"))\n```\n";
        if !receipt.files.is_empty() {
            text += "\nA policy that acts by a model needs a program that has it: of trained baselines, one that is built with the feature \
                     `baselines`.\n";
        }
    }
    text + "\nBoth compare the SHA-256 of all files first (as `sha256sum -c SHA256SUMS` does), then run every pair again and name the part that \
            differs, if one does.\n"
}

fn made_by(receipt: &Receipt, info: &BundleInfo) -> String {
    let Receipt { manifest, candidate, .. } = receipt;
    let version = |code: &crate::evaluation::Code| {
        let commit = code.commit.as_deref().map(|commit| format!(", commit {commit}")).unwrap_or_default();
        format!("stable-worldmodel for Rust {}{commit}, {}", code.version, code.target)
    };
    let mut rows = vec![
        ("environment".to_owned(), manifest.env.clone()),
        ("settings".to_owned(), json!(manifest.settings).to_string()),
        ("success".to_owned(), manifest.success.describe()),
        ("actions allowed".to_owned(), manifest.budget.to_string()),
        ("policy".to_owned(), candidate.policy.to_string()),
        ("seed of the policy".to_owned(), candidate.seed.to_string()),
        ("manifest".to_owned(), receipt.manifest_hash.clone()),
        ("evaluated with".to_owned(), version(&info.code)),
        ("bundled with".to_owned(), version(&info.bundled_by)),
    ];
    rows.extend(info.made_from.iter().map(|(name, hash)| (name.clone(), hash.clone())));
    let rows: String =
        rows.iter().map(|(name, value)| format!("| {} | {} |\n", plain(name), code(value))).collect();
    format!("## What it depends on\n\n| | |\n|---|---|\n{rows}")
}

fn files(receipt: &Receipt) -> String {
    let mut text = "## Files\n\n| file | content |\n|---|---|\n\
        | `manifest.json` | the task: starts and goals of all pairs, budget, success test |\n\
        | `receipt.json` | the result of every pair, with digests of plans and states |\n"
        .to_owned();
    if !receipt.files.is_empty() {
        text += "| `model` | the model; `MODEL_CARD.md` describes it |\n";
    }
    text + "| `bundle.json` | versions, and what of the receipt is a path in this folder |\n| `SHA256SUMS` | the SHA-256 of every other file |\n"
}

/// `MODEL_CARD.md`, with metadata as the Hugging Face Hub reads it.
pub(super) fn card(receipt: &Receipt, info: &BundleInfo) -> Result<String, TaskError> {
    let Receipt { manifest, summary, .. } = receipt;
    let weights: String =
        receipt.files.iter().map(|(path, hash)| format!("| {} | {} |\n", code(path), code(hash))).collect();
    Ok(format!(
        "{meta}# {policy}\n\nA model for {env}. As {args} it reaches {rate} over {pairs} pairs of the {tier} tier (manifest {hash}).\n\n\
         License: {license}.\n\n## Files\n\n| file | SHA-256 |\n|---|---|\n{weights}",
        meta = metadata(receipt, info)?,
        policy = code(&receipt.policy),
        env = manifest.env,
        args = code(&receipt.candidate.policy.to_string()),
        rate = rate(summary),
        pairs = manifest.pairs.len(),
        tier = manifest.tier.name(),
        hash = code(receipt.manifest_hash.get(..12).unwrap_or_default()),
        license = info.license.as_deref().map_or_else(|| "not stated".to_owned(), plain),
    ))
}

fn rate(summary: &Summary) -> String {
    let [low, high] = summary.ci95;
    format!("{:.1} % ({low:.1} to {high:.1})", summary.success_rate)
}

/// A text as YAML takes it.
fn quoted(text: &str) -> serde_json::Result<String> {
    serde_json::to_string(&Json::from(text))
}

/// A text as code in a cell of a table.
fn code(text: &str) -> String {
    format!("`{}`", plain(text))
}

/// A text of one line without what ends a cell or code.
fn plain(text: &str) -> String {
    text.replace(['\n', '\r'], " ").replace('`', "'").replace('|', "/")
}
