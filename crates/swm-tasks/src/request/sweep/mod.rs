//! A policy is evaluated on a manifest under changed factors of variation, whole or in parts.

use std::path::PathBuf;

use serde_json::json;
use swm_core::{EnvConfig, Registry};

use super::entrant::{Entrant, inputs};
use super::evaluate::check_parts;
use super::report::apart;
use super::scenario::no_factor;
use super::source::{claim, make_folder};
use super::{
    Assignment, Fix, Foreign, ManifestSource, Message, NUM_ENVS, Needs, Report, Request, Shard, Stage,
    TaskError, must_be_given, note_rewards_only, note_training_on,
};
use crate::evaluation::{
    self, CellLedger, Change, Division, RunOptions, SweepRun, Values, changes, existing_sweep, grid_points,
    unknown_factor, write_sweep,
};
use crate::threads;

swm_core::settings! {
    /// Evaluate a policy on a manifest under changed factors of variation, against the unchanged environment.
    pub struct Sweep {
        /// The manifest.
        manifest: Option<ManifestSource> = None => "must be given",
        /// The policy: NAME, NAME:VALUE, NAME:KEY=VALUE,… or NAME:@FILE.
        policy: String = String::new() => "must be given",
        /// Seed of the policy's noise, for repetitions on the same pairs. 0: noise is seeded by the pairs.
        policy_seed: u64 = 0,
        /// Actions of one plan, for the cost of plans.
        plan_steps: Option<u64> = None => "by the settings of the policy, or 25",
        /// Factors: names, groups, or `all`; `NAME+NAME` changes several together.
        factors: Vec<String> = vec!["all".to_owned()] => "all",
        /// Which values they get: `sampled` for every episode, `extremes` (the smallest, then the largest), or `grid`, evenly
        /// from the smallest to the largest.
        values: String = "sampled".to_owned() => "sampled",
        /// Values of a grid.
        points: Option<usize> = None => "5, or every value where the factors are choices of up to 16",
        /// Environments stepped in parallel; results do not depend on it.
        num_envs: usize = NUM_ENVS => "8",
        /// Threads; results do not depend on it.
        threads: Option<usize> = None => "one per core",
        /// A folder for sweep.json, sweep.csv and sweep.svg.
        out: Option<PathBuf> = None => "none",
        /// Run again what the folder holds already, and replace it.
        again: bool = false,
        /// Run only this part of the episodes.
        shard: Option<Shard> = None => "all",
        /// Join the parts that are in the folder.
        join: bool = false,
    }
}

/// What came out of a sweep.
#[derive(Debug)]
#[non_exhaustive]
pub enum Swept {
    /// The sweep.
    Sweep(Box<evaluation::Sweep>),
    /// A part of one, of so many episodes, is done.
    Part(Shard, u64),
}

/// One policy in all cells; each cell's changes are tried once in a part that has some of its pairs.
const DIVISION: Division = Division::ByCell;

impl Request for Sweep {
    const NAME: &'static str = "sweep";
    type Outcome = Swept;

    fn check(&self, _registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("manifest", self.manifest.is_none()), ("policy", self.policy.is_empty())])?;
        if self.factors.is_empty() {
            return Err(Message::about_setting("factors", "names none")
                .fix(Fix::set("factors", "all"))
                .into());
        }
        let known = ["sampled", "extremes", "grid"];
        if !known.contains(&self.values.as_str()) {
            let message = Message::about("values", self.values.as_str(), "no way to choose values");
            return Err(message.fix(Fix::Choose(known.map(str::to_owned).to_vec())).into());
        }
        match self.points {
            Some(points) if self.values != "grid" => {
                let message = Message::about("points", points, "is about a grid");
                return Err(message
                    .fix(Fix::Any(vec![Fix::set("values", "grid"), Fix::Leave("points")]))
                    .into());
            }
            Some(points @ 0..2) => {
                return Err(
                    Message::about("points", points, "a grid has several values; use 2 or more").into()
                );
            }
            _ => {}
        }
        if self.num_envs == 0 {
            return Err(Message::about("num_envs", 0, "use 1 to 65536").into());
        }
        threads::check(self.threads)?;
        check_parts(self.out.is_some(), self.again, self.shard, self.join)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Swept, TaskError> {
        self.run_by(registry, None, report)
    }
}

