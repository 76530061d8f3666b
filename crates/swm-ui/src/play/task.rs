//! A pair of a manifest or a receipt, with the policy that is to act in it.

use std::sync::Arc;

use serde::Deserialize;
use serde_json::{Map, Value as Json};
use swm_core::view::Transform;
use swm_core::{Manifest, PolicyArgs};

use super::message::{Pair, Run};
use crate::commands::Candidate;
use crate::error::Refusal;
use crate::roots::read_result;
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

#[derive(Deserialize)]
struct Stored {
    policy: PolicyArgs,
    #[serde(default)]
    seed: u64,
}

impl Task {
    /// Reads the manifest, or the receipt that holds one.
    ///
    /// # Errors
    ///
    /// There is no such file, run or pair; a policy whose files are outside of the given paths.
    pub(super) fn read(app: &App, pair: &Pair) -> Result<Self, Refusal> {
        let mut content = read_result(&app.roots.resolve(&pair.id)?)?;
        let stored = |json: Option<&Json>| -> Result<Option<Candidate>, Refusal> {
            let stored = json.cloned().map(serde_json::from_value::<Stored>).transpose()?;
            Ok(stored.map(|Stored { policy, seed }| (policy, seed)))
        };
        let policy = stored(content.get("candidate"))?;
        let reference = match pair.run {
            Run::Reference(index) => {
                let all = content.get("references").or_else(|| content.get("beside"));
                stored(all.and_then(|all| all.get(index)).and_then(|reference| reference.get("candidate")))?
            }
            _ => None,
        };
        if let Some(within) = content.get_mut("manifest") {
            content = within.take();
        }
        if let Json::Object(map) = &mut content {
            map.remove("hash");
        }
        let manifest: Manifest = serde_json::from_value(content)?;
        manifest.check()?;
        let candidate = match pair.run {
            Run::Policy => policy,
            Run::Reference(index) => Some(
                reference.ok_or_else(|| Refusal::bad(format!("the receipt holds no reference {index}")))?,
            ),
            Run::Oracle => {
                let policy = policy.unwrap_or_else(|| (PolicyArgs::new("cem", Map::new()), 0));
                Some(app.commands()?.oracle(&app.registry, &manifest, policy))
            }
        };
        let (policy, policy_seed) = candidate.map_or((None, 0), |(policy, seed)| (Some(policy), seed));
        policy.iter().try_for_each(|policy| app.roots.check_policy(policy))?;
        let transform = match manifest.distractors.is_empty() {
            true => None,
            false => app.commands()?.distractors(&manifest.distractors)?,
        };
        Ok(Self { manifest, index: pair.index, policy, policy_seed, transform })
    }
}
