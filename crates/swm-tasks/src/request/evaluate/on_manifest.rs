//! A policy and the reference policies on a manifest, whole or in parts, and the receipt.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use serde_json::json;
use swm_core::error::{did_you_mean, nearest};
use swm_core::evaluate::{EpisodeResult, Summary};
use swm_core::{Manifest, Registry, ResetOptions};

use super::{Evaluate, Evaluated};
use crate::evaluation::{
    Candidate, CellLedger, Division, Ledger, Receipt, Reference, Role, RunOptions, existing_receipt,
    fingerprints, identity, refusal, roles, run_pairs, write_receipt,
};
use crate::request::entrant::{Entrant, inputs};
use crate::request::policy::{model_image, note_elites, note_images, policy_args};
use crate::request::report::apart;
use crate::request::source::{claim, make_folder};
use crate::request::training_note::note_training_on;
use crate::request::{
    Assignment, Fix, Foreign, Message, Needs, Progress, Report, Request as _, Stage, TaskError,
    note_rewards_only,
};

/// Planners take many times as long as the random and the no-op policy.
const DIVISION: Division = Division::ByPair;

/// All reference policies.
const ROLES: [Role; 3] = [Role::Random, Role::NoOp, Role::Oracle];

impl Evaluate {
    pub(super) fn on_manifest(
        &self,
        manifest: Manifest,
        registry: &Registry,
        foreign: Option<&mut Foreign<'_>>,
        report: &mut dyn Report,
    ) -> Result<Evaluated, TaskError> {
        let given = foreign.as_deref();
        let entrant =
            Entrant::new(registry, manifest, &self.policy, self.policy_seed, self.plan_steps, given, report)?;
        let Entrant { manifest, entry, candidate, description, files, steps, .. } = &entrant;
        let (entry, steps) = (*entry, *steps);
        note_rewards_only(entry, &manifest.success, report);
        let mut wanted = self.wanted(registry, &entrant)?;
        if foreign.is_none() {
            note_images(&self.policy, model_image(registry, entry, &self.policy), manifest.image, report);
            note_training_on(registry, entry, manifest, &candidate.policy, report);
        }
        let out = self.out.as_deref();
        out.map_or(Ok(()), make_folder)?;
        // Shards write parts of their own.
        let whole = out.filter(|_| self.shard.is_none());
        // A result that is there already is read from a folder that nothing can be written to, too.
        let claim = whole.map(|dir| claim(&dir.join("receipt.json"))).transpose();
        let fingerprints = apart(report, || fingerprints(entry, manifest, candidate.seed))??;
        let asked = Receipt::new(
            manifest.clone(),
            candidate.clone(),
            description.clone(),
            files.clone(),
            fingerprints.clone(),
            steps,
        );
        let held = match out {
            Some(dir) if !self.again => existing_receipt(dir, &asked, &mut wanted)?,
            _ => None,
        };
        if let (Some(_), Some(dir)) = (&held, out) {
            entrant.check_identified(dir, "a result")?;
        }
        let held = match (held, out) {
            (Some(held), Some(dir)) if wanted.is_empty() => {
                let path = dir.join("receipt.json");
                let done = Message::new(format!("{}: already done", path.display()));
                report.note(&done.fix(Fix::set_to("again", true, "to repeat it")));
                return Ok(Evaluated::Receipt(Box::new(held), Some(path)));
            }
            (held, _) => held,
        };
        let _claim = claim?;
        if let (Some(_), Some(dir), true) = (&held, out, self.shard.is_some() || self.join) {
            return Err(refusal(dir, "a receipt with other reference policies"));
        }
        if foreign.is_none() {
            note_elites(registry, entry, &candidate.policy, report);
        }
        let oracle = wanted.iter().find(|(role, other)| *role == Role::Oracle && other != candidate);
        if let Some((_, oracle)) = oracle {
            let roles: Vec<&str> = wanted.iter().map(|(role, _)| role.name()).collect();
            let text = format!(
                "reference policies on the same pairs: {}; the oracle, `{}` on the true dynamics, takes longest",
                roles.join(", "),
                oracle.policy
            );
            let fix = Fix::set_to("reference", json!(["random", "no-op"]), "to leave it out");
            report.info(&Message::new(text).fix(fix));
        }
        let others = wanted.iter().map(|(_, other)| other).filter(|other| *other != candidate);
        let policies: Vec<&Candidate> = std::iter::once(candidate).chain(others).collect();
        let (cells, pairs) = (policies.len() as u64, manifest.pairs.len() as u64);
        let whole = identity(&(manifest.hash(), &policies, &fingerprints, steps), files)?;
        let mut runs = Runs {
            registry,
            entrant: &entrant,
            num_envs: self.num_envs,
            threads: self.threads,
            foreign,
            report,
        };
        if let (Some(shard), Some(dir)) = (self.shard, out) {
            let ledger = CellLedger::open_part(dir, shard.numbers(), DIVISION, &whole, cells, pairs)?;
            let episodes = shard.of(cells * pairs);
            let episodes = episodes.end - episodes.start;
            runs.part(&policies, ledger, episodes)?;
            return Ok(Evaluated::Part(shard, episodes));
        }
        let joined = match out {
            Some(dir) if self.join => Some(CellLedger::join(dir, DIVISION, &whole, cells, pairs)?),
            _ => None,
        };
        // They stay until the receipt has what is in them.
        let mut ledgers = Vec::new();
        let mut all = |name: &str, candidate: &Candidate, role: Option<Role>| -> Result<_, TaskError> {
            let own = identity(&(manifest.hash(), candidate, &fingerprints, steps), files)?;
            // Without its files, a policy in Python may be another one when it is run again.
            let keeps = entrant.is_identified || *candidate != entrant.candidate;
            let path = out.filter(|_| keeps).map(|dir| dir.join(format!("{name}.jsonl")));
            let (episodes, ledger) = runs.all(candidate, role, path.as_deref(), &own, self.again)?;
            ledgers.extend(ledger);
            Ok(episodes)
        };
        let started = Instant::now();
        let (episodes, wall_time_s, mut references) = match (held, &joined) {
            (Some(held), _) => (held.episodes, held.wall_time_s, held.references),
            (None, Some(joined)) => (joined.known(0).into_values().collect(), joined.seconds(0), Vec::new()),
            (None, None) => {
                let episodes = all("episodes", candidate, None)?;
                (episodes, started.elapsed().as_secs_f64(), Vec::new())
            }
        };
        let mut cell = 0;
        for (role, other) in wanted {
            let found = match (other == *candidate, &joined) {
                // A planner on the true dynamics is its own oracle: nothing to run again.
                (true, _) => episodes.clone(),
                (false, Some(joined)) => {
                    cell += 1;
                    joined.known(cell).into_values().collect()
                }
                (false, None) => all(&format!("episodes-{}", role.name()), &other, Some(role))?,
            };
            references.push(Reference::new(role, other, found, &episodes));
        }
        let receipt = asked.with_results(episodes, references, wall_time_s);
        let path = out.map(|dir| write_receipt(dir, &receipt)).transpose()?;
        ledgers.into_iter().try_for_each(Ledger::close)?;
        joined.map_or(Ok(()), CellLedger::close)?;
        Ok(Evaluated::Receipt(Box::new(receipt), path))
    }

