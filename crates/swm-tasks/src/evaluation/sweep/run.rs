//! Running a sweep: all of it, or the part of it that is a ledger's range.

use std::collections::BTreeMap;

use serde_json::Value as Json;
use swm_core::evaluate::{EpisodeResult, PairedTest, Summary};
use swm_core::{EnvEntry, Manifest, Registry, ResetOptions};

use super::trial::Trial;
use super::{Cell, Change, SWEEP_VERSION, Scope, Sweep, Values};
use crate::error::TaskError;
use crate::evaluation::cells::CellLedger;
use crate::evaluation::files::env_of;
use crate::evaluation::probe::{Fingerprints, fingerprints};
use crate::evaluation::receipt::Code;
use crate::evaluation::resume::identity;
use crate::evaluation::run::{Candidate, ForeignPolicy, RunOptions, run_pairs};

/// A sweep to be run. Its cells are the unchanged environment and every change, in this order.
pub struct SweepRun<'a> {
    registry: &'a Registry,
    manifest: &'a Manifest,
    candidate: &'a Candidate,
    changes: Vec<Change>,
    values: Values,
    options: RunOptions,
    resets: Vec<ResetOptions>,
    trial: Trial,
    steps: u64,
    /// Description and files of the policy, where they are known.
    described: Option<(String, BTreeMap<String, String>)>,
}

/// How the pairs of a cell are reset.
struct CellPairs {
    /// A reset per pair of the manifest.
    resets: Vec<ResetOptions>,
    /// The pairs that can have the values.
    pairs: Vec<u64>,
    /// Why others cannot.
    note: Option<String>,
}

impl<'a> SweepRun<'a> {
    /// Prepares a sweep over `changes`; see [`changes`](super::changes()).
    ///
    /// # Errors
    ///
    /// The environment is unknown or cannot be made, or the manifest's resets are not its own.
    pub fn new(
        registry: &'a Registry,
        manifest: &'a Manifest,
        candidate: &'a Candidate,
        changes: Vec<Change>,
        values: Values,
        options: RunOptions,
    ) -> Result<Self, TaskError> {
        let entry = env_of(registry, manifest)?;
        Ok(Self {
            registry,
            manifest,
            candidate,
            changes,
            values,
            options,
            resets: manifest.resets()?,
            trial: Trial::new(entry, manifest)?,
            steps: candidate.plan_steps(registry, entry, manifest),
            described: None,
        })
    }

    /// The same with a policy of this description, whose files have these SHA-256 by name, and whose plans have so many actions. A
    /// policy that the registry does not have is described so, and is given to the runs.
    #[must_use]
    pub fn described(self, description: String, files: BTreeMap<String, String>, steps: u64) -> Self {
        Self { steps, described: Some((description, files)), ..self }
    }

    /// The number of cells.
    pub fn cells(&self) -> u64 {
        self.changes.len() as u64 + 1
    }

    /// The number of pairs of each cell.
    pub fn pairs(&self) -> u64 {
        self.resets.len() as u64
    }

    /// What the episodes of a ledger belong to.
    ///
    /// # Errors
    ///
    /// The environment cannot be made or stepped.
    pub fn identity(&self) -> Result<Vec<Json>, TaskError> {
        let entry = env_of(self.registry, self.manifest)?;
        let names = self.changes.iter().map(|change| (change.name.clone(), change.value.clone()));
        let fingerprints: Fingerprints = fingerprints(entry, self.manifest, self.candidate.seed)?;
        let names: Vec<(String, String)> = names.collect();
        let parts = (self.manifest.hash(), &self.candidate, fingerprints, self.steps, self.values, names);
        identity(&parts, &self.files(entry)?)
    }

    /// SHA-256 of every file that the policy depends on.
    fn files(&self, entry: &EnvEntry) -> Result<BTreeMap<String, String>, TaskError> {
        match &self.described {
            Some((_, files)) => Ok(files.clone()),
            None => self.candidate.files(self.registry, entry),
        }
    }

    /// Evaluates the episodes of the ledger's range, by `foreign` where the registry does not have the policy. `each` is called with
    /// the name of every cell that has some.
    ///
    /// # Errors
    ///
    /// As of [`SweepRun::run`].
    pub fn run_part(
        &mut self,
        ledger: &mut CellLedger,
        mut foreign: Option<&mut ForeignPolicy<'_>>,
        mut each: impl FnMut(&str),
    ) -> Result<(), TaskError> {
        for cell in 0..self.cells() {
            if !ledger.wanted(cell).is_empty() {
                let pairs = self.admit(cell)?;
                self.evaluate(ledger, foreign.as_deref_mut(), cell, &pairs)?;
                each(cell.checked_sub(1).map_or("unchanged", |change| &self.changes[change as usize].name));
            }
        }
        Ok(())
    }

