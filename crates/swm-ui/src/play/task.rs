//! A pair of a manifest or a receipt, with the policy that is to act in it.

use std::sync::Arc;

use serde_json::{Map, Value as Json};
use swm_core::view::Transform;
use swm_core::{Manifest, PolicyArgs};
use swm_tasks::distractors;
use swm_tasks::evaluation::{Candidate, Receipt, Reference};

use super::message::{Pair, Run};
use crate::error::Refusal;
use crate::server::App;

/// A pair of a manifest, judged as the manifest says.
pub(super) struct Task {
    pub manifest: Manifest,
    pub index: usize,
    /// Who acts; nobody where a manifest alone is given.
    pub policy: Option<PolicyArgs>,
    /// Of the policy's noise.
    pub policy_seed: u64,
    /// The manifest's distractors.
    pub transform: Option<Arc<dyn Transform>>,
}

impl Task {
    /// Reads the manifest, or the receipt that holds one.
    ///
    /// # Errors
    ///
    /// There is no such file, run or pair; a policy whose files are outside of the given paths.
    pub(super) fn read(app: &App, pair: &Pair) -> Result<Self, Refusal> {
        let (manifest, policy, references) = stored(app.roots.read_result(&app.roots.resolve(&pair.id)?)?)?;
        manifest.check()?;
        let candidate = match pair.run {
            Run::Policy => policy,
            Run::Reference(index) => {
                let none = || Refusal::bad(format!("the receipt holds no reference {index}"));
                Some(references.into_iter().nth(index).ok_or_else(none)?.candidate)
            }
            Run::Oracle => {
                let policy = policy.unwrap_or_else(|| Candidate::new(PolicyArgs::new("cem", Map::new())));
                Some(match app.registry.env(&manifest.env) {
                    Ok(entry) => policy.oracle(&app.registry, entry, &manifest),
                    // An unknown environment is an error when it is made.
                    Err(_) => policy,
                })
            }
        };
        let (policy, policy_seed) =
            candidate.map_or((None, 0), |candidate| (Some(candidate.policy), candidate.seed));
        policy.iter().try_for_each(|policy| app.roots.check_policy(policy))?;
        let transform = distractors::parse_all(&manifest.distractors)?;
        Ok(Self { manifest, index: pair.index, policy, policy_seed, transform })
    }
}

/// A manifest, the evaluated policy and the reference policies of a file of results: a manifest alone has neither.
fn stored(content: Json) -> Result<(Manifest, Option<Candidate>, Vec<Reference>), serde_json::Error> {
    if content.get("receipt").is_some() {
        let Receipt { manifest, candidate, references, .. } = serde_json::from_value(content)?;
        return Ok((manifest, Some(candidate), references));
    }
    let mut content = content;
    if let Json::Object(map) = &mut content {
        map.remove("hash");
    }
    Ok((serde_json::from_value(content)?, None, Vec::new()))
}
