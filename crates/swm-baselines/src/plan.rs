//! Planning with any world model that computes costs per planning problem.
//!
//! On a CPU, candidates go through the network in groups, each from one problem. The bits of a cost depend only on the
//! candidate: not on its group, not on threads. On other devices, all candidates of a problem are one group.

use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;
use swm_solvers::{Aggregate, Candidates, Outputs};

use crate::baseline::PlanModel;
use crate::data::{Observations, PlanningBatch, Start};
use crate::dynamics::{self, LatentDynamics, for_each_group, group_size};
use crate::error::BaselineError;
use swm_nn::params::{device_of, host};
use swm_nn::placement::Placement;

/// A copy of a model, and what was prepared.
pub(crate) struct Planner<M: LatentDynamics> {
    model: M,
    device: Device,
    problems: Vec<M::Problem>,
    aggregate: Aggregate,
}

impl<M: LatentDynamics> Planner<M> {
    /// Of a copy of the model.
    pub(crate) fn new(model: M) -> Self {
        Self { device: device_of(&model), model, problems: Vec::new(), aggregate: Aggregate::Last }
    }

    fn groups<'a>(&self, candidates: &Candidates<'a>) -> Result<Groups<'a>, BaselineError> {
        let size = group_size::<M>(&self.device, candidates.samples);
        Groups::new(candidates, self.problems.len(), self.block_dim(), size)
    }

    fn run(&self, groups: Vec<Group<'_>>) {
        let start = |group: &Group<'_>| {
            let problem = &self.problems[group.row];
            group.start(&self.device, |plans| self.model.costs(problem, plans, self.aggregate))
        };
        match Placement::of(&self.device) {
            Placement::Host => groups.into_par_iter().for_each(|group| {
                let found = start(&group);
                group.finish(found);
            }),
            // The device gets all work before anything waits for it.
            Placement::Device => {
                let started: Vec<_> = groups.into_iter().map(|group| (start(&group), group)).collect();
                started.into_iter().for_each(|(found, group)| group.finish(found));
            }
        }
    }
}

impl<M: LatentDynamics> PlanModel for Planner<M> {
    fn block_dim(&self) -> usize {
        self.model.form().action
    }

    fn history(&self) -> usize {
        self.model.history()
    }

    fn set_aggregate(&mut self, aggregate: Aggregate) {
        self.aggregate = aggregate;
    }

    fn latent_dim(&self) -> usize {
        self.model.latent_dim()
    }

    fn encode(&mut self, seen: &Observations<'_>, latents: &mut [f32]) -> Result<(), BaselineError> {
        dynamics::encode(&self.model, seen, latents, &self.device)
    }

    fn predict(&mut self, latents: &mut [f32], actions: &[f32]) -> Result<(), BaselineError> {
        dynamics::predict(&self.model, latents, actions, &self.device)
    }

    fn step_toward(
        &mut self,
        latents: &[f32],
        actions: &[f32],
        targets: &[f32],
        next: &mut [f32],
        gradient: &mut [f32],
    ) -> Result<(), BaselineError> {
        dynamics::step_toward(&self.model, (latents, actions, targets), next, gradient, &self.device)
    }

    fn rollout(&mut self, candidates: &Candidates<'_>, states: &mut [f32]) -> Result<(), BaselineError> {
        self.groups(candidates)?;
        let &Candidates { actions, samples, horizon, dim, .. } = candidates;
        let (most, values) = (group_size::<M>(&self.device, samples), self.latent_dim());
        if states.len() * dim != actions.len() * values {
            let reason =
                format!("room for {} values of {} actions' states of {values}", states.len(), actions.len());
            return Err(BaselineError::data("states", reason));
        }
        let problems =
            states.chunks_mut(samples * horizon * values).zip(actions.chunks(samples * horizon * dim));
        let groups = problems.enumerate().flat_map(|(row, (states, plans))| {
            let parts = states.chunks_mut(most * horizon * values).zip(plans.chunks(most * horizon * dim));
            parts.map(move |(states, plans)| (row, states, plans))
        });
        for_each_group(
            &self.device,
            groups.collect(),
            |(row, states, plans): (usize, &mut [f32], &[f32])| {
                let plans = plans_of(plans, [horizon, dim], &self.device);
                states.copy_from_slice(&host(self.model.states(&self.problems[row], plans)));
            },
        );
        Ok(())
    }

