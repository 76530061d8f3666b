//! SAC: soft actor-critic (Haarnoja et al. 2018, arXiv 1812.05905), in the order of Stable-Baselines3: temperature, critics,
//! policy, target networks.

mod network;
mod settings;

use std::path::Path;

use burn::tensor::{Device as TensorDevice, Tensor};
use rand::RngExt as _;
use rand_distr::StandardNormal;
use swm_core::LiveEpisode;

use super::agent::{AgentConfig, Observation, OnlineAgent, Transitions};
use super::settings::CollectConfig;
use super::training::{check_form, differentiate, load_optimizer, tensor, trainable};
use crate::baseline::Losses;
use crate::device::Device;
use crate::error::BaselineError;
use crate::learner::follow;
use crate::weights;
use swm_nn::Pass;
use swm_nn::init::initialize;
use swm_nn::losses::Terms;
use swm_nn::optim::{AdamW, Gradients, OptimConfig, Schedule};
use swm_nn::params::{self, host};

pub(crate) use network::{Minibatch, SacNetwork};
pub use settings::SacConfig;
pub(super) use settings::settings;

/// Its name.
pub(super) const NAME: &str = "sac";

/// Two consecutive steps: a transition.
const CLIP_STEPS: usize = 2;
const TARGETS: &[(&str, &str)] = &[("critic", "critic_target")];
/// The name of the temperature's logarithm among the tensors.
const TEMPERATURE: &str = "log_ent_coef";

/// The agent.
pub(crate) struct Sac {
    config: AgentConfig,
    settings: SacConfig,
    optim: OptimConfig,
    network: SacNetwork,
    /// Of all three losses: each changes tensors of its own.
    optimizer: AdamW,
    device: TensorDevice,
}

impl Sac {
    /// Samples the initial weights, after checking the settings.
    pub(crate) fn new(config: AgentConfig, device: Device) -> Result<Self, BaselineError> {
        let settings = SacConfig::parse(&config.settings)?;
        let device = device.device()?;
        let dims = [config.observation_dim, config.action_dim];
        let network = initialize(SacNetwork::new(dims, settings.hidden, &device), config.seed);
        let network = follow(network, TARGETS, 0.0);
        Ok(Self::with(config, settings, network, device))
    }

    pub(crate) fn with(
        config: AgentConfig,
        settings: SacConfig,
        network: SacNetwork,
        device: TensorDevice,
    ) -> Self {
        let optim = OptimConfig {
            lr: settings.lr,
            weight_decay: 0.0,
            clip: None,
            schedule: Schedule::Constant,
            ..OptimConfig::default()
        };
        Self { config, settings, optim, network, optimizer: AdamW::default(), device }
    }

    pub(crate) fn minibatch(&self, clips: &Transitions<'_>) -> Result<Minibatch, BaselineError> {
        let [observation, action] = [self.config.observation_dim, self.config.action_dim];
        let Transitions { rows, steps, .. } = *clips;
        let given = [clips.observation, clips.action, clips.reward, clips.terminated].map(<[f32]>::len);
        let wanted = [observation, action, 1, 1].map(|dim| rows * CLIP_STEPS * dim);
        if steps != CLIP_STEPS || given != wanted {
            let reason =
                format!("{given:?} values in {rows} clips of {steps} steps; SAC takes {wanted:?} in 2");
            return Err(BaselineError::data("observation", reason));
        }
        let step = |values: &[f32], dim: usize, step: usize| {
            let of = values.chunks_exact(CLIP_STEPS * dim).flat_map(|clip| &clip[step * dim..][..dim]);
            tensor(of.copied().collect(), [rows, dim], &self.device)
        };
        Ok(Minibatch {
            observation: self.network.normalize(step(clips.observation, observation, 0)),
            action: step(clips.action, action, 0),
            reward: step(clips.reward, 1, 1),
            next: self.network.normalize(step(clips.observation, observation, 1)),
            goes_on: step(clips.terminated, 1, 1) * -1.0 + 1.0,
        })
    }

    /// One step along the gradient of `loss` with respect to the tensors below `trains`.
    fn descend(
        &mut self,
        trains: &[&str],
        index: u64,
        loss: impl FnOnce(&SacNetwork) -> Terms,
    ) -> Result<Losses, BaselineError> {
        let tracked = params::track(&self.network, trains);
        let (losses, gradients) = differentiate(&tracked, loss(&tracked), index)?;
        self.apply(gradients);
        Ok(losses)
    }

    fn apply(&mut self, gradients: Gradients) {
        self.network = self.optimizer.step(self.network.clone(), gradients, &self.optim, self.optim.lr);
    }

