//! Planning with any world model that tells costs scene by scene.
//!
//! Candidates go through the network in groups of a fixed size, each from one scene and filled up where it is not full.
//! So the bits of a cost depend on nothing beside the candidate: not on other scenes, not on threads.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;
use swm_solvers::Candidates;

use crate::baseline::PlanModel;
use crate::data::{Form, Observations, Scenes, Start};
use crate::error::BaselineError;
use crate::latents;
use crate::params::{device_of, host};

/// A network that predicts from one scene what plans lead to.
pub(crate) trait SceneModel: Module + Sync {
    /// Candidates of a group.
    const GROUP: usize;

    /// What all candidates of a scene share.
    type Scene: Send + Sync;

    /// The form of its tensors.
    fn form(&self) -> &Form;

    /// N: how many observations it can make use of.
    fn history(&self) -> usize;

    /// Encodes scene `row` of `start`.
    fn scene(&self, start: &Start, row: usize) -> Self::Scene;

    /// `[C]`: costs of candidates `[C, H, D]` of one scene.
    fn costs(&self, scene: &Self::Scene, plans: Tensor<3>) -> Tensor<1>;

    /// Z: numbers of a latent.
    fn latent_width(&self) -> usize;

    /// `[1, Z]` of one observation: `[1, 1, 3, S, S]`, and `[1, 1, …]` where the model uses it.
    fn latent(&self, pixels: Tensor<5>, proprio: Option<Tensor<3>>) -> Tensor<2>;

    /// `[C, Z]`: what follows latents `[C, Z]` under blocks `[C, D]`, each row apart.
    fn next(&self, latents: Tensor<2>, actions: Tensor<2>) -> Tensor<2>;
}

/// A copy of a model, and what was prepared.
pub(crate) struct Planner<M: SceneModel> {
    model: M,
    device: Device,
    scenes: Vec<M::Scene>,
}

impl<M: SceneModel> Planner<M> {
    /// Of a copy of the model.
    pub(crate) fn new(model: M) -> Self {
        Self { device: device_of(&model), model, scenes: Vec::new() }
    }

    fn groups<'a>(&self, candidates: &Candidates<'a>) -> Result<Groups<'a>, BaselineError> {
        Groups::new(candidates, self.scenes.len(), self.block_width(), M::GROUP)
    }

    fn run(&self, groups: Vec<Group<'_>>) {
        groups.into_par_iter().for_each(|group| {
            let scene = &self.scenes[group.row];
            group.run(&self.device, |plans| self.model.costs(scene, plans));
        });
    }
}

impl<M: SceneModel> PlanModel for Planner<M> {
    fn block_width(&self) -> usize {
        self.model.form().action
    }

    fn history(&self) -> usize {
        self.model.history()
    }

    fn latent_width(&self) -> usize {
        self.model.latent_width()
    }

    fn encode(&mut self, seen: &Observations<'_>, latents: &mut [f32]) -> Result<(), BaselineError> {
        latents::encode(&self.model, seen, latents, &self.device)
    }

    fn predict(&mut self, latents: &mut [f32], actions: &[f32]) -> Result<(), BaselineError> {
        latents::predict(&self.model, latents, actions, &self.device)
    }

    fn prepare(&mut self, scenes: &Scenes<'_>) -> Result<(), BaselineError> {
        let start = Start::new(scenes, self.model.form(), &self.device)?;
        // One by one: the bits of what is known of a scene must not depend on its neighbors.
        self.scenes =
            (0..scenes.pixels.rows).into_par_iter().map(|row| self.model.scene(&start, row)).collect();
        Ok(())
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), BaselineError> {
        self.run(self.groups(candidates)?.of_costs(costs));
        Ok(())
    }

    fn evaluate_with_gradient(
        &mut self,
        candidates: &Candidates<'_>,
        costs: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), BaselineError> {
        self.run(self.groups(candidates)?.of_gradients(costs, gradient));
        Ok(())
    }
}

