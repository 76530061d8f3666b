//! Boards: bundles on one page, sorted by their manifests, with intervals, paired differences, and reported figures beside reproduced ones.

mod page;

use std::collections::BTreeMap;

use serde::Serialize;
use swm_core::evaluate::{PairedRuns, Summary};

use crate::bundle::Bundle;
use crate::error::TaskError;
use crate::evaluation::{Side, Verification, compare, contradiction};

pub use page::{DATA, PAGE, holds_board, write_board};

/// Bundles side by side.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Board {
    /// What the page is called.
    pub title: String,
    /// Results by manifest, in the order of environment and tier.
    pub groups: Vec<Group>,
    /// Reported figures beside reproduced ones, where bundles have some.
    pub reported: Vec<Reproduction>,
}

/// Results on one manifest.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Group {
    /// Hash of the manifest.
    pub manifest_hash: String,
    /// The environment's id.
    pub env: String,
    /// The tier's name.
    pub tier: String,
    /// Pairs of start and goal.
    pub pairs: usize,
    /// Actions allowed per episode.
    pub budget: u64,
    /// The success test.
    pub success: String,
    /// The bundles, the highest success rate first.
    pub rows: Vec<Row>,
}

/// One bundle.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Row {
    /// What the bundle is called.
    pub name: String,
    /// SHA-256 of its list of hashes.
    pub hash: String,
    /// The policy as it is asked for.
    pub policy: String,
    /// Seed of its noise.
    pub policy_seed: u64,
    /// What came out.
    pub summary: Summary,
    /// The first row of the group against this one, pair by pair.
    pub test: Option<PairedRuns>,
    /// Reference policies on the same pairs.
    pub references: Vec<ReferenceRow>,
    /// Version of the package that evaluated it.
    pub version: String,
    /// What running it again showed, where that was asked for.
    pub rerun: Option<Rerun>,
}

/// A reference policy of a bundle.
#[derive(Clone, Debug, Serialize)]
pub struct ReferenceRow {
    /// Its role.
    pub role: String,
    /// What came out.
    pub summary: Summary,
}

/// What a repetition showed.
#[derive(Clone, Debug, Serialize)]
pub struct Rerun {
    /// Whether everything is equal, to the last bit.
    pub equal: bool,
    /// Which parts differ, and how.
    pub differences: Vec<String>,
    /// The success rate of the repetition, in percent.
    pub success_rate: f64,
}

/// A reported figure and what came out here.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Reproduction {
    /// What the bundle is called.
    pub name: String,
    /// The environment's id.
    pub env: String,
    /// The tier's name.
    pub tier: String,
    /// The reported success rate, in percent.
    pub reported: f64,
    /// Where it is published.
    pub source: Option<String>,
    /// What came out here.
    pub summary: Summary,
    /// Reproduced minus reported, in percentage points.
    pub difference: f64,
    /// Whether the reported rate lies in the 95 % interval of the reproduced one.
    pub is_within: bool,
}

impl Board {
    /// Sorts bundles, each with what running it again showed.
    ///
    /// # Errors
    ///
    /// No bundle, one that is given twice, or one whose receipt contradicts itself.
    pub fn new(title: &str, bundles: &[(Bundle, Option<Verification>)]) -> Result<Self, TaskError> {
        let mut known: BTreeMap<&str, &Bundle> = BTreeMap::new();
        for (bundle, _) in bundles {
            if let Some(reason) = contradiction(&bundle.receipt) {
                return Err(
                    format!("bundle {}: its receipt was edited: {reason}", bundle.folder.display()).into()
                );
            }
            if let Some(other) = known.insert(&bundle.hash, bundle) {
                let (one, other) = (other.folder.display(), bundle.folder.display());
                return Err(format!("{one} and {other} are one bundle; give it once").into());
            }
        }
        let names = names(bundles);
        let mut by_manifest: BTreeMap<(&str, &str, &str), Vec<usize>> = BTreeMap::new();
        for (index, (Bundle { receipt, .. }, _)) in bundles.iter().enumerate() {
            let manifest = &receipt.manifest;
            let key = (manifest.env.as_str(), manifest.tier.name(), receipt.manifest_hash.as_str());
            by_manifest.entry(key).or_default().push(index);
        }
        let groups = by_manifest.into_values().map(|members| group(members, bundles, &names));
        let reported =
            bundles.iter().zip(&names).filter_map(|((bundle, _), name)| reproduction(bundle, name));
        let mut reported: Vec<Reproduction> = reported.collect();
        reported.sort_by(|a, b| (&a.env, &a.tier, &a.name).cmp(&(&b.env, &b.tier, &b.name)));
        Ok(Self { title: title.to_owned(), groups: groups.collect::<Result<_, _>>()?, reported })
    }

