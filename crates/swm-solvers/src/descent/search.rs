//! The sequences of a descent: where they are, what they cost, how they step.

use std::time::Instant;

use rayon::prelude::*;
use swm_core::Space;

use super::rules::Rule;
use super::settings::{Descent, GradClip};
use super::simplex::project_to_simplex;
use crate::bounds::{box_bounds, clamp, fill_bounds};
use crate::cost::{Cost, Outputs, check_gradients};
use crate::error::PlanError;
use crate::problem::{Candidates, Plan, PlanKey, Problem, first_cheapest};
use crate::sampling::Noise;
use crate::space::groups;
use crate::trace::{Iteration, Trace};
use crate::workspace::{Workspace, is_past};

/// The feasible set of plans.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Limits<'a> {
    /// The bounds of real actions, if plans are clipped.
    Box { bounds: (&'a [f64], &'a [f64]), clip: bool },
    /// Probabilities of the categories of integer actions.
    Simplex(&'a Space),
}

impl<'a> Limits<'a> {
    /// Of real actions; other actions are refused.
    pub(crate) fn of_box(solver: &'static str, space: &'a Space, clip: bool) -> Result<Self, PlanError> {
        Ok(Self::Box { bounds: box_bounds(solver, space)?, clip })
    }
}

/// S sequences for each of B episodes.
pub(crate) struct Search<'a, 'w> {
    pub(crate) solver: &'static str,
    pub(crate) descent: &'a Descent,
    pub(crate) rule: Rule,
    limits: Limits<'a>,
    problem: &'a Problem<'a>,
    /// `[B, S, H, D]`: the plans.
    pub(crate) points: &'w mut [f32],
    /// `[B, S, H, D]`: gradient of the objective.
    pub(crate) gradient: &'w mut [f32],
    /// `[B, S, H, D]` each: state of the optimizer.
    memories: [&'w mut [f32]; 2],
    /// `[B, S]`: costs; infinite where a sequence has stopped.
    pub(crate) costs: &'w mut [f64],
    /// `[B, S]`: 1 where a sequence has stopped, because its cost or gradient was not finite.
    stopped: &'w mut [u32],
    /// `[H, D]` each.
    low: &'w mut [f32],
    high: &'w mut [f32],
    /// `[B, H, D]` and `[B]`: the cheapest plans so far.
    pub(crate) best: &'w mut [f32],
    pub(crate) best_costs: &'w mut [f64],
    /// Additional values of the solver.
    pub(crate) extra: &'w mut [f64],
    deadline: Option<Instant>,
}

impl<'a, 'w> Search<'a, 'w> {
    /// Starts at the initial plan and around it. `extra` values are for the solver.
    pub(crate) fn begin(
        solver: &'static str,
        (descent, rule, limits): (&'a Descent, Rule, Limits<'a>),
        problem: &'a Problem<'a>,
        workspace: &'w mut Workspace,
        extra: usize,
    ) -> Result<Self, PlanError> {
        problem.check_samples(descent.samples)?;
        let deadline = workspace.deadline;
        let (episodes, size, samples) = (problem.keys.len(), problem.plan_size(), descent.samples);
        let all = episodes * samples * size;
        let [points, gradient, first, second, low, high, best] =
            workspace.floats.cut([all, all, all, all, size, size, episodes * size]);
        let [costs, best_costs, extra] = workspace.doubles.cut([episodes * samples, episodes, extra]);
        let [stopped] = workspace.indices.cut([episodes * samples]);
        let memories = [first, second];
        low.fill(f32::NEG_INFINITY);
        high.fill(f32::INFINITY);
        best_costs.fill(f64::INFINITY);
        if let Limits::Box { bounds, clip } = limits {
            fill_bounds(bounds, clip, low, high);
        }
        let noise = Noise { purpose: solver, seed: descent.seed };
        scatter(problem, (noise, descent.sigma, samples), [low, high], points);
        Ok(Self {
            solver,
            descent,
            rule,
            limits,
            problem,
            points,
            gradient,
            memories,
            costs,
            stopped,
            low,
            high,
            best,
            best_costs,
            extra,
            deadline,
        })
    }

    /// Begins the search.
    pub(crate) fn open(&self, trace: &mut dyn Trace, plan: &mut Plan) {
        plan.begin(self.problem, 0.0);
        trace.begin(self.solver, self.problem);
    }

