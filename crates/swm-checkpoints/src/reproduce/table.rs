//! What came out, beside what was reported.

use std::path::{Path, PathBuf};

use serde::Serialize;
use swm_core::evaluate::Summary;
use swm_tasks::evaluation::{Receipt, Role};
use swm_tasks::request::{TaskError, cannot};
use swm_tasks::text_file::replace_text;

use super::needs::Need;
use super::recipe::{Checkpoint, Figure, Recipe};

/// A reproduction: what it needed, and a row for each figure.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Reproduced {
    /// The recipe's name.
    pub recipe: String,
    /// The environment.
    pub env: String,
    /// The checkpoint.
    pub checkpoint: Checkpoint,
    /// The folder that downloads were looked for in.
    pub folder: PathBuf,
    /// What it needs.
    pub needs: Vec<Need>,
    /// The run that was imported; `None`: nothing was evaluated.
    pub run: Option<PathBuf>,
    /// Ours and theirs.
    pub rows: Vec<Row>,
    /// The file of this table.
    pub file: Option<PathBuf>,
}

/// A reported figure and what came out here.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Row {
    /// The figure's name.
    pub figure: String,
    /// The protocol in words.
    pub protocol: String,
    /// The pairs of all manifests together.
    pub ours: Summary,
    /// Standard deviation of our rates over the manifests, where there are several, in percent.
    pub std: Option<f64>,
    /// The reported rate in percent.
    pub reported: f64,
    /// Its standard deviation over repetitions, where that was reported.
    pub reported_std: Option<f64>,
    /// Ours minus the reported rate, in percentage points.
    pub difference: f64,
    /// Whether the reported rate lies in the 95 % interval of ours.
    pub is_within: bool,
    /// Where it was reported.
    pub source: String,
    /// The manifests one by one.
    pub repetitions: Vec<Repetition>,
}

/// The result on one manifest.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Repetition {
    /// The seed of its pairs.
    pub seed: u64,
    /// Its receipt.
    pub receipt: PathBuf,
    /// Hash of the manifest.
    pub manifest_hash: String,
    /// Pairs.
    pub pairs: usize,
    /// Success of the model, in percent.
    pub success_rate: f64,
    /// Success of random actions on the same pairs, in percent.
    pub random: Option<f64>,
}

impl Reproduced {
    pub(super) fn new(recipe: &Recipe, folder: &Path, needs: Vec<Need>) -> Self {
        Self {
            recipe: recipe.name.clone(),
            env: recipe.env.clone(),
            checkpoint: recipe.checkpoint.clone(),
            folder: folder.to_owned(),
            needs,
            run: None,
            rows: Vec::new(),
            file: None,
        }
    }

    /// Writes the table into a folder.
    pub(super) fn write(&mut self, folder: &Path) -> Result<(), TaskError> {
        let path = folder.join("reproduction.json");
        self.file = Some(path.clone());
        let text = serde_json::to_string_pretty(self)?;
        Ok(replace_text(&path, &(text + "\n")).map_err(cannot("write", &path))?)
    }
}

impl Row {
    pub(super) fn new(figure: &Figure, receipts: &[(u64, PathBuf, Receipt)]) -> Self {
        let ours = Summary::of(receipts.iter().flat_map(|(.., receipt)| &receipt.episodes));
        let repetitions: Vec<Repetition> = receipts.iter().map(Repetition::new).collect();
        let rates: Vec<f64> = repetitions.iter().map(|one| one.success_rate).collect();
        let [low, high] = ours.ci95;
        Self {
            figure: figure.name.clone(),
            protocol: figure.protocol.clone(),
            difference: ours.success_rate - figure.reported,
            is_within: (low..=high).contains(&figure.reported),
            ours,
            std: sample_std(&rates),
            reported: figure.reported,
            reported_std: figure.std,
            source: figure.source.clone(),
            repetitions,
        }
    }
}

impl Repetition {
    fn new((seed, path, receipt): &(u64, PathBuf, Receipt)) -> Self {
        let random = receipt.references.iter().find(|reference| reference.role == Role::Random);
        Self {
            seed: *seed,
            receipt: path.clone(),
            manifest_hash: receipt.manifest_hash.clone(),
            pairs: receipt.episodes.len(),
            success_rate: receipt.summary.success_rate,
            random: random.map(|random| random.summary.success_rate),
        }
    }
}

/// The standard deviation of two or more numbers, with the divisor n - 1.
fn sample_std(values: &[f64]) -> Option<f64> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    (values.len() > 1).then(|| (squares / (n - 1.0)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// CLEAR-LeWM prints 86.33 ± 2.08 for rates of 84, 87 and 88.
    #[test]
    fn the_deviation_is_that_of_samples() {
        let std = sample_std(&[84.0, 87.0, 88.0]).unwrap();
        assert!((std - 2.0817).abs() < 1e-4, "{std}");
        assert_eq!(sample_std(&[84.0]), None);
    }
}
