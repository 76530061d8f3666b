//! `swm inspect`: what a dataset holds.

use std::path::PathBuf;

use clap::Args;
use serde_json::Value as Json;
use swm_core::{Cancel, FieldKind, Metadata, Registry};
use swm_tasks::request::{self, Extremes, Inspection, Request as _};

use super::opening::OpenArgs;
use super::output::{counted, table};
use super::reporter::Reporter;
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
        let request = request::Inspect { dataset: self.file, opening: self.opening.options()? };
        let found = request.run(registry, &mut Reporter::new(output, Cancel::new()))?;
        output.result(&found, || format!("{}: {}", request.dataset.display(), text(&found)))
    }
}

fn text(found: &Inspection) -> String {
    let columns = found.columns.iter().map(|field| {
        let per = if field.kind == FieldKind::Episode { "episode" } else { "step" };
        vec![field.name.clone(), field.dtype.to_string(), format!("{:?}", field.shape), per.to_owned()]
    });
    let range = match found.episode_lengths {
        Extremes { min: Some(min), max: Some(max), .. } if min == max => format!(" of {min} rows"),
        Extremes { min: Some(min), max: Some(max), .. } => format!(" of {min} to {max} rows"),
        _ => String::new(),
    };
    let mut text = format!(
        "{}, {}{range}, {}\n\n{}",
        found.format,
        counted(found.episodes, "episode"),
        counted(found.steps, "row"),
        table(&["column", "dtype", "shape", "per"], columns),
    );
    for (new, old) in found.mapping.iter().filter(|(new, old)| new != old) {
        text += &format!("{new} ← {old}\n");
    }
    for note in &found.notes {
        text += &format!("note: {note}\n");
    }
    for (name, reason) in &found.skipped {
        text += &format!("skipped `{name}`: {reason}\n");
    }
    text.push('\n');
    for run in &found.runs {
        let Metadata { env, policy, seed, .. } = &run.metadata;
        text += &format!("from episode {} on: {env}, policy `{policy}`, seed {seed}", run.first_episode);
        if let Some(names) = &run.metadata.variation {
            text += &format!(", factors sampled: {}", names.join(", "));
        }
        text.push('\n');
        text += &details(&run.metadata);
    }
    if let Some(rows) = found.checkpoint_rows {
        text += &format!("replayable: states every {rows} rows, from which images are rendered when read\n");
    }
    if let Some(part) = found.metadata.as_ref().and_then(|metadata| metadata.part.as_ref()) {
        text += &format!(
            "part {}/{} of {} episodes: {} of its {}\n",
            part.shard,
            part.of,
            part.total,
            found.episodes,
            part.end - part.first
        );
    }
    if found.runs.is_empty() {
        text += "no metadata: not recorded by this program\n";
    }
    text
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
