//! Running a receipt again: is the result the same, and if not, which part of it has changed?

use std::collections::BTreeMap;

use serde::Serialize;
use swm_core::evaluate::{EpisodeResult, Summary};
use swm_core::{EnvEntry, PolicyArgs, Registry};

use super::difference::settings;
use super::files::env_of;
use super::hash::file_hash;
use super::probe::fingerprints;
use super::receipt::Receipt;
use super::reference::{Reference, Regret, Role, roles};
use super::run::{Candidate, ForeignPolicy, RunOptions, run_pairs};
use crate::error::TaskError;

/// A part of a result that can differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Part {
    /// The manifest, or the environment's tables.
    Protocol,
    /// The states that actions lead to.
    Physics,
    /// The images.
    Images,
    /// A file that the policy reads.
    Model,
    /// The policy's noise.
    Seed,
    /// The policy's configuration or its code.
    Solver,
    /// What the receipt says came out, where all of the above agree.
    Outcomes,
    /// The reference policies.
    References,
}

/// What a repetition showed.
#[derive(Clone, Debug, Serialize)]
pub struct Verification {
    /// Whether everything is equal, to the last bit.
    pub equal: bool,
    /// Which parts differ, and how.
    pub differences: BTreeMap<Part, String>,
    /// Episodes that came out otherwise.
    pub episodes: Vec<usize>,
    /// What is not compared, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// The results of the repetition.
    pub summary: Summary,
    /// What the receipt says.
    pub recorded: Summary,
}

/// Runs `receipt` again and compares: the policy, the baseline policies, and with `oracle` that too, which can cost as much as
/// the policy. `each` is called after every episode.
///
/// # Errors
///
/// The manifest fails [`Manifest::check`](swm_core::Manifest::check), the policy or environment cannot be made, or a run
/// fails. Differences are no errors.
pub fn verify(
    registry: &Registry,
    receipt: &Receipt,
    options: &RunOptions,
    oracle: bool,
    each: impl FnMut() + Send,
) -> Result<Verification, TaskError> {
    verify_by(registry, receipt, None, options, oracle, each)
}