    /// What a job needs to know before it is submitted; the environment and all policies are made.
    ///
    /// # Errors
    ///
    /// As of `check`; there is no manifest, or a policy cannot be made.
    pub fn needs(&self, registry: &Registry) -> Result<Needs, TaskError> {
        let Some(source) = &self.manifest else {
            let message = Message::new("only an evaluation on a manifest can be divided");
            return Err(message.fix(Fix::give("manifest")).into());
        };
        self.check(registry)?;
        let manifest = source.read()?;
        let entrant =
            Entrant::new(registry, manifest, &self.policy, self.policy_seed, self.plan_steps, None, &mut ())?;
        // Every task would fail at its first plan.
        let of_model = model_image(registry, entrant.entry, &self.policy);
        if let (Some(size), None) = (of_model, entrant.manifest.image) {
            let message =
                Message::new(format!("{} sees images of {size}, and the task shows none", self.policy));
            let settings = vec![Assignment::of("image_size", json!(size))];
            return Err(message.fix(Fix::With { how: "make the manifest with", settings, to: "" }).into());
        }
        let mut cells = 1;
        for (_, other) in self.wanted(registry, &entrant)? {
            if other != entrant.candidate {
                entrant.check_made(registry, &other)?;
                cells += 1;
            }
        }
        let policies = std::iter::once(&self.policy).chain(&self.oracle);
        Ok(Needs {
            episodes: cells * entrant.manifest.pairs.len() as u64,
            inputs: inputs(registry, entrant.entry, Some(source), policies)?,
        })
    }

    /// The reference policies that are asked for.
    pub(super) fn roles(&self) -> Result<Vec<Role>, TaskError> {
        let mut found = Vec::new();
        for name in &self.reference {
            match name.replace('_', "-").as_str() {
                "random" => found.push(Role::Random),
                "no-op" | "noop" | "nop" => found.push(Role::NoOp),
                "oracle" => found.push(Role::Oracle),
                "all" => found.extend(ROLES),
                "none" if self.reference.len() == 1 => {}
                "none" => {
                    let message =
                        Message::about("reference", json!(self.reference), "`none` goes with no other");
                    return Err(message.into());
                }
                other => {
                    let known = ["random", "no-op", "oracle", "all", "none"];
                    let meant = did_you_mean(nearest(other, known).as_deref());
                    let text = format!("no reference policy{meant}");
                    let known = known.map(str::to_owned).to_vec();
                    return Err(Message::about("reference", json!([name]), text)
                        .fix(Fix::Choose(known))
                        .into());
                }
            }
        }
        Ok(found)
    }

