//! A trace as JSON lines, one record per line. `docs/solvers.md` describes them for readers.

use std::io::{self, Write};

use serde::Serialize;

use super::records::{IterationRecord, PlanRecord, Records};
use super::{Iteration, Trace};
use crate::problem::{Plan, Problem};

/// How much of each iteration is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Detail {
    /// The figures.
    #[default]
    Figures,
    /// Also the elites and the search distribution.
    Elites,
    /// Also every candidate and its cost: megabytes per plan.
    Candidates,
}

/// Writes a line per plan begun, per iteration, and per plan made. Whole plans reach the writer at once: a run that is
/// killed leaves every plan before.
///
/// A trace cannot fail: the first failure to write is kept for [`JsonLines::finish`], and nothing more is written.
/// The lines hold no times: the same search writes the same bytes.
#[derive(Debug)]
pub struct JsonLines<W> {
    writer: W,
    detail: Detail,
    records: Records,
    failure: Option<io::Error>,
}

/// The beginning of a solve.
#[derive(Serialize)]
struct BeginLine<'a> {
    record: &'static str,
    episode: u64,
    plan: u64,
    seed: i64,
    solver: &'a str,
    horizon: usize,
    action_block: usize,
    action_dim: usize,
    initial: &'a [f32],
}

/// An iteration, with as much detail as requested.
#[derive(Serialize)]
struct IterationLine<'a> {
    record: &'static str,
    #[serde(flatten)]
    figures: IterationRecord,
    #[serde(skip_serializing_if = "Option::is_none")]
    elites: Option<Vec<EliteLine<'a>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mean: Option<&'a [f32]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    std: Option<&'a [f32]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    costs: Option<&'a [f64]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    candidates: Option<Vec<&'a [f32]>>,
}

#[derive(Serialize)]
struct EliteLine<'a> {
    cost: f64,
    actions: &'a [f32],
}

/// The result of a solve.
#[derive(Serialize)]
struct PlanLine<'a> {
    record: &'static str,
    #[serde(flatten)]
    figures: PlanRecord,
    actions: &'a [f32],
}

impl<W: Write> JsonLines<W> {
    /// Writes to `writer`, which is best buffered.
    pub fn new(writer: W, detail: Detail) -> Self {
        Self { writer, detail, records: Records::default(), failure: None }
    }

    /// Flushes.
    ///
    /// # Errors
    ///
    /// The first write that failed since the last call.
    pub fn finish(&mut self) -> io::Result<()> {
        match self.failure.take() {
            Some(error) => Err(error),
            None => self.writer.flush(),
        }
    }

    fn line(&mut self, line: &impl Serialize) {
        self.attempt(|writer| {
            serde_json::to_writer(&mut *writer, line)?;
            writer.write_all(b"\n")
        });
    }

    fn attempt(&mut self, write: impl FnOnce(&mut W) -> io::Result<()>) {
        if self.failure.is_none() {
            self.failure = write(&mut self.writer).err();
        }
    }
}

impl<'a> IterationLine<'a> {
    /// `episode` of `iteration`, whose figures are `figures`.
    fn of(figures: IterationRecord, iteration: &'a Iteration<'a>, episode: usize, detail: Detail) -> Self {
        let candidates = iteration.candidates;
        let size = (candidates.horizon * candidates.dim).max(1);
        let costs = iteration.costs_of(episode);
        let plan = |index: usize| candidates.plan(episode * candidates.samples + index);
        let elite = |elite: u32| EliteLine { cost: costs[elite as usize], actions: plan(elite as usize) };
        let elites = || iteration.elites_of(episode).into_iter().map(elite).collect();
        let (with_elites, with_candidates) = (detail >= Detail::Elites, detail >= Detail::Candidates);
        let of = |values: &'a [f32]| values.chunks_exact(size).nth(episode).filter(|_| with_elites);
        Self {
            record: "iteration",
            figures,
            elites: with_elites.then(elites),
            mean: of(iteration.mean),
            std: of(iteration.std),
            costs: with_candidates.then_some(costs),
            candidates: with_candidates.then(|| (0..candidates.samples).map(plan).collect()),
        }
    }
}

impl<W: Write + Send> Trace for JsonLines<W> {
    fn begin(&mut self, solver: &'static str, problem: &Problem<'_>) {
        self.records.begin(problem);
        for (key, initial) in
            problem.keys.iter().zip(problem.initial.chunks_exact(problem.plan_size().max(1)))
        {
            self.line(&BeginLine {
                record: "begin",
                episode: key.episode,
                plan: key.plan,
                seed: key.seed.value(),
                solver,
                horizon: problem.horizon,
                action_block: problem.action_block,
                action_dim: problem.dim() / problem.action_block.max(1),
                initial,
            });
        }
    }

    fn iteration(&mut self, iteration: &Iteration<'_>) {
        for (episode, figures) in self.records.of(iteration).into_iter().enumerate() {
            self.line(&IterationLine::of(figures, iteration, episode, self.detail));
        }
    }

    fn end(&mut self, problem: &Problem<'_>, plan: &Plan) {
        for (episode, key) in problem.keys.iter().enumerate() {
            let figures = PlanRecord::of(key, plan, episode);
            self.line(&PlanLine { record: "plan", figures, actions: plan.of(episode) });
        }
        self.attempt(W::flush);
    }
}
