//! `swm inspect`: what a dataset holds.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Map, Value as Json, json};
use swm_core::{FieldKind, Metadata, Registry};
use swm_tasks::request::open_dataset_with;

use super::opening::OpenArgs;
use super::output::{counted, table};
use super::{Failure, Output};

/// Show format, episodes, columns and metadata of a dataset.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  swm inspect pusht.h5\n  swm inspect pusht.h5 --json\n  swm inspect parts    (a folder of parts of `swm collect --shard`)"
)]
pub(super) struct Inspect {
    /// The dataset.
    file: PathBuf,
    #[command(flatten)]
    opening: OpenArgs,
}

impl Inspect {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let dataset = open_dataset_with(registry, &self.file, &self.opening.options()?)?;
        let lengths = &dataset.info().lengths;
        let steps: usize = lengths.iter().sum();
        let fields = dataset.schema().fields();
        let columns: Map<_, _> = fields
            .iter()
            .map(|field| (field.name.clone(), json!({"dtype": field.dtype.name(), "shape": field.shape})))
            .collect();
        let result = json!({
            "format": dataset.info().format,
            "episodes": lengths.len(),
            "steps": steps,
            "columns": columns,
            "episode_lengths": {
                "min": lengths.iter().min(),
                "max": lengths.iter().max(),
            },
            "metadata": dataset.metadata(),
            "runs": dataset.info().runs.iter().map(|(first, run)| json!({"first_episode": first, "metadata": run})).collect::<Vec<_>>(),
            "skipped": *dataset.info().skipped,
            "mapping": dataset.info().mapping.iter().cloned().collect::<BTreeMap<_, _>>(),
            "notes": *dataset.info().notes,
            "checkpoint_rows": dataset.metadata().and_then(|metadata| metadata.checkpoints),
        });
        output.result(&result, || {
            let rows: Vec<_> = fields
                .iter()
                .map(|field| {
                    let per = if field.kind == FieldKind::Episode { "episode" } else { "step" };
                    vec![
                        field.name.clone(),
                        field.dtype.to_string(),
                        format!("{:?}", field.shape),
                        per.to_owned(),
                    ]
                })
                .collect();
            let range = match (lengths.iter().min(), lengths.iter().max()) {
                (Some(min), Some(max)) if min == max => format!(" of {min} rows"),
                (Some(min), Some(max)) => format!(" of {min} to {max} rows"),
                _ => String::new(),
            };
            let mut text = format!(
                "{}: {}, {}{range}, {}\n\n{}",
                self.file.display(),
                dataset.info().format,
                counted(lengths.len(), "episode"),
                counted(steps, "row"),
                table(&["column", "dtype", "shape", "per"], rows),
            );
            for (new, old) in dataset.info().mapping.iter().filter(|(new, old)| new != old) {
                text += &format!("{new} ← {old}\n");
            }
            for note in &*dataset.info().notes {
                text += &format!("note: {note}\n");
            }
            for (name, reason) in &*dataset.info().skipped {
                text += &format!("skipped `{name}`: {reason}\n");
            }
            text.push('\n');
            for (first, run) in &*dataset.info().runs {
                let Metadata { env, policy, seed, .. } = run;
                text += &format!("from episode {first} on: {env}, policy `{policy}`, seed {seed}");
                if let Some(names) = &run.variation {
                    text += &format!(", factors sampled: {}", names.join(", "));
                }
                text.push('\n');
                text += &details(run);
            }
            if let Some(rows) = dataset.metadata().and_then(|metadata| metadata.checkpoints) {
                text += &format!(
                    "replayable: states every {rows} rows, from which images are rendered when read\n"
                );
            }
            if let Some(part) = dataset.metadata().and_then(|metadata| metadata.part) {
                text += &format!(
                    "part {}/{} of {} episodes: {} of its {}\n",
                    part.shard,
                    part.of,
                    part.total,
                    lengths.len(),
                    part.end - part.first
                );
            }
            if dataset.info().runs.is_empty() {
                text += "no metadata: not recorded by this program\n";
            }
            text
        })
    }
}

/// What a run was made with, beyond environment, policy and seed: a line per kind.
fn details(run: &Metadata) -> String {
    let listed = |values: &mut dyn Iterator<Item = (&String, &Json)>| {
        values.map(|(name, value)| format!("{name}={value}")).collect::<Vec<_>>().join(", ")
    };
    let packages = run.packages.iter().map(|(name, version)| format!("{name} {version}"));
    let lines = [
        ("settings", listed(&mut run.settings.iter())),
        ("factors set", listed(&mut run.variation_values.iter())),
        ("made by", packages.collect::<Vec<_>>().join(", ")),
    ];
    lines
        .iter()
        .filter(|(_, text)| !text.is_empty())
        .map(|(name, text)| format!("  {name}: {text}\n"))
        .collect()
}