    fn prepare(&mut self, batch: &PlanningBatch<'_>) -> Result<(), BaselineError> {
        let start = Start::new(batch, self.model.form(), &self.device)?;
        let mut problems: Vec<Option<M::Problem>> = (0..batch.pixels.rows).map(|_| None).collect();
        let rows = problems.iter_mut().enumerate().collect();
        for_each_group(&self.device, rows, |(row, problem)| *problem = Some(self.model.problem(&start, row)));
        self.problems = problems.into_iter().flatten().collect();
        Ok(())
    }

    fn evaluate(
        &mut self,
        candidates: &Candidates<'_>,
        outputs: &mut Outputs<'_>,
    ) -> Result<(), BaselineError> {
        self.run(self.groups(candidates)?.of(outputs));
        Ok(())
    }
}

/// `[C, H, D]`: plans of H blocks of D values.
fn plans_of(plans: &[f32], [horizon, dim]: [usize; 2], device: &Device) -> Tensor<3> {
    let count = plans.len() / (horizon * dim);
    Tensor::from_data(TensorData::new(plans.to_vec(), [count, horizon, dim]), device)
}

/// Some candidates of one planning problem.
struct Group<'a> {
    /// The problem.
    row: usize,
    /// H and D.
    shape: [usize; 2],
    /// `[C, H, D]`.
    plans: &'a [f32],
    /// `[C]`.
    costs: &'a mut [f64],
    /// `[C, H, D]`.
    gradient: Option<&'a mut [f32]>,
}

/// What a group's candidates cost, `[C]`, and the gradient, `[C, H, D]`, if it was asked for.
type Found = (Tensor<1>, Option<Tensor<3>>);

impl Group<'_> {
    /// Computes its costs, and their gradient if it has one, by a function from `[C, H, D]` to `[C]` that treats candidates
    /// apart.
    fn start(&self, device: &Device, costs: impl Fn(Tensor<3>) -> Tensor<1>) -> Found {
        let plans = plans_of(self.plans, self.shape, device);
        if self.gradient.is_none() {
            return (costs(plans), None);
        }
        let plans = plans.autodiff().require_grad();
        let found = costs(plans.clone());
        // Candidates do not interact, so the derivative of the sum holds that of each.
        let gradients = found.clone().sum().backward();
        (found, plans.grad(&gradients))
    }

    /// Fills its costs, and its gradient if it has one.
    fn finish(self, (found, found_gradient): Found) {
        if let Some(out) = self.gradient {
            let gradient = found_gradient.map(host).unwrap_or_default();
            out.iter_mut().zip(gradient).for_each(|(out, value)| *out = value);
        }
        self.costs.iter_mut().zip(host(found)).for_each(|(cost, value)| *cost = f64::from(value));
    }
}

/// How candidates are cut into groups.
struct Groups<'a> {
    candidates: Candidates<'a>,
    size: usize,
}

impl<'a> Groups<'a> {
    /// Checks that the candidates are for so many problems and blocks of this dim.
    fn new(
        candidates: &Candidates<'a>,
        problems: usize,
        dim: usize,
        size: usize,
    ) -> Result<Self, BaselineError> {
        let shape = candidates.shape();
        if candidates.dim != dim {
            let reason = format!("blocks of {} values, and this model was trained on {dim}", candidates.dim);
            return Err(BaselineError::data("candidates", reason));
        }
        if candidates.episodes != problems
            || shape.iter().product::<usize>() != candidates.actions.len()
            || shape.contains(&0)
        {
            let reason = format!(
                "{} values of shape {shape:?} for {problems} prepared problems",
                candidates.actions.len()
            );
            return Err(BaselineError::data("candidates", reason));
        }
        Ok(Self { candidates: *candidates, size })
    }

    /// The groups, each with its part of the outputs.
    fn of(&self, outputs: &'a mut Outputs<'_>) -> Vec<Group<'a>> {
        let Candidates { actions, samples, horizon, dim, .. } = self.candidates;
        let (of_one, most) = (horizon * dim, self.size);
        let Outputs { costs, gradient, .. } = outputs;
        let rows = costs.chunks_mut(samples).zip(actions.chunks(samples * of_one)).enumerate();
        let groups = rows.flat_map(|(row, (costs, plans))| {
            let parts = costs.chunks_mut(most).zip(plans.chunks(most * of_one));
            parts.map(move |(costs, plans)| Group {
                row,
                shape: [horizon, dim],
                plans,
                costs,
                gradient: None,
            })
        });
        let mut groups: Vec<Group<'a>> = groups.collect();
        if let Some(gradient) = gradient {
            let rows = gradient.chunks_mut(samples * of_one);
            let parts = rows.flat_map(|row| row.chunks_mut(most * of_one));
            groups.iter_mut().zip(parts).for_each(|(group, part)| group.gradient = Some(part));
        }
        groups
    }
}