    fn noise(&self) -> Noise {
        Noise { purpose: self.solver, seed: self.descent.seed }
    }

    /// H × D.
    fn size(&self) -> usize {
        self.problem.plan_size()
    }

    /// The plans, to be evaluated.
    pub(crate) fn candidates(&self) -> Candidates<'_> {
        self.problem.candidates(self.points, self.descent.samples)
    }

    /// Stops the sequences whose cost or, if there is one, gradient is not finite. If all sequences of an episode are stopped
    /// and none had a finite cost before, that is an error.
    pub(crate) fn screen(
        &mut self,
        iteration: usize,
        with_gradient: bool,
        non_finite: &mut [u64],
    ) -> Result<(), PlanError> {
        let (size, samples) = (self.size(), self.descent.samples);
        let stopped = self.stopped.chunks_exact_mut(samples).zip(self.costs.chunks_exact_mut(samples));
        let gradients = self.gradient.chunks_exact_mut(samples * size);
        for (episode, ((stopped, costs), gradients)) in stopped.zip(gradients).enumerate() {
            let sequences = stopped.iter_mut().zip(costs).zip(gradients.chunks_exact_mut(size));
            for ((stopped, cost), gradient) in sequences {
                let usable = cost.is_finite() && !(with_gradient && gradient.iter().any(|g| !g.is_finite()));
                if *stopped == 0 && !usable {
                    *stopped = 1;
                    non_finite[episode] += 1;
                }
                if *stopped == 1 {
                    *cost = f64::INFINITY;
                    gradient.fill(0.0);
                }
            }
            if stopped.iter().all(|&stopped| stopped == 1) && self.best_costs[episode].is_infinite() {
                let PlanKey { episode, plan, .. } = self.problem.keys[episode];
                return Err(PlanError::NoFiniteCost { episode, plan, iteration, samples });
            }
        }
        Ok(())
    }

    /// The cheapest sequence of episode `episode`, the first of equals.
    pub(crate) fn cheapest(&self, episode: usize) -> usize {
        let samples = self.descent.samples;
        first_cheapest(&self.costs[episode * samples..][..samples])
    }

    /// Sequence `sample` of episode `episode`: `[H, D]`.
    pub(crate) fn point(&self, episode: usize, sample: usize) -> &[f32] {
        let size = self.size();
        &self.points[(episode * self.descent.samples + sample) * size..][..size]
    }

    /// Keeps the cheapest plans so far.
    fn remember(&mut self) {
        let size = self.size();
        for episode in 0..self.problem.keys.len() {
            let sample = self.cheapest(episode);
            let index = episode * self.descent.samples + sample;
            if self.costs[index] < self.best_costs[episode] {
                self.best_costs[episode] = self.costs[index];
                self.best[episode * size..][..size].copy_from_slice(&self.points[index * size..][..size]);
            }
        }
    }

    /// Reports iteration `number`.
    pub(crate) fn show(&self, number: usize, trace: &mut dyn Trace) {
        let done = Iteration::new(number, self.problem.keys, self.candidates(), self.costs);
        trace.iteration(&done.with_gradient(self.gradient));
    }

    /// Whether the solve's time is over.
    pub(crate) fn is_out_of_time(&self) -> bool {
        is_past(self.deadline)
    }

    /// Resets the optimizer.
    pub(crate) fn restart(&mut self) {
        self.memories.iter_mut().for_each(|memory| memory.fill(0.0));
    }

    /// One step of every sequence that is not stopped: step `number`, from 1, since the optimizer began; noise is that of
    /// `iteration`, from 0.
    pub(crate) fn step(&mut self, number: usize, iteration: usize) {
        let (noise, size, samples) = (self.noise(), self.size(), self.descent.samples);
        let Self { descent, rule, limits, problem, points, gradient, memories, stopped, low, high, .. } =
            self;
        let (limits, low, high, keys) = (&*limits, &**low, &**high, problem.keys);
        let shared = (descent.grad_clip_mode == GradClip::Global && descent.grad_clip > 0.0)
            .then(|| clip_factor(gradient, descent.grad_clip));
        let [first, second] = memories;
        let sequences = (
            points.par_chunks_exact_mut(size),
            gradient.par_chunks_exact_mut(size),
            first.par_chunks_exact_mut(size),
            second.par_chunks_exact_mut(size),
            &**stopped,
        );
        let sequences = sequences.into_par_iter().with_min_len(16).enumerate();
        sequences.for_each(|(index, (point, gradient, first, second, &stopped))| {
            if stopped == 1 {
                return;
            }
            if descent.grad_clip > 0.0 {
                let factor = shared.unwrap_or_else(|| clip_factor(gradient, descent.grad_clip));
                gradient.iter_mut().for_each(|g| *g *= factor);
            }
            rule.step(number as u32, point, gradient, [first, second]);
            // The gradient is used up: its memory is free.
            if descent.action_noise > 0.0 {
                let (key, sample) = (&keys[index / samples], (index % samples) as u32);
                noise.fill(key, 1 + iteration as u32, sample, gradient);
                let scale = descent.action_noise as f32;
                point.iter_mut().zip(&*gradient).for_each(|(value, noise)| *value += scale * noise);
            }
            match limits {
                Limits::Box { .. } => clamp(point, low, high),
                Limits::Simplex(space) => project_groups(space, point, gradient),
            }
        });
    }