    /// The names of bundles that differ when they are run again.
    pub fn differing(&self) -> Vec<&str> {
        let rows = self.groups.iter().flat_map(|group| &group.rows);
        rows.filter(|row| row.rerun.as_ref().is_some_and(|rerun| !rerun.equal))
            .map(|row| row.name.as_str())
            .collect()
    }
}

/// What each bundle is called: its folder's name, with a number where an earlier one has the same.
fn names(bundles: &[(Bundle, Option<Verification>)]) -> Vec<String> {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let unique = |(bundle, _): &(Bundle, Option<Verification>)| {
        let name = bundle.name();
        let count = counts.entry(name.clone()).or_default();
        *count += 1;
        if *count == 1 { name } else { format!("{name} ({count})") }
    };
    bundles.iter().map(unique).collect()
}

fn group(
    mut members: Vec<usize>,
    bundles: &[(Bundle, Option<Verification>)],
    names: &[String],
) -> Result<Group, TaskError> {
    let rate = |index: usize| bundles[index].0.receipt.summary.success_rate;
    members.sort_by(|&a, &b| rate(b).total_cmp(&rate(a)).then_with(|| names[a].cmp(&names[b])));
    let side = |&index: &usize| Side::new(names[index].clone(), vec![bundles[index].0.receipt.clone()]);
    let sides: Vec<Side> = members.iter().map(side).collect::<Result<_, _>>()?;
    let tests = compare(&sides)?.into_iter().map(|side| side.test);
    let rows =
        members.iter().zip(tests).map(|(&index, test)| row(&bundles[index], &names[index], test)).collect();
    let receipt = &bundles[members[0]].0.receipt;
    Ok(Group {
        manifest_hash: receipt.manifest_hash.clone(),
        env: receipt.manifest.env.clone(),
        tier: receipt.manifest.tier.name().to_owned(),
        pairs: receipt.manifest.pairs.len(),
        budget: receipt.manifest.budget,
        success: receipt.manifest.success.describe(),
        rows,
    })
}

fn row((bundle, rerun): &(Bundle, Option<Verification>), name: &str, test: Option<PairedRuns>) -> Row {
    let Bundle { info, receipt, hash, .. } = bundle;
    let references = receipt.references.iter();
    Row {
        name: name.to_owned(),
        hash: hash.clone(),
        policy: info.policy.clone(),
        policy_seed: receipt.candidate.seed,
        summary: receipt.summary.clone(),
        test,
        references: references
            .map(|known| ReferenceRow { role: known.role.name().to_owned(), summary: known.summary.clone() })
            .collect(),
        version: receipt.code.version.clone(),
        rerun: rerun.as_ref().map(|verification| Rerun {
            equal: verification.equal,
            differences: differences(verification),
            success_rate: verification.summary.success_rate,
        }),
    }
}

fn differences(verification: &Verification) -> Vec<String> {
    let part = |part| serde_json::to_value(part).ok().and_then(|part| part.as_str().map(str::to_owned));
    let named = verification.differences.iter();
    named.map(|(which, reason)| format!("{}: {reason}", part(which).unwrap_or_default())).collect()
}

fn reproduction(bundle: &Bundle, name: &str) -> Option<Reproduction> {
    let Bundle { info, receipt, .. } = bundle;
    let reported = info.reported.as_ref()?;
    let (summary, [low, high]) = (receipt.summary.clone(), receipt.summary.ci95);
    Some(Reproduction {
        name: name.to_owned(),
        env: receipt.manifest.env.clone(),
        tier: receipt.manifest.tier.name().to_owned(),
        reported: reported.success_rate,
        source: reported.source.clone(),
        difference: summary.success_rate - reported.success_rate,
        is_within: (low..=high).contains(&reported.success_rate),
        summary,
    })
}
