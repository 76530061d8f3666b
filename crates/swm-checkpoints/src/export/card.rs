//! The model card: what a hub shows of the folder.

use std::fmt::Write as _;

use super::Exported;
use super::form::{Evaluation, Form, Trained};
use swm_files::remote::is_remote;
use swm_weights::Values;

/// `README.md`: metadata between lines of dashes, then text.
pub(super) fn text(form: &Form, exported: &Exported) -> String {
    let mut out = String::from("---\nlibrary_name: stable-worldmodel\ntags:\n- world-model\n");
    let _ = writeln!(out, "- {}", form.model);
    if let Some(env) = &form.env {
        // A string of JSON is one of YAML.
        let _ = writeln!(out, "environment: {}", serde_json::Value::from(env.as_str()));
    }
    // Only what the Hub can link to.
    let repository =
        form.dataset.as_ref().and_then(|dataset| dataset.path.to_str()?.strip_prefix("hf://datasets/"));
    if let Some([user, name, ..]) = repository.map(|rest| rest.split('/').collect::<Vec<_>>()).as_deref() {
        let _ = writeln!(out, "datasets:\n- {}", serde_json::Value::from(format!("{user}/{name}")));
    }
    out.push_str("---\n\n");
    let _ = writeln!(
        out,
        "# {} {}\n",
        form.model,
        form.env.as_deref().map_or(String::new(), |env| format!("for {env}"))
    );
    let from = match (&form.imported, form.step) {
        (Some(_), 0) => "an imported checkpoint".to_owned(),
        (_, step) => format!("step {step} of a training"),
    };
    let _ = writeln!(out, "A `{}`, written by `stable-worldmodel for Rust` from {from}.\n", exported.class);
    table(&mut out, rows(form, exported));
    if !form.scales.is_empty() {
        out.push_str("\n## Scales\n\nVectors are standardized; no other file says by which numbers.\n\n| column | mean | std |\n|---|---|---|\n");
        for (name, scale) in &form.scales {
            let _ = writeln!(out, "| `{name}` | {:?} | {:?} |", scale.mean, scale.std);
        }
    }
    if let Some(Evaluation { receipt, sha256 }) = &form.evaluation {
        let (manifest, summary) = (&receipt.manifest, &receipt.summary);
        let [low, high] = summary.ci95;
        let (tier, pairs) = (manifest.tier.name(), manifest.pairs.len());
        let _ = writeln!(
            out,
            "\n## Evaluation\n\n{:.1} % ({low:.1} to {high:.1}) of {pairs} pairs of start and goal in `{}`, {tier} tier{}.\n",
            summary.success_rate,
            manifest.env,
            match summary.solved_at_start {
                0 => String::new(),
                count => format!("; {count} are a success before the first action"),
            }
        );
        let rows = [
            ("policy", format!("`{}`", receipt.policy)),
            ("manifest", receipt.manifest_hash.clone()),
            ("SHA-256 of the receipt", sha256.clone()),
        ];
        table(&mut out, rows);
    }
    out.push_str("\n## Use\n\n```python\nfrom stable_worldmodel.wm.utils import load_pretrained\n\n");
    out.push_str("model = load_pretrained(\"FOLDER/weights.pt\")  # below $STABLEWM_HOME/checkpoints, or an absolute path\n```\n\n");
    out.push_str("```text\nswm import FOLDER --out RUN\n");
    let policy = match form.model.as_str() {
        "lewm" | "pldm" | "dino-wm" => "mpc:RUN",
        "tdmpc2" => "tdmpc2:RUN",
        _ => "policy:RUN",
    };
    let _ = writeln!(out, "swm eval {} --policy {policy}\n```", form.env.as_deref().unwrap_or("ENV"));
    if !exported.notes.is_empty() || !exported.left_out.is_empty() {
        out.push_str("\n## Notes\n\n");
        for note in &exported.notes {
            let _ = writeln!(out, "- {note}");
        }
        for part in &exported.left_out {
            let _ = writeln!(out, "- `{part}` of the training is left out: the model does not need it");
        }
    }
    out
}

/// Names and values as a table.
fn table(out: &mut String, rows: impl IntoIterator<Item = (&'static str, String)>) {
    out.push_str("| what | value |\n|---|---|\n");
    for (name, value) in rows {
        let _ = writeln!(out, "| {name} | {} |", value.replace('|', "\\|"));
    }
}

fn rows(form: &Form, exported: &Exported) -> Vec<(&'static str, String)> {
    let parameters = form.tensors.iter().map(|(_, shape, values)| match values {
        Values::Floats(_) => shape.iter().product::<usize>(),
        Values::Integers(_) | Values::Bools(_) => 0,
    });
    let mut rows =
        vec![("tensors", form.tensors.len().to_string()), ("values", parameters.sum::<usize>().to_string())];
    rows.extend(form.facts.iter().cloned());
    if let Some(version) = form.transformers {
        rows.push(("names of the encoder's tensors", format!("transformers {version}")));
    }
    if let Some(env) = &form.env {
        rows.push(("environment", format!("`{env}`")));
    }
    if let Some(Trained { path, episodes, rows: count }) = &form.dataset {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        let name = if is_remote(path) { path.to_string_lossy() } else { name };
        rows.push(("dataset", format!("`{name}`, {episodes} episodes, {count} rows")));
    }
    if let Some(imported) = &form.imported {
        rows.push(("imported from", format!("`{}` (SHA-256 {})", imported.source, imported.sha256)));
    }
    rows.push(("SHA-256 of `weights.pt`", exported.sha256.clone()));
    rows.push(("SHA-256 of the run's weights", form.run_sha256.clone()));
    rows
}
