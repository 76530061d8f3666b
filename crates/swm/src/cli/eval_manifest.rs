//! `swm eval --manifest`: a policy and the reference policies on a manifest, and a receipt.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::ValueEnum;
use swm_core::evaluate::{EpisodeResult, Summary};
use swm_core::{EnvEntry, Manifest, Registry};
use swm_tasks::request::note_rewards_only;

use super::args::{PartArgs, Shard, model_image, note_elites, note_images, policy_args, policy_files};
use super::output::{claim, counted, create_folder, table};
use super::rates::{at_reset, p_value, rate};
use super::regret::regret_line;
use super::training_note;
use super::work::Plan;
use super::{Failure, Output, held, interrupt, usage};
use crate::evaluation::{
    Candidate, CellLedger, Division, Ledger, Receipt, Reference, Role, RunOptions, env_of, fingerprints,
    identity, read_manifest, roles, run_pairs, write_receipt,
};

/// A choice of reference policies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ReferenceArg {
    /// Actions sampled uniformly.
    Random,
    /// Zeros.
    #[value(aliases = ["no_op", "noop", "nop", "do_nothing"])]
    NoOp,
    /// The same planner on the true dynamics.
    #[value(alias = "ceiling")]
    Oracle,
    /// All of them.
    All,
    /// None of them.
    None,
}

/// Planners take many times as long as the random and the no-op policy.
const DIVISION: Division = Division::ByPair;

/// What is asked for.
pub(super) struct EvalManifest<'a> {
    pub(super) manifest: &'a Path,
    pub(super) policy: &'a str,
    pub(super) policy_seed: u64,
    pub(super) reference: &'a [ReferenceArg],
    pub(super) oracle: Option<&'a str>,
    pub(super) out: Option<&'a Path>,
    /// Run what `out` holds already again, and replace it.
    pub(super) again: bool,
    /// The part to run, or that parts are joined; both need `out`.
    pub(super) part: &'a PartArgs,
    pub(super) options: RunOptions,
}