    /// An update with given noise, `[B, A]` each, for the actions of this step and of the next.
    pub(crate) fn update_with(
        &mut self,
        batch: &Minibatch,
        [now, next]: [Tensor<2>; 2],
        index: u64,
    ) -> Result<Losses, BaselineError> {
        let temperature = self.network.temperature();
        let [_, density] = self.network.sample(batch.observation.clone(), now.clone());
        // The gradient of −log α (log π + target entropy) with respect to log α.
        let gradient = -(host(density.mean())[0] + self.settings.target_entropy(self.config.action_dim));
        let discount = self.settings.discount;
        let specs = params::specs(&self.network);
        let gradient = specs.iter().map(|spec| (spec.name == TEMPERATURE).then(|| vec![gradient]));
        self.apply(Gradients::Host(gradient.collect()));
        let critic = self
            .descend(&["critic"], index, |network| network.critic_loss(batch, temperature, discount, next))?;
        let actor = self.descend(&["actor"], index, |network| network.actor_loss(batch, temperature, now))?;
        self.network = follow(self.network.clone(), TARGETS, 1.0 - self.settings.tau);
        let mut parts = critic.parts;
        parts.push(("actor_loss", actor.total));
        parts.extend(actor.parts);
        parts.push(("temperature", temperature as f32));
        Ok(Losses { total: critic.total, parts })
    }
}

impl OnlineAgent for Sac {
    fn config(&self) -> &AgentConfig {
        &self.config
    }

    fn collect(&self) -> &CollectConfig {
        &self.settings.collect
    }

    fn clip_steps(&self) -> usize {
        CLIP_STEPS
    }

    fn batch(&self) -> usize {
        self.settings.batch
    }

    fn parameters(&self) -> usize {
        trainable(&self.network, TARGETS)
    }

    fn observe(&mut self, observations: &[f32]) {
        let dim = self.config.observation_dim;
        let rows = observations.len() / dim;
        let [mut mean, mut variance, count] = self.network.statistics();
        let (before, more) = (f64::from(count[0]), rows as f64);
        let all = before + more;
        for (index, (mean, variance)) in mean.iter_mut().zip(&mut variance).enumerate() {
            let values = || observations.iter().skip(index).step_by(dim).map(|value| f64::from(*value));
            let new_mean = values().sum::<f64>() / more;
            let new_variance = values().map(|value| (value - new_mean).powi(2)).sum::<f64>() / more;
            // Two sets become one: Chan, Golub and LeVeque (1979).
            let apart = new_mean - f64::from(*mean);
            let squares = f64::from(*variance) * before + new_variance * more;
            *variance = ((squares + apart * apart * before * more / all) / all) as f32;
            *mean = (f64::from(*mean) + apart * more / all) as f32;
        }
        let new = [("running_mean", mean), ("running_var", variance), ("running_count", vec![all as f32])];
        self.network = params::map(self.network.clone(), |spec, tensor| {
            let found = new.iter().find(|(name, _)| spec.name == format!("observation.{name}"));
            found.map_or(tensor.clone(), |(_, values)| params::from_host(spec, values.clone(), &tensor))
        });
    }

    fn act(
        &mut self,
        _slot: usize,
        episode: &LiveEpisode,
        explore: bool,
        observation: &Observation<'_>,
        action: &mut [f32],
    ) -> Result<(), BaselineError> {
        check_form(&self.config, observation, action)?;
        let shape = [1, self.config.observation_dim];
        let observation = self.network.normalize(tensor(observation.vector.to_vec(), shape, &self.device));
        let chosen = if explore {
            let outputs = self.config.action_dim;
            let mut stream = episode.seed.indexed("agent exploration", [episode.step, 0]);
            let noise = (0..outputs).map(|_| stream.sample(StandardNormal)).collect();
            let [action, _] = self.network.sample(observation, tensor(noise, [1, outputs], &self.device));
            action
        } else {
            self.network.best_action(observation)
        };
        action.copy_from_slice(&host(chosen));
        Ok(())
    }

    fn update(&mut self, clips: &Transitions<'_>, index: u64) -> Result<Losses, BaselineError> {
        let batch = self.minibatch(clips)?;
        let mut pass = Pass::train_on(&self.device, self.config.seed, index);
        let noise = [0; 2].map(|_| pass.normal([clips.rows, self.config.action_dim], &self.device));
        self.update_with(&batch, noise, index)
    }

    fn save_weights(&self, path: &Path) -> Result<(), BaselineError> {
        weights::save_network(&self.network, path)
    }

    fn load_weights(&mut self, path: &Path) -> Result<(), BaselineError> {
        self.network = weights::load_network(&self.network, path)?;
        Ok(())
    }

    fn save_training(&self, path: &Path) -> Result<(), BaselineError> {
        Ok(swm_weights::write(path, self.optimizer.to_host(&self.network))?)
    }

    fn load_training(&mut self, path: &Path) -> Result<(), BaselineError> {
        self.optimizer = load_optimizer(&self.network, path)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