impl Sweep {
    /// As [`Request::run`], by a policy that the registry does not have, where one is given.
    ///
    /// # Errors
    ///
    /// As of [`Request::run`].
    pub fn run_by(
        &self,
        registry: &Registry,
        foreign: Option<&mut Foreign<'_>>,
        report: &mut dyn Report,
    ) -> Result<Swept, TaskError> {
        let entrant = self.entrant(registry, foreign.as_deref(), report)?;
        let Entrant { manifest, entry, candidate, description, files, steps, .. } = &entrant;
        note_rewards_only(entry, &manifest.success, report);
        if foreign.is_none() {
            note_training_on(registry, entry, manifest, &candidate.policy, report);
        }
        let (values, changes) = self.changes(&entrant)?;
        let out = self.out.as_deref();
        out.map_or(Ok(()), make_folder)?;
        // Shards write parts of their own.
        let whole = out.filter(|_| self.shard.is_none());
        // A result that is there already is read from a folder that nothing can be written to, too.
        let claim = whole.map(|dir| claim(&dir.join("sweep.json"))).transpose();
        if let (Some(dir), false) = (out, self.again)
            && let Some(held) = existing_sweep(dir, manifest, candidate, files, values, &changes)?
        {
            entrant.check_identified(dir, "a sweep")?;
            let done = Message::new(format!("{}: already done", dir.join("sweep.json").display()));
            report.note(&done.fix(Fix::set_to("again", true, "to repeat it")));
            return Ok(Swept::Sweep(Box::new(held)));
        }
        let _claim = claim?;
        let options = RunOptions {
            num_envs: self.num_envs,
            threads: self.threads,
            cancel: Some(report.cancel()),
            ..RunOptions::default()
        };
        let run = SweepRun::new(registry, manifest, candidate, changes, values, options)?;
        let mut run = run.described(description.clone(), files.clone(), *steps);
        let (cells, pairs) = (run.cells(), run.pairs());
        let whole = &mut run;
        let identity = apart(report, move || whole.identity())??;
        let mut ledger = match (out, self.shard) {
            (Some(dir), Some(shard)) => {
                CellLedger::open_part(dir, shard.numbers(), DIVISION, &identity, cells, pairs)?
            }
            (Some(dir), None) if self.join => CellLedger::join(dir, DIVISION, &identity, cells, pairs)?,
            // Without its files, a policy in Python may be another one when it is run again.
            (Some(dir), None) if entrant.is_identified => {
                let path = dir.join("sweep.jsonl");
                match self.again {
                    true => CellLedger::open_again(&path, &identity, cells, pairs)?,
                    false => CellLedger::open(&path, &identity, cells, pairs)?,
                }
            }
            _ => CellLedger::in_memory(cells, pairs),
        };
        let stage = Stage { name: &candidate.policy.name, role: None, unit: "evaluations", total: cells };
        let progress = report.begin(&stage)?;
        let done = |name: &str| {
            progress.done(None);
            progress.now(name);
        };
        let mut foreign = foreign.map(|foreign| entrant.foreign(foreign));
        if let Some(shard) = self.shard {
            match &mut foreign {
                Some(foreign) => run.run_part(&mut ledger, Some(foreign), done)?,
                None => apart(report, || run.run_part(&mut ledger, None, done))??,
            }
            ledger.finish_part()?;
            let episodes = shard.of(cells * pairs);
            return Ok(Swept::Part(shard, episodes.end - episodes.start));
        }
        let sweep = match &mut foreign {
            Some(foreign) => run.run(&mut ledger, Some(foreign), |cell| done(&cell.name))?,
            None => apart(report, || run.run(&mut ledger, None, |cell| done(&cell.name)))??,
        };
        out.map_or(Ok(()), |dir| write_sweep(dir, &sweep))?;
        ledger.close()?;
        Ok(Swept::Sweep(Box::new(sweep)))
    }

    /// What a job needs to know before it is submitted; the environment and the policy are made.
    ///
    /// # Errors
    ///
    /// As of `check`; the policy cannot be made, or a factor is unknown.
    pub fn needs(&self, registry: &Registry) -> Result<Needs, TaskError> {
        let entrant = self.entrant(registry, None, &mut ())?;
        let (_, changes) = self.changes(&entrant)?;
        let episodes = (changes.len() as u64 + 1) * entrant.manifest.pairs.len() as u64;
        Ok(Needs {
            episodes,
            inputs: inputs(registry, entrant.entry, self.manifest.as_ref(), [&self.policy])?,
        })
    }

    /// Checks the request, and finds out who is evaluated on what.
    fn entrant(
        &self,
        registry: &Registry,
        foreign: Option<&Foreign<'_>>,
        report: &mut dyn Report,
    ) -> Result<Entrant, TaskError> {
        self.check(registry)?;
        let missing = || Message::about_setting("manifest", "must be given");
        let manifest = self.manifest.as_ref().ok_or_else(missing)?.read()?;
        Entrant::new(registry, manifest, &self.policy, self.policy_seed, self.plan_steps, foreign, report)
    }

    /// The values that factors get, and the changes that these are.
    fn changes(&self, entrant: &Entrant) -> Result<(Values, Vec<Change>), TaskError> {
        let Entrant { manifest, entry, .. } = entrant;
        let config = EnvConfig { image: None, settings: manifest.settings.clone() };
        let factors = entry.make(&config)?.spec().factors.clone();
        if let Some(name) = unknown_factor(&factors, &self.factors) {
            let setting = Assignment::of("factors", json!([name]));
            return Err(no_factor(setting, &name, entry, &factors).into());
        }
        let values = match self.values.as_str() {
            "extremes" => Values::Extremes,
            "grid" => Values::Grid(self.points.unwrap_or_else(|| grid_points(&factors, &self.factors))),
            _ => Values::Sampled,
        };
        let changes = changes(&factors, &self.factors, values);
        Ok((
            values,
            changes.map_err(|error| Message::about("factors", json!(self.factors), error.to_string()))?,
        ))
    }
}

#[cfg(test)]
mod tests;
