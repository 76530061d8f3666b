//! A trained world model for `swm quality`: latents of recorded steps, and predictions from them.
//!
//! A prediction spans the frame skip F of the model, and sees the latent before it alone, as that of a plan's first step does
//! where an episode begins: what a history of more frames, or the last action, would add is not measured.

use swm_core::env::PIXELS;
use swm_core::evaluate::quality::WorldModel;
use swm_core::{Batch, BoxError, Row};

use super::planning::{bytes, scaled, size_of, vector};
use crate::baseline::{Baseline, InputSpec, PlanModel};
use crate::data::{Images, Observations, Vectors};
use crate::train::{ACTION, DataConfig, PROPRIO, Scale};

/// A trained world model by its latents.
pub struct LatentModel {
    network: Box<dyn PlanModel>,
    frameskip: usize,
    action: Scale,
    proprio: Option<Scale>,
    latents: Vec<f32>,
    actions: Vec<f32>,
}

impl LatentModel {
    /// A model as it is now, which is trained on data of this form; `None` if it predicts nothing.
    pub fn of(baseline: &dyn Baseline, data: &DataConfig) -> Option<Self> {
        Self::with_network(baseline.planner()?, baseline.input_spec(), data)
    }

    /// As [`Self::of`], with the planner of a model that takes such inputs; `None` without a scale of actions.
    pub fn with_network(
        network: Box<dyn PlanModel>,
        input_spec: &InputSpec,
        data: &DataConfig,
    ) -> Option<Self> {
        let scale = |column: &str| data.scales.get(column).cloned();
        let (action, proprio) = (scale(ACTION)?, input_spec.proprio.then(|| scale(PROPRIO)).flatten());
        let frameskip = input_spec.frameskip;
        Some(Self { network, frameskip, action, proprio, latents: Vec::new(), actions: Vec::new() })
    }

    fn encode_seen(
        &mut self,
        pixels: &[u8],
        [height, width]: [usize; 2],
        proprio: &[f32],
        latents: &mut [f64],
    ) -> Result<(), BoxError> {
        let rows = latents.len() / self.network.latent_dim().max(1);
        let seen = Observations {
            pixels: Images { values: pixels, rows, steps: 1, height, width, channels_last: true },
            proprio: self.proprio.as_ref().map(|scale| Vectors {
                values: proprio,
                rows,
                steps: 1,
                dim: scale.mean.len(),
            }),
        };
        self.latents.resize(latents.len(), 0.0);
        self.network.encode(&seen, &mut self.latents)?;
        widen(&self.latents, latents);
        Ok(())
    }

    fn push_proprio(&self, row: Row<'_>, out: &mut Vec<f32>) -> Result<(), BoxError> {
        if let Some(scale) = &self.proprio {
            scaled(scale, vector(row, PROPRIO)?, out);
        }
        Ok(())
    }
}

impl WorldModel for LatentModel {
    fn latent_dim(&self) -> usize {
        self.network.latent_dim()
    }

    fn stride(&self) -> usize {
        self.frameskip
    }

    fn encode(&mut self, row: Row<'_>, latent: &mut [f64]) -> Result<(), BoxError> {
        let mut proprio = Vec::new();
        self.push_proprio(row, &mut proprio)?;
        self.encode_seen(bytes(row, PIXELS)?, size_of(row, PIXELS)?, &proprio, latent)
    }

    fn predict(&mut self, latent: &mut [f64], action: &[f64]) -> Result<(), BoxError> {
        self.predict_rows(latent, action)
    }

    fn encode_rows(&mut self, rows: &Batch, latents: &mut [f64]) -> Result<(), BoxError> {
        if rows.rows() == 0 {
            return Ok(());
        }
        let mut proprio = Vec::new();
        (0..rows.rows()).try_for_each(|row| self.push_proprio(rows.row(row), &mut proprio))?;
        let size = size_of(rows.row(0), PIXELS)?;
        self.encode_seen(rows.get(PIXELS)?, size, &proprio, latents)
    }

    fn predict_rows(&mut self, latents: &mut [f64], actions: &[f64]) -> Result<(), BoxError> {
        let Self { network, action, latents: narrow, actions: taken, .. } = self;
        narrow.clear();
        narrow.extend(latents.iter().map(|&value| value as f32));
        taken.clear();
        taken.extend(actions.iter().map(|&value| value as f32));
        action.apply(taken);
        network.predict(narrow, taken)?;
        widen(narrow, latents);
        Ok(())
    }
}

fn widen(from: &[f32], to: &mut [f64]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to = f64::from(*from));
}