impl EvalManifest<'_> {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let manifest = read_manifest(self.manifest).map_err(usage)?;
        let entry = env_of(registry, &manifest).map_err(usage)?;
        note_rewards_only(entry, &manifest.success, &mut &*output);
        let candidate = Candidate::new(policy_args(self.policy)?).seeded(self.policy_seed);
        let candidate = candidate.on(registry, entry, &manifest);
        let policy = candidate.make(registry, entry, &manifest)?.describe();
        let mut wanted = self.wanted(registry, entry, &manifest, &candidate)?;
        note_images(self.policy, model_image(registry, entry, self.policy), manifest.image, output);
        training_note::of_policy_on(registry, entry, &manifest, &candidate.policy, output);
        if let Some(dir) = self.out {
            create_folder(dir)?;
        }
        // Shards write parts of their own.
        let whole = self.out.filter(|_| self.part.shard.is_none());
        let _claim = whole.map(|dir| claim(&dir.join("receipt.json"))).transpose()?;
        let run = Run {
            registry,
            manifest: &manifest,
            output,
            out: self.out,
            again: self.again,
            options: &self.options,
        };
        let files = candidate.files(registry, entry)?;
        let fingerprints = fingerprints(entry, &manifest, candidate.seed)?;
        let steps = candidate.plan_steps(registry, entry, &manifest);
        let asked = Receipt::new(
            manifest.clone(),
            candidate.clone(),
            policy,
            files.clone(),
            fingerprints.clone(),
            steps,
        );
        let held = match self.out {
            Some(dir) if !self.again => held::receipt(dir, &asked, &mut wanted)?,
            _ => None,
        };
        if let (Some(held), Some(dir), []) = (&held, self.out, wanted.as_slice()) {
            let path = dir.join("receipt.json");
            output.note(format!("{}: already done; --again repeats it", path.display()));
            return output.result(held, || text(held, Some(&path)));
        }
        let is_divided = self.part.shard.is_some() || self.part.join;
        if let (Some(_), Some(dir), true) = (&held, self.out, is_divided) {
            return Err(held::refusal(dir, "a receipt with other reference policies"));
        }
        note_elites(registry, entry, &candidate.policy, output);
        let oracle = wanted.iter().find(|(role, other)| *role == Role::Oracle && *other != candidate);
        if let Some((_, oracle)) = oracle {
            let roles: Vec<&str> = wanted.iter().map(|(role, _)| role.name()).collect();
            output.note(format!(
                "note: reference policies on the same pairs: {}; the oracle, `{}` on the true dynamics, takes longest \
                 (--reference random,no-op leaves it out)",
                roles.join(", "),
                oracle.policy
            ));
        }
        let others = wanted.iter().map(|(_, other)| other).filter(|other| **other != candidate);
        let policies: Vec<&Candidate> = std::iter::once(&candidate).chain(others).collect();
        let (cells, pairs) = (policies.len() as u64, manifest.pairs.len() as u64);
        let whole = identity(&(manifest.hash(), &policies, &fingerprints, steps), &files)?;
        if let (Some(shard), Some(dir)) = (self.part.shard, self.out) {
            run.part(dir, shard, &policies, steps, &whole)?;
            return self.part.done(dir, shard, shard.of(cells * pairs), output);
        }
        let joined = match self.out {
            Some(dir) if self.part.join => {
                Some(CellLedger::join(dir, DIVISION, &whole, cells, pairs).map_err(usage)?)
            }
            _ => None,
        };
        let identity =
            |candidate: &Candidate| identity(&(manifest.hash(), candidate, &fingerprints, steps), &files);
        let started = Instant::now();
        let (episodes, wall_time_s, mut references) = match (held, &joined) {
            (Some(held), _) => (held.episodes, held.wall_time_s, held.references),
            (None, Some(joined)) => (joined.known(0).into_values().collect(), joined.seconds(0), Vec::new()),
            (None, None) => {
                let episodes = run.policy("episodes", &candidate, steps, &identity(&candidate)?, "")?;
                (episodes, started.elapsed().as_secs_f64(), Vec::new())
            }
        };
        if let (Some((_, oracle)), None) = (oracle, &joined) {
            let summary = Summary::of(&episodes);
            output.note(format!(
                "{}: success {}; reference policies follow",
                candidate.policy,
                rate(&summary)
            ));
            if let Some(dir) = self.out {
                let how = format!(
                    "{}; --reference random,no-op leaves out the oracle, `{}`",
                    interrupt::REPEAT,
                    oracle.policy
                );
                drop(interrupt::watch_resumable(interrupt::episodes_are_in(dir), how));
            }
        }
        let mut cell = 0;
        for (role, other) in wanted {
            // A planner on the true dynamics is its own oracle: nothing to run again.
            let others = match (other == candidate, &joined) {
                (true, _) => episodes.clone(),
                (false, Some(joined)) => {
                    cell += 1;
                    joined.known(cell).into_values().collect()
                }
                (false, None) => {
                    let file = format!("episodes-{}", role.name());
                    run.policy(&file, &other, steps, &identity(&other)?, role.name())?
                }
            };
            references.push(Reference::new(role, other, others, &episodes));
        }
        let receipt = asked.with_results(episodes, references, wall_time_s);
        let path = self.out.map(|dir| write_receipt(dir, &receipt)).transpose()?;
        joined.map_or(Ok(()), CellLedger::close)?;
        output.result(&receipt, || text(&receipt, path.as_deref()))
    }

    /// What a job needs to know before it is submitted.
    pub(super) fn plan(&self, registry: &Registry) -> Result<Plan, Failure> {
        let manifest = read_manifest(self.manifest).map_err(usage)?;
        let entry = env_of(registry, &manifest).map_err(usage)?;
        let candidate = Candidate::new(policy_args(self.policy)?).seeded(self.policy_seed);
        let candidate = candidate.on(registry, entry, &manifest);
        let others = self.wanted(registry, entry, &manifest, &candidate)?;
        let mut cells = 1;
        candidate.make(registry, entry, &manifest)?;
        // Every task would fail at its first plan.
        if let (Some(size), None) = (model_image(registry, entry, self.policy), manifest.image) {
            return Err(usage(format!(
                "{} sees images of {size}, and the task shows none; make the manifest with --image-size {size}",
                self.policy
            )));
        }
        for (_, other) in others.iter().filter(|(_, other)| *other != candidate) {
            other.make(registry, entry, &manifest)?;
            cells += 1;
        }
        let mut inputs = vec![self.manifest.to_owned()];
        for policy in std::iter::once(self.policy).chain(self.oracle) {
            inputs.extend(policy_files(registry, entry, policy)?);
        }
        Ok(Plan { episodes: cells * manifest.pairs.len() as u64, inputs })
    }

    /// The reference policies to run.
    fn wanted(
        &self,
        registry: &Registry,
        entry: &EnvEntry,
        manifest: &Manifest,
        candidate: &Candidate,
    ) -> Result<Vec<(Role, Candidate)>, Failure> {
        let mut all = roles(registry, entry, manifest, candidate);
        if let Some(text) = self.oracle {
            all.retain(|(role, _)| *role != Role::Oracle);
            let oracle = Candidate::new(policy_args(text)?).seeded(candidate.seed);
            all.push((Role::Oracle, oracle.on(registry, entry, manifest)));
        }
        if self.reference.len() > 1 && self.reference.contains(&ReferenceArg::None) {
            return Err(usage("--reference none goes with no other; leave `none` out, or the others"));
        }
        let is_wanted = |role: &Role| {
            let arg = match role {
                Role::Random => ReferenceArg::Random,
                Role::NoOp => ReferenceArg::NoOp,
                Role::Oracle => ReferenceArg::Oracle,
            };
            self.reference.iter().any(|wanted| [arg, ReferenceArg::All].contains(wanted))
        };
        all.retain(|(role, _)| is_wanted(role));
        Ok(all)
    }
}

struct Run<'a> {
    registry: &'a Registry,
    manifest: &'a Manifest,
    output: &'a Output,
    out: Option<&'a Path>,
    again: bool,
    options: &'a RunOptions,
}