    /// Evaluates what the ledger does not know, by `foreign` where the registry does not have the policy. `each` is called after every
    /// cell.
    ///
    /// # Errors
    ///
    /// The policy cannot be made, an episode fails, the ledger cannot be written, or it is a joined one and lacks episodes. A
    /// change that cannot be is a cell with a note; one that can be in some pairs, or nearly, is evaluated so.
    pub fn run(
        mut self,
        ledger: &mut CellLedger,
        mut foreign: Option<&mut ForeignPolicy<'_>>,
        mut each: impl FnMut(&Cell),
    ) -> Result<Sweep, TaskError> {
        let entry = env_of(self.registry, self.manifest)?;
        let policy = match &self.described {
            Some((description, _)) => description.clone(),
            None => self.candidate.make(self.registry, entry, self.manifest)?.describe(),
        };
        let files = self.files(entry)?;
        let unchanged = self.admit(0)?;
        let base = self.evaluate(ledger, foreign.as_deref_mut(), 0, &unchanged)?;
        let mut cells = vec![Cell {
            summary: Some(Summary::of(&base)),
            successes: successes(&base),
            ..Cell::new("unchanged", Scope::Unchanged, "")
        }];
        each(&cells[0]);
        for number in 1..self.cells() {
            let admitted = self.admit(number)?;
            let change = &self.changes[number as usize - 1];
            let mut cell = Cell::new(&change.name, change.scope, &change.value);
            let mut notes: Vec<String> = admitted.note.iter().cloned().collect();
            if !admitted.pairs.is_empty() {
                let episodes = self.evaluate(ledger, foreign.as_deref_mut(), number, &admitted)?;
                let pairs: Vec<usize> = admitted.pairs.iter().map(|&pair| pair as usize).collect();
                let before: Vec<EpisodeResult> = pairs.iter().map(|&pair| base[pair].clone()).collect();
                let same = |(a, b): (&EpisodeResult, &EpisodeResult)| {
                    (a.success, a.steps, &a.decisions, a.final_cost)
                        == (b.success, b.steps, &b.decisions, b.final_cost)
                };
                let is_sampled = |reset: &ResetOptions| change.is_sampled_in(&self.trial.factors, reset);
                if self.resets.iter().all(is_sampled) {
                    notes.push("nothing changes: the unchanged episodes sample it, too".to_owned());
                } else if before.iter().zip(&episodes).all(same) {
                    notes.push("every episode goes as without the change".to_owned());
                }
                cell.successes = successes(&episodes);
                cell.summary = Some(Summary::of(&episodes));
                cell.test = Some(PairedTest::of(&cell.successes, &successes(&before)));
                if pairs.len() < base.len() {
                    cell.pairs = pairs;
                }
            }
            cell.note = (!notes.is_empty()).then(|| notes.join("; "));
            each(&cell);
            cells.push(cell);
        }
        Ok(Sweep {
            sweep: SWEEP_VERSION,
            env: self.manifest.env.clone(),
            manifest_hash: self.manifest.hash(),
            tier: self.manifest.tier.name().to_owned(),
            candidate: self.candidate.clone(),
            policy,
            files,
            values: self.values,
            code: Code::this(),
            cells,
        })
    }

    /// Finds out which pairs can have the values of a cell.
    fn admit(&mut self, cell: u64) -> Result<CellPairs, TaskError> {
        let all = self.pairs();
        let Some(change) = cell.checked_sub(1).map(|change| &self.changes[change as usize]) else {
            return Ok(CellPairs { resets: self.resets.clone(), pairs: (0..all).collect(), note: None });
        };
        let tried = self.trial.admit(self.manifest, &self.resets, change)?;
        Ok(CellPairs {
            resets: tried.resets(&self.resets),
            pairs: tried.pairs().into_iter().map(|pair| pair as u64).collect(),
            note: tried.note(self.resets.len()),
        })
    }

    /// The episodes of a cell, in the order of its pairs: those of the ledger's range are run where they are not known.
    fn evaluate(
        &self,
        ledger: &mut CellLedger,
        foreign: Option<&mut ForeignPolicy<'_>>,
        cell: u64,
        CellPairs { resets, pairs, .. }: &CellPairs,
    ) -> Result<Vec<EpisodeResult>, TaskError> {
        let (wanted, known) = (ledger.wanted(cell), ledger.known(cell));
        let here = pairs.iter().copied().filter(|pair| wanted.contains(pair));
        let options = RunOptions { pairs: Some(here.collect()), ..self.options.clone() };
        let each = |pair, result: &EpisodeResult| ledger.push(cell, pair, result);
        if let Some(foreign) = foreign {
            return foreign.run_pairs(self.manifest, resets, &options, &known, cell == 0, each);
        }
        let Self { registry, manifest, candidate, steps, .. } = *self;
        run_pairs(registry, manifest, resets, candidate, steps, &options, &known, cell == 0, each)
    }
}

/// Success, episode by episode.
fn successes(episodes: &[EpisodeResult]) -> Vec<bool> {
    episodes.iter().map(|episode| episode.success).collect()
}