/// As [`verify`], where the policy of the receipt is one that the registry does not have: with its settings as a candidate, and who
/// runs it. Its files are told by their content, not by where they are; without any, those of the receipt are read again.
///
/// # Errors
///
/// As of [`verify`].
pub fn verify_by(
    registry: &Registry,
    receipt: &Receipt,
    mut foreign: Option<(&Candidate, ForeignPolicy<'_>)>,
    options: &RunOptions,
    oracle: bool,
    mut each: impl FnMut() + Send,
) -> Result<Verification, TaskError> {
    let Receipt { manifest, candidate, .. } = receipt;
    manifest.check()?;
    let entry = env_of(registry, manifest)?;
    if foreign.is_none() {
        can_be_made(registry, entry, candidate)?;
    }
    let mut differences = BTreeMap::new();
    let mut differ = |part: Part, recorded: &str, now: &str, what: &str| {
        if recorded != now {
            let entry: &mut String = differences.entry(part).or_default();
            *entry += &format!(
                "{}{what}: recorded {recorded}, now {now}",
                if entry.is_empty() { "" } else { "; " }
            );
        }
    };
    let (then, now) = (&receipt.fingerprints, fingerprints(entry, manifest, candidate.seed)?);
    differ(Part::Protocol, &receipt.manifest_hash, &manifest.hash(), "manifest");
    let mut notes = Vec::new();
    if receipt.receipt < 2 {
        let skipped = "a receipt of version 1: the environment's tables, whose hash counted help texts, are not compared";
        notes.push(skipped.to_owned());
    } else {
        differ(Part::Protocol, &then.tables, &now.tables, "tables of the environment");
    }
    differ(Part::Physics, &then.physics, &now.physics, "probe of 25 random actions");
    let (a, b) = (then.images.as_deref().unwrap_or("none"), now.images.as_deref().unwrap_or("none"));
    differ(Part::Images, a, b, "images of the probe");
    for (name, then) in &then.made_from {
        match now.made_from.get(name) {
            Some(now) if now == then => {}
            now => {
                let now = now.map_or("not used", String::as_str);
                notes.push(format!("{name}: recorded SHA-256 {then}, now {now}"));
            }
        }
    }
    differ(Part::Seed, &then.noise, &now.noise, "noise of the first pair");
    let given = foreign.as_ref().map(|(_, policy)| &policy.files).filter(|files| !files.is_empty());
    for (file, hash) in &receipt.files {
        let now = match given {
            Some(files) if files.values().any(|now| now == hash) => hash.clone(),
            Some(_) => "none of the given files".to_owned(),
            None => file_hash(std::path::Path::new(file)).unwrap_or_else(|error| error.to_string()),
        };
        differ(Part::Model, hash, &now, file);
    }
    for (file, hash) in given.into_iter().flatten() {
        if !receipt.files.values().any(|then| then == hash) {
            differ(Part::Model, "no such file", hash, file);
        }
    }
    match &foreign {
        None => {
            let described = candidate.make(registry, entry, manifest)?.describe();
            // A setting may have been renamed since: then the recorded description still makes the same policy.
            let remade = PolicyArgs::parse(&receipt.policy)
                .ok()
                .and_then(|policy| Candidate::new(policy).make(registry, entry, manifest).ok())
                .map(|policy| policy.describe());
            if remade.as_ref() != Some(&described) {
                differ(Part::Solver, &receipt.policy, &described, "policy");
            }
        }
        Some((now, policy)) => {
            differ(Part::Solver, &candidate.policy.name, &now.policy.name, "policy");
            for setting in settings(&candidate.policy, &now.policy) {
                differ(Part::Solver, &setting.first.to_string(), &setting.this.to_string(), &setting.what);
            }
            let steps = policy.plan_steps.to_string();
            differ(Part::Solver, &receipt.plan_steps.to_string(), &steps, "actions of a plan");
        }
    }
    if foreign.is_none() {
        let usual = candidate.plan_steps(registry, entry, manifest);
        if receipt.plan_steps != usual {
            let steps = receipt.plan_steps;
            notes.push(format!(
                "costs are those after plans of {steps} actions, and not of the policy's {usual}"
            ));
        }
    }
    // Where starts differ, the run says so in its digests: no need to stop at the first.
    let (resets, none) = (manifest.resets()?, BTreeMap::new());
    let count = |_, _: &EpisodeResult| {
        each();
        Ok(())
    };
    let steps = receipt.plan_steps;
    let again = match &mut foreign {
        Some((_, policy)) => policy.run_pairs(manifest, &resets, options, &none, false, count)?,
        None => run_pairs(registry, manifest, &resets, candidate, steps, options, &none, false, count)?,
    };
    let episodes: Vec<usize> = (0..again.len().max(receipt.episodes.len()))
        .filter(|&index| match (receipt.episodes.get(index), again.get(index)) {
            (Some(then), Some(now)) => !then.is_repeated_by(now),
            _ => true,
        })
        .collect();
    if let Some(&first) = episodes.first() {
        let (part, what) = cause(receipt.episodes.get(first), again.get(first));
        let explained = differences.keys().any(|part| *part != Part::Images);
        if !explained {
            let count = episodes.len();
            differences.insert(part, format!("{count} episode(s) differ, the first is {first}: {what}"));
        }
    }
    for reference in &receipt.references {
        if reference.role == Role::Oracle && !oracle {
            // Where the policy is its own oracle, its episodes are those that were run.
            if reference.candidate != *candidate {
                notes.push(
                    "the oracle was not run again: its episodes are as the receipt has them".to_owned(),
                );
            }
            continue;
        }
        let again = run_pairs(
            registry,
            manifest,
            &resets,
            &reference.candidate,
            receipt.plan_steps,
            options,
            &none,
            false,
            |_, _| {
                each();
                Ok(())
            },
        )?;
        let differing =
            again.iter().zip(&reference.episodes).filter(|(now, then)| !then.is_repeated_by(now)).count();
        // Another task, or other physics, explains other results of the reference policies.
        let explained = [Part::Protocol, Part::Physics].iter().any(|part| differences.contains_key(part));
        if !explained && (differing > 0 || again.len() != reference.episodes.len()) {
            let entry: &mut String = differences.entry(Part::References).or_default();
            let separator = if entry.is_empty() { "" } else { "; " };
            *entry += &format!(
                "{separator}{}: {differing} of {} episode(s) differ",
                reference.role.name(),
                again.len()
            );
        }
    }
    for (part, what) in contradictions(receipt, &roles(registry, entry, manifest, candidate)) {
        let known: &mut String = differences.entry(part).or_default();
        *known += &format!("{}{what}", if known.is_empty() { "" } else { "; " });
    }
    let summary = Summary::of(&again);
    Ok(Verification {
        equal: differences.is_empty() && episodes.is_empty(),
        differences,
        episodes,
        notes,
        summary,
        recorded: receipt.summary.clone(),
    })
}

/// Checks that this program knows the policy by its name. Programs also evaluate objects of their own, of which a receipt has no
/// more than what they are called.
pub(crate) fn can_be_made(
    registry: &Registry,
    entry: &EnvEntry,
    candidate: &Candidate,
) -> Result<(), TaskError> {
    let Err(unknown) = registry.policy_entry(entry, &candidate.policy.name) else { return Ok(()) };
    match unknown.fix {
        // Other builds have it.
        Some(_) => Err(unknown.into()),
        None => Err(format!(
            "the policy `{}` was an object of the program that evaluated it: a receipt holds its name, its settings and the hashes of \
             its weights, but not its code, so it cannot be made again here; give the object (in Python: `swm.verify(receipt, \
             policy=…, weights=[…])`), or evaluate it again there and compare the receipts (`swm compare`, in Python: `swm.compare`)",
            unknown.name
        )
        .into()),
    }
}

/// The first entry of a receipt that is not what follows from its episodes, or its manifest's hash; `None`: it agrees with itself.
pub(crate) fn contradiction(receipt: &Receipt) -> Option<String> {
    if receipt.manifest_hash != receipt.manifest.hash() {
        return Some("the hash of the manifest is not that of the manifest in it".to_owned());
    }
    if receipt.episodes.len() != receipt.manifest.pairs.len() {
        return Some("it has not one episode for each pair".to_owned());
    }
    edited(receipt)
}

/// The same without the manifest: rates, intervals and tests that were edited.
pub(crate) fn edited(receipt: &Receipt) -> Option<String> {
    contradictions(receipt, &[]).into_iter().map(|(_, what)| what).next()
}

/// What a receipt derives from its episodes, where it is not what follows from them: rates, intervals, tests, regrets. And
/// reference policies that are not those of their role; `roles` are those of the candidate.
fn contradictions(receipt: &Receipt, roles: &[(Role, Candidate)]) -> Vec<(Part, String)> {
    let Receipt { summary, phases, episodes, manifest, references, .. } = receipt;
    let mut found = Vec::new();
    if *summary != Summary::of(episodes) {
        found.push((Part::Outcomes, "the summary is not that of the episodes".to_owned()));
    }
    // Receipts from before there were phases have none.
    if !phases.is_empty() && *phases != Receipt::by_phase(manifest, episodes) {
        found.push((Part::Outcomes, "the phases are not those of the episodes".to_owned()));
    }
    for reference in references {
        let Reference { role, candidate, summary, test, regret, episodes: own } = reference;
        let derived = Reference::new(*role, candidate.clone(), own.clone(), episodes);
        let mut wrong = |what: &str| found.push((Part::References, format!("{}: {what}", role.name())));
        if *summary != derived.summary {
            wrong("the summary is not that of its episodes");
        }
        if *test != derived.test {
            wrong("the paired test is not that of the episodes");
        }
        // Older receipts have no regret after the later plans, or none at all.
        let expected = derived.regret.map(|derived| match regret {
            Some(Regret { by_plan, .. }) if by_plan.is_empty() => Regret { by_plan: Vec::new(), ..derived },
            _ => derived,
        });
        if regret.is_some() && *regret != expected {
            wrong("the regret is not that of the episodes");
        }
        if let Some((_, expected)) = roles.iter().find(|(known, _)| known == role) {
            // An oracle may have been chosen.
            if *role != Role::Oracle && candidate.policy != expected.policy {
                wrong("it is another policy");
            }
            if candidate.seed != expected.seed {
                wrong(&format!("its noise has seed {}, and not {}", candidate.seed, expected.seed));
            }
        }
    }
    found
}

/// Why an episode may differ where all fingerprints agree.
fn cause(recorded: Option<&EpisodeResult>, again: Option<&EpisodeResult>) -> (Part, &'static str) {
    let (Some(recorded), Some(again)) = (recorded, again) else {
        return (Part::Outcomes, "it is missing on one side");
    };
    if recorded.decisions != again.decisions {
        (Part::Solver, "its first decision is another")
    } else if recorded.digest != again.digest {
        (Part::Physics, "its first decision is the same, what came of it is not")
    } else {
        (Part::Outcomes, "the same happened, and the receipt says otherwise")
    }
}