impl Run<'_> {
    /// Runs a part of the episodes of all policies.
    fn part(
        &self,
        dir: &Path,
        shard: Shard,
        policies: &[&Candidate],
        steps: u64,
        identity: &impl serde::Serialize,
    ) -> Result<(), Failure> {
        let Self { registry, manifest, output, options, .. } = *self;
        let (cells, pairs) = (policies.len() as u64, manifest.pairs.len() as u64);
        let mut ledger = CellLedger::open_part(dir, shard.numbers(), DIVISION, identity, cells, pairs)?;
        let resets = manifest.resets()?;
        let episodes = shard.of(cells * pairs);
        let bar = output.bar(episodes.end - episodes.start, "episodes");
        let run = (0..).zip(policies).try_for_each(|(cell, candidate)| {
            let (wanted, known) = (ledger.wanted(cell), ledger.known(cell));
            bar.inc(known.len() as u64);
            let options = RunOptions { pairs: Some(wanted.collect()), ..options.clone() };
            let ran = run_pairs(
                registry,
                manifest,
                &resets,
                candidate,
                steps,
                &options,
                &known,
                true,
                |pair, result| {
                    bar.inc(1);
                    ledger.push(cell, pair, result)
                },
            );
            ran.map(drop)
        });
        bar.finish_and_clear();
        run?;
        Ok(ledger.finish_part()?)
    }

    /// Runs what is not in the ledger yet.
    fn policy(
        &self,
        name: &str,
        candidate: &Candidate,
        steps: u64,
        identity: &impl serde::Serialize,
        label: &str,
    ) -> Result<Vec<EpisodeResult>, Failure> {
        let Self { registry, manifest, output, out, again, options } = *self;
        let open = |path: &Path| match again {
            true => Ledger::open_again(path, identity),
            false => Ledger::open(path, identity),
        };
        let path: Option<PathBuf> = out.map(|dir| dir.join(format!("{name}.jsonl")));
        let mut ledger = path.as_deref().map(open).transpose()?;
        let known = ledger.as_ref().map(|ledger| ledger.known.clone()).unwrap_or_default();
        if !known.is_empty() {
            let all = counted(manifest.pairs.len(), "episode");
            output.note(format!("{} of {all} done already", known.len()));
        }
        let known: BTreeMap<u64, EpisodeResult> = known;
        let bar = output.bar(manifest.pairs.len() as u64, "episodes");
        bar.set_message(label.to_owned());
        bar.inc(known.len() as u64);
        let resets = manifest.resets()?;
        let episodes = run_pairs(
            registry,
            manifest,
            &resets,
            candidate,
            steps,
            options,
            &known,
            true,
            |pair, result| {
                bar.inc(1);
                ledger.as_mut().map_or(Ok(()), |ledger| ledger.push(pair, result))
            },
        );
        bar.finish_and_clear();
        let episodes = episodes?;
        if let Some(ledger) = ledger {
            ledger.close()?;
        }
        Ok(episodes)
    }
}

fn text(receipt: &Receipt, path: Option<&Path>) -> String {
    let steps = |summary: &Summary| {
        summary.mean_success_steps.map_or("–".to_owned(), |steps| format!("{steps:.1}"))
    };
    let mut rows = vec![vec![
        receipt.candidate.policy.to_string(),
        rate(&receipt.summary),
        steps(&receipt.summary),
        String::new(),
        String::new(),
    ]];
    let is_itself = |other: &Reference| other.role == Role::Oracle && other.candidate == receipt.candidate;
    for other in receipt.references.iter().filter(|other| !is_itself(other)) {
        let [low, high] = other.test.interval95;
        rows.push(vec![
            other.role.name().to_owned(),
            rate(&other.summary),
            steps(&other.summary),
            format!("{:+.1} ({low:+.1} to {high:+.1})", other.test.difference),
            p_value(other.test.p_value),
        ]);
    }
    let mut text = format!(
        "{}, {} tier, {} pairs{}\n\n{}",
        receipt.manifest.env,
        receipt.manifest.tier.name(),
        receipt.summary.episodes,
        at_reset(receipt.summary.solved_at_start),
        table(&["policy", "success (95 %)", "steps", "difference (95 %)", "McNemar"], &rows),
    );
    for (phase, summary) in receipt.phases.iter().enumerate() {
        text += &format!("phase {phase}: {}, {}\n", rate(summary), counted(summary.episodes, "episode"));
    }
    if receipt.references.iter().any(is_itself) {
        text += "\nThe policy plans on the true dynamics: it is its own oracle.\n";
    }
    let others = receipt.references.iter().filter(|other| !is_itself(other));
    if let Some(regret) = others.into_iter().find_map(|other| other.regret.as_ref()) {
        text += &format!("\n{}\n", regret_line(regret));
    }
    let seed = Some(receipt.candidate.seed).filter(|&seed| seed != 0);
    text += &seed.map(|seed| format!("policy seed {seed}\n")).unwrap_or_default();
    text += &format!(
        "manifest {}\nwall time of the policy: {:.1} s\n",
        receipt.manifest_hash, receipt.wall_time_s
    );
    text + &path.map(|path| format!("{}\n", path.display())).unwrap_or_default()
}
