//! What acts: over latents, and over observations that the world model encodes.

use burn::tensor::{Tensor, TensorData};

use super::{GcIdm, NAME};
use crate::baseline::{GoalPolicy, LatentPolicy, PlanModel};
use crate::data::{Images, Observations, PlanningBatch, Vectors};
use crate::dynamics::for_each_group;
use crate::error::BaselineError;
use swm_nn::params::{device_of, host};
use swm_nn::placement::Placement;

/// A copy of the network.
pub(super) struct OverLatents {
    pub(super) network: GcIdm,
    /// Z and D.
    pub(super) dims: [usize; 2],
}

impl LatentPolicy for OverLatents {
    fn latent_dim(&self) -> usize {
        self.dims[0]
    }

    fn block_dim(&self) -> usize {
        self.dims[1]
    }

    fn horizon(&self) -> usize {
        self.network.action_predictor.horizon()
    }

    fn act(
        &mut self,
        latents: &[f32],
        goals: &[f32],
        left: &[usize],
        actions: &mut [f32],
    ) -> Result<(), BaselineError> {
        let (rows, [dim, block]) = (left.len(), self.dims);
        if latents.len() != rows * dim || goals.len() != rows * dim || actions.len() != rows * block {
            let reason = format!(
                "{} values of latents, {} of goals and room for {} of actions in {rows} rows; {NAME} takes {dim} and {dim}, and gives \
                 {block} per row",
                latents.len(),
                goals.len(),
                actions.len()
            );
            return Err(BaselineError::data("latents", reason));
        }
        let network = &self.network;
        let policy = &network.action_predictor;
        let device = device_of(policy);
        // One by one on a CPU: the bits of a decision must not depend on its neighbors.
        let most = match Placement::of(&device) {
            Placement::Host => 1,
            Placement::Device => rows.max(1),
        };
        let parts = latents.chunks(most * dim).zip(goals.chunks(most * dim));
        let groups = parts.zip(left.chunks(most).zip(actions.chunks_mut(most * block))).collect();
        for_each_group(&device, groups, |((latents, goals), (left, out)): Group<'_>| {
            let look = |values: &[f32]| {
                let data = TensorData::new(values.to_vec(), [left.len(), 1, dim]);
                network.look(Tensor::from_data(data, &device))
            };
            let (from, to) = (look(latents).from, look(goals).to);
            let of_row = |(row, &left): (usize, &usize)| {
                policy.join(from.clone().narrow(0, row, 1), to.clone().narrow(0, row, 1), left)
            };
            let first = Tensor::cat(left.iter().enumerate().map(of_row).collect(), 0);
            out.copy_from_slice(&host(policy.decide(first)));
        });
        Ok(())
    }
}

/// Latents and goals, and decisions left with room for actions.
type Group<'a> = ((&'a [f32], &'a [f32]), (&'a [usize], &'a mut [f32]));

/// The same over images.
pub(super) struct OverImages {
    pub(super) encoder: Box<dyn PlanModel>,
    pub(super) policy: OverLatents,
    pub(super) latents: [Vec<f32>; 2],
}

impl GoalPolicy for OverImages {
    fn block_dim(&self) -> usize {
        self.policy.block_dim()
    }

    fn history(&self) -> usize {
        1
    }

    fn horizon(&self) -> usize {
        self.policy.horizon()
    }

    fn act_within(
        &mut self,
        batch: &PlanningBatch<'_>,
        left: &[usize],
        actions: &mut [f32],
    ) -> Result<(), BaselineError> {
        let &PlanningBatch { pixels, proprio, goal_pixels, goal_proprio, .. } = batch;
        let rows = pixels.rows;
        if pixels.steps != 1 || left.len() != rows {
            let reason = format!(
                "{} observations, and decisions left for {} of {rows} rows; this policy takes one observation per row",
                pixels.steps,
                left.len()
            );
            return Err(BaselineError::data("pixels", reason));
        }
        let dim = self.policy.latent_dim();
        let seen = [(pixels, proprio), (goal_pixels, goal_proprio)];
        for ((pixels, proprio), latents) in seen.into_iter().zip(&mut self.latents) {
            latents.resize(rows * dim, 0.0);
            self.encoder.encode(&Observations { pixels, proprio }, latents)?;
        }
        let [latents, goals] = &self.latents;
        self.policy.act(latents, goals, left, actions)
    }
}

/// Each frame of clips as an observation by itself.
pub(super) fn single<'a>(pixels: &Images<'a>, proprio: Option<&Vectors<'a>>) -> Observations<'a> {
    let rows = pixels.rows * pixels.steps;
    Observations {
        pixels: Images { rows, steps: 1, ..*pixels },
        proprio: proprio.map(|proprio| Vectors { rows: proprio.rows * proprio.steps, steps: 1, ..*proprio }),
    }
}
