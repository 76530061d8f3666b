//! `swm zoo`: trained models that are shipped.

use clap::Args;
use serde_json::json;
use swm_tasks::zoo::{self, ZooModel};

use super::output::{key_values, table};
use super::rates::percent;
use super::{Failure, Output, usage};

/// List trained models that are installed, or show one.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm zoo
  swm zoo tworoom-gcbc
  swm eval swm/TwoRoom-v2 --policy zoo:tworoom-gcbc --image-size 64x64
  swm verify-result $(swm zoo tworoom-gcbc --path)

A model is a folder with its card, its receipt (manifest, success rate with its interval, hashes), its license and the commands that made \
it. `zoo:NAME` is a policy, and takes its settings; where a run is named, `zoo:NAME` is that of the model: `mpc:zoo:NAME`.

Models are looked for in the Python package stable-worldmodel-zoo, in the folder `zoo` of the data folder, and in `share/swm/zoo` beside \
the program's folder.")]
pub(super) struct Zoo {
    /// The model to show. Default: all, in a table.
    name: Option<String>,
    /// Print the model's folder alone.
    #[arg(long, requires = "name")]
    path: bool,
}

impl Zoo {
    pub(super) fn run(self, output: &Output) -> Result<(), Failure> {
        match self.name {
            Some(name) => show(name.strip_prefix("zoo:").unwrap_or(&name), self.path, output),
            None => list(output),
        }
    }
}

fn show(name: &str, path: bool, output: &Output) -> Result<(), Failure> {
    let folder = zoo::find(name).map_err(usage)?;
    if path {
        return output.result(&json!({ "folder": folder }), || format!("{}\n", folder.display()));
    }
    let model = ZooModel::open(&folder)?;
    output.result(&model, || {
        let about = key_values(&[
            ("model", format!("zoo:{}", model.name)),
            ("what it is", model.about.clone()),
            ("environment", model.env.clone()),
            ("policy", model.policy.clone()),
            ("success", rate(&model)),
            ("license", model.license.clone()),
            ("size", megabytes(model.bytes)),
            ("card", model.card.display().to_string()),
            ("receipt", model.receipt.display().to_string()),
            ("hash", model.hash.clone()),
        ]);
        let steps: String = model.steps.iter().map(|step| format!("  swm {step}\n")).collect();
        format!("{}\n\nmade by\n{steps}", about.trim_end())
    })
}

fn list(output: &Output) -> Result<(), Failure> {
    let mut models = Vec::new();
    for (name, folder) in zoo::all() {
        match ZooModel::open(&folder) {
            Ok(model) => models.push(model),
            Err(reason) => output.note(format!("note: zoo:{name} is left out: {reason}")),
        }
    }
    if models.is_empty() {
        let folders: Vec<String> = zoo::folders().iter().map(|folder| folder.display().to_string()).collect();
        output.note(format!("no model is installed; {}; looked in {}", zoo::advice(), folders.join(", ")));
    }
    output.result(&models, || {
        let row = |model: &ZooModel| {
            let name = format!("zoo:{}", model.name);
            vec![
                name,
                model.env.clone(),
                rate(model),
                megabytes(model.bytes),
                model.license.clone(),
                model.about.clone(),
            ]
        };
        let rows = models.iter().map(row);
        table(&["model", "environment", "success", "size", "license", "what it is"], rows)
    })
}

fn rate(model: &ZooModel) -> String {
    format!("{} of {} pairs, {} tier", percent(model.success_rate, model.ci95), model.pairs, model.tier)
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}