    /// The reference policies to run.
    fn wanted(&self, registry: &Registry, entrant: &Entrant) -> Result<Vec<(Role, Candidate)>, TaskError> {
        let Entrant { manifest, entry, candidate, .. } = entrant;
        let asked = self.roles()?;
        let mut all = roles(registry, entry, manifest, candidate);
        if let Some(text) = &self.oracle {
            all.retain(|(role, _)| *role != Role::Oracle);
            let oracle = Candidate::new(policy_args(registry, text)?).seeded(candidate.seed);
            all.push((Role::Oracle, oracle.on(registry, entry, manifest)));
        }
        all.retain(|(role, _)| asked.contains(role));
        Ok(all)
    }
}

/// How runs are spread and shown, and who acts.
struct Runs<'a, 'f> {
    registry: &'a Registry,
    entrant: &'a Entrant,
    num_envs: usize,
    threads: Option<usize>,
    foreign: Option<&'a mut Foreign<'f>>,
    report: &'a mut dyn Report,
}

impl Runs<'_, '_> {
    /// The episodes of `candidate` in `pairs` (all: `None`) that are not `known`, and those; `each` gets every one that ends.
    fn pairs(
        &mut self,
        candidate: &Candidate,
        pairs: Option<Vec<u64>>,
        known: &BTreeMap<u64, EpisodeResult>,
        progress: &dyn Progress,
        mut each: impl FnMut(u64, &EpisodeResult) -> Result<(), TaskError> + Send,
    ) -> Result<Vec<EpisodeResult>, TaskError> {
        let Entrant { manifest, steps, .. } = self.entrant;
        let resets: Vec<ResetOptions> = manifest.resets()?;
        known.values().for_each(|episode| progress.done(Some(episode.success)));
        let (num_envs, threads, cancel) = (self.num_envs, self.threads, Some(self.report.cancel()));
        let options = RunOptions { num_envs, threads, cancel, pairs };
        let counted = |pair: u64, result: &EpisodeResult| {
            progress.done(Some(result.success));
            each(pair, result)
        };
        if let Some(foreign) = self.foreign.as_deref_mut().filter(|_| *candidate == self.entrant.candidate) {
            let mut foreign = self.entrant.foreign(foreign);
            return foreign.run_pairs(manifest, &resets, &options, known, true, counted);
        }
        let registry = self.registry;
        let run =
            || run_pairs(registry, manifest, &resets, candidate, *steps, &options, known, true, counted);
        apart(self.report, run)?
    }

    /// All episodes of `candidate`, and the ledger `path` that holds them; those of an earlier try are in it, if it belongs to `identity`.
    /// One of another evaluation is replaced if `again`.
    fn all(
        &mut self,
        candidate: &Candidate,
        role: Option<Role>,
        path: Option<&Path>,
        identity: &impl serde::Serialize,
        again: bool,
    ) -> Result<(Vec<EpisodeResult>, Option<Ledger>), TaskError> {
        let open = |path: &Path| match again {
            true => Ledger::open_again(path, identity),
            false => Ledger::open(path, identity),
        };
        let mut ledger = path.map(open).transpose()?;
        let known = ledger.as_ref().map(|ledger| ledger.known.clone()).unwrap_or_default();
        let total = self.entrant.manifest.pairs.len() as u64;
        if !known.is_empty() {
            self.report.info(&Message::new(format!("{} of {total} episodes done already", known.len())));
        }
        let name = match role {
            Some(role) => role.name(),
            None => &candidate.policy.name,
        };
        let progress = self.report.begin(&Stage { name, role, unit: "episodes", total })?;
        let episodes = self.pairs(candidate, None, &known, progress.as_ref(), |pair, result| {
            ledger.as_mut().map_or(Ok(()), |ledger| ledger.push(pair, result))
        })?;
        drop(progress);
        if role.is_none() {
            let Summary { success_rate, ci95: [low, high], .. } = Summary::of(&episodes);
            self.report.info(&Message::new(format!(
                "{}: success {success_rate:.1} % ({low:.1} to {high:.1})",
                candidate.policy
            )));
        }
        Ok((episodes, ledger))
    }

    /// Runs the episodes of a part that are not in its ledger.
    fn part(&mut self, policies: &[&Candidate], mut ledger: CellLedger, total: u64) -> Result<(), TaskError> {
        for (cell, candidate) in (0..).zip(policies) {
            let (wanted, known) = (ledger.wanted(cell), ledger.known(cell));
            let (name, unit) = (candidate.policy.name.as_str(), "episodes");
            let total = (wanted.end - wanted.start).min(total);
            let progress = self.report.begin(&Stage { name, role: None, unit, total })?;
            let each = |pair, result: &_| ledger.push(cell, pair, result);
            self.pairs(candidate, Some(wanted.collect()), &known, progress.as_ref(), each)?;
        }
        ledger.finish_part()
    }
}