    /// Descends from the starts and writes the cheapest sequence of every episode to `plan`.
    pub(crate) fn run(
        &mut self,
        cost: &mut dyn Cost,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        check_gradients(cost, self.solver)?;
        self.open(trace, plan);
        let mut made = 0;
        for iteration in 0..self.descent.iterations {
            let candidates = self.problem.candidates(self.points, self.descent.samples);
            let gradient = Some(&mut *self.gradient);
            cost.evaluate(&candidates, &mut Outputs { gradient, ..Outputs::new(self.costs) })?;
            self.screen(iteration, true, &mut plan.non_finite)?;
            if self.descent.track_best {
                self.remember();
            }
            self.show(iteration, trace);
            self.step(iteration + 1, iteration);
            made = iteration + 1;
            if self.is_out_of_time() {
                break;
            }
        }
        plan.iterations.fill(made as u32);
        let candidates = self.problem.candidates(self.points, self.descent.samples);
        cost.evaluate(&candidates, &mut Outputs::new(self.costs))?;
        self.screen(made, false, &mut plan.non_finite)?;
        self.write_cheapest(plan);
        // Where other solvers report the cost of their elites, the reference reports this.
        plan.elite_mean_last.copy_from_slice(&plan.cost_of_returned);
        Ok(())
    }

    /// Writes the cheapest sequence of every episode to `plan`.
    pub(crate) fn write_cheapest(&self, plan: &mut Plan) {
        let size = self.size();
        for (episode, actions) in plan.actions.chunks_exact_mut(size).enumerate() {
            let sample = self.cheapest(episode);
            actions.copy_from_slice(self.point(episode, sample));
            plan.cost_of_returned[episode] = self.costs[episode * self.descent.samples + sample];
        }
        if self.descent.track_best {
            plan.replace_by_cheaper(self.best, self.best_costs);
        }
    }
}

/// Fills `points`, `[B, S, H, D]`, with starts: the initial plan, and others around it at a distance of `sigma`, within
/// bounds `[H, D]`.
pub(crate) fn scatter(
    problem: &Problem<'_>,
    (noise, sigma, samples): (Noise, f64, usize),
    [low, high]: [&[f32]; 2],
    points: &mut [f32],
) {
    let (size, sigma) = (problem.plan_size(), sigma as f32);
    points.par_chunks_exact_mut(size).with_min_len(16).enumerate().for_each(|(index, point)| {
        let (episode, sample) = (index / samples, index % samples);
        let initial = &problem.initial[episode * size..][..size];
        if sample == 0 {
            point.copy_from_slice(initial);
        } else {
            noise.fill(&problem.keys[episode], 0, sample as u32, point);
            point.iter_mut().zip(initial).for_each(|(value, start)| *value = start + sigma * *value);
        }
        clamp(point, low, high);
    });
}

/// The factor that scales a gradient to a norm of at most `longest`. The constant is the reference's.
fn clip_factor(gradient: &[f32], longest: f64) -> f32 {
    let length = gradient.iter().map(|&g| f64::from(g) * f64::from(g)).sum::<f64>().sqrt();
    (longest / (length + 1e-6)).min(1.0) as f32
}

/// Projects every group of categories of a plan onto its simplex. `scratch` is as long as the plan.
pub(crate) fn project_groups(space: &Space, plan: &mut [f32], scratch: &mut [f32]) {
    for group in groups(space, plan) {
        let scratch = &mut scratch[..group.len()];
        project_to_simplex(group, scratch);
    }
}
