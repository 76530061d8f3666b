//! In what two results differ: the policy, its settings and files, the environment, the code, and what came out.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use serde_json::{Map, Value as Json};
use swm_core::PolicyArgs;

use super::receipt::Receipt;

/// One entry in which two results differ.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Difference {
    /// What differs: `policy`, a setting of it, `policy_seed`, `weights`, `manifest`, `physics`, …
    pub what: String,
    /// In the first result; null: it has none.
    pub first: Json,
    /// In the other one.
    pub this: Json,
}

impl Difference {
    fn of(what: impl Into<String>, first: impl Into<Json>, this: impl Into<Json>) -> Option<Self> {
        let (what, first, this) = (what.into(), first.into(), this.into());
        (first != this).then_some(Self { what, first, this })
    }
}

/// In what the evaluations of two receipts differ, whatever came out: nothing where one repeats the other, by the same program or
/// another version of it. Files are told by their content, not by where they are.
pub fn differences(first: &Receipt, this: &Receipt) -> Vec<Difference> {
    let (one, other) = (policy_of(first), policy_of(this));
    let mut all = vec![Difference::of("policy", one.name.clone(), other.name.clone())];
    all.extend(settings(&one, &other).into_iter().map(Some));
    let (then, now) = (&first.fingerprints, &this.fingerprints);
    all.push(Difference::of("policy_seed", first.candidate.seed, this.candidate.seed));
    all.push(Difference::of("weights", hashes(&first.files), hashes(&this.files)));
    all.push(Difference::of("plan_steps", first.plan_steps, this.plan_steps));
    all.push(Difference::of("manifest", first.manifest_hash.clone(), this.manifest_hash.clone()));
    if first.receipt.min(this.receipt) >= 2 {
        all.push(Difference::of("tables", then.tables.clone(), now.tables.clone()));
    }
    all.push(Difference::of("physics", then.physics.clone(), now.physics.clone()));
    all.push(Difference::of("images", then.images.clone(), now.images.clone()));
    all.into_iter().flatten().collect()
}

/// As [`differences`], and in what came out: episodes and reference policies, to the last bit. Wall times may differ.
pub fn result_differences(first: &Receipt, this: &Receipt) -> Vec<Difference> {
    let mut all = differences(first, this);
    let count = first.episodes.len().max(this.episodes.len());
    let differing = (0..count)
        .filter(|&pair| match (first.episodes.get(pair), this.episodes.get(pair)) {
            (Some(one), Some(other)) => !one.is_repeated_by(other),
            _ => true,
        })
        .count();
    if differing > 0 {
        let rate = |receipt: &Receipt| receipt.summary.success_rate;
        let what = format!("outcomes ({differing} of {count} episodes)");
        all.push(Difference { what, first: rate(first).into(), this: rate(this).into() });
    }
    let references = |receipt: &Receipt| -> BTreeMap<&str, (Json, Json)> {
        let result = |value| serde_json::to_value(value).unwrap_or_default();
        let references = receipt.references.iter();
        references
            .map(|other| {
                let episodes = serde_json::to_value(&other.episodes).unwrap_or_default();
                (other.role.name(), (result(&other.candidate), episodes))
            })
            .collect()
    };
    let (one, other) = (references(first), references(this));
    let names: BTreeSet<&str> = one.keys().chain(other.keys()).copied().collect();
    for name in names.into_iter().filter(|name| one.get(name) != other.get(name)) {
        let policy = |known: Option<&(Json, Json)>| known.map_or(Json::Null, |(policy, _)| policy.clone());
        let what = format!("reference {name}");
        all.push(Difference { what, first: policy(one.get(name)), this: policy(other.get(name)) });
    }
    all
}

/// In which settings two policies differ.
pub(super) fn settings(one: &PolicyArgs, other: &PolicyArgs) -> Vec<Difference> {
    let positional = Difference::of("arguments", one.positional.clone(), other.positional.clone());
    let names: BTreeSet<&String> = one.named.keys().chain(other.named.keys()).collect();
    let value = |named: &Map<String, Json>, name: &str| named.get(name).cloned().unwrap_or_default();
    let named = names
        .into_iter()
        .filter_map(|name| Difference::of(name, value(&one.named, name), value(&other.named, name)));
    positional.into_iter().chain(named).collect()
}

/// The policy with as many of its settings as the receipt has: a policy of the registry describes itself by name and settings.
fn policy_of(receipt: &Receipt) -> PolicyArgs {
    let given = &receipt.candidate.policy;
    match PolicyArgs::parse(&receipt.policy) {
        Ok(described) if described.name == given.name && described.positional == given.positional => {
            let mut policy = given.clone();
            for (name, value) in described.named {
                policy.named.entry(name).or_insert(value);
            }
            policy
        }
        _ => given.clone(),
    }
}

/// The hashes of files, in order; the names differ from machine to machine.
pub(super) fn hashes(files: &BTreeMap<String, String>) -> Vec<String> {
    let mut all: Vec<String> = files.values().cloned().collect();
    all.sort();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_of_one_side_differ_from_none() {
        let of = |text: &str| PolicyArgs::parse(text).unwrap();
        assert!(settings(&of("cem:samples=3"), &of("cem:samples=3")).is_empty());
        let found = settings(&of("cem:samples=3,clip=true"), &of("cem:samples=4"));
        let told: Vec<(&str, &Json, &Json)> =
            found.iter().map(|one| (one.what.as_str(), &one.first, &one.this)).collect();
        assert_eq!(told, [("clip", &true.into(), &Json::Null), ("samples", &3.into(), &4.into())]);
        assert_eq!(settings(&of("mpc:a"), &of("mpc:b"))[0].what, "arguments");
    }

    #[test]
    fn files_are_their_content() {
        let files = |name: &str, hash: &str| BTreeMap::from([(name.to_owned(), hash.to_owned())]);
        assert_eq!(hashes(&files("/here/w.pt", "a")), hashes(&files("/there/w.pt", "a")));
        assert_ne!(hashes(&files("w.pt", "a")), hashes(&files("w.pt", "b")));
    }
}