/// Some candidates of one scene.
struct Group<'a> {
    /// The scene.
    row: usize,
    /// H and D.
    shape: [usize; 2],
    /// C: candidates of a full group.
    size: usize,
    /// `[up to C, H, D]`.
    plans: &'a [f32],
    /// `[up to C]`.
    costs: &'a mut [f64],
    /// `[up to C, H, D]`.
    gradient: Option<&'a mut [f32]>,
}

impl Group<'_> {
    /// Fills its costs, and its gradient if it has one, by a function from `[C, H, D]` to `[C]` that treats candidates
    /// apart. A group that is not full is filled up with zeros.
    fn run(self, device: &Device, costs: impl Fn(Tensor<3>) -> Tensor<1>) {
        let [horizon, width] = self.shape;
        let mut plans = self.plans.to_vec();
        plans.resize(self.size * horizon * width, 0.0);
        let plans = Tensor::<3>::from_data(TensorData::new(plans, [self.size, horizon, width]), device);
        let plans = if self.gradient.is_some() { plans.autodiff().require_grad() } else { plans };
        let found = costs(plans.clone());
        if let Some(out) = self.gradient {
            // Candidates do not interact, so the derivative of the sum holds that of each.
            let gradients = found.clone().sum().backward();
            let gradient = plans.grad(&gradients).map(host).unwrap_or_default();
            out.iter_mut().zip(gradient).for_each(|(out, value)| *out = value);
        }
        self.costs.iter_mut().zip(host(found)).for_each(|(cost, value)| *cost = f64::from(value));
    }
}

/// How candidates are cut into groups.
struct Groups<'a> {
    candidates: Candidates<'a>,
    /// C.
    size: usize,
}

impl<'a> Groups<'a> {
    /// Groups of C = `size`. Checks that the candidates are for so many scenes and blocks of this width.
    fn new(
        candidates: &Candidates<'a>,
        scenes: usize,
        width: usize,
        size: usize,
    ) -> Result<Self, BaselineError> {
        let shape = candidates.shape();
        if candidates.dim != width {
            let reason =
                format!("blocks of {} numbers, and this model was trained on {width}", candidates.dim);
            return Err(BaselineError::data("candidates", reason));
        }
        if candidates.rows != scenes
            || shape.iter().product::<usize>() != candidates.actions.len()
            || shape.contains(&0)
        {
            let reason = format!(
                "{} numbers of shape {shape:?} for {scenes} prepared scenes",
                candidates.actions.len()
            );
            return Err(BaselineError::data("candidates", reason));
        }
        Ok(Self { candidates: *candidates, size })
    }

    /// The groups, each with its costs of `[B, S]`.
    fn of_costs(&self, costs: &'a mut [f64]) -> Vec<Group<'a>> {
        let Candidates { actions, samples, horizon, dim: width, .. } = self.candidates;
        let of_one = horizon * width;
        let rows = costs.chunks_mut(samples).zip(actions.chunks(samples * of_one)).enumerate();
        rows.flat_map(|(row, (costs, plans))| {
            let parts = costs.chunks_mut(self.size).zip(plans.chunks(self.size * of_one));
            parts.map(move |(costs, plans)| Group {
                row,
                shape: [horizon, width],
                size: self.size,
                plans,
                costs,
                gradient: None,
            })
        })
        .collect()
    }

    /// The groups, each with its costs of `[B, S]` and gradients of `[B, S, H, D]`.
    fn of_gradients(&self, costs: &'a mut [f64], gradient: &'a mut [f32]) -> Vec<Group<'a>> {
        let Candidates { samples, horizon, dim: width, .. } = self.candidates;
        let of_one = horizon * width;
        let gradients =
            gradient.chunks_mut(samples * of_one).flat_map(|row| row.chunks_mut(self.size * of_one));
        let groups = self.of_costs(costs).into_iter().zip(gradients);
        groups.map(|(group, gradient)| Group { gradient: Some(gradient), ..group }).collect()
    }
}
