//! TD-MPC2 (Hansen, Su and Wang 2024, arXiv 2310.16828): a world model without decoder that learns to predict latents, rewards and
//! values, and acts by planning in its latent space. Networks, losses and the order of an update are the reference's.

mod images;
mod loss;
mod math;
mod network;
mod plan;
mod planner;
mod settings;

use std::path::Path;

use burn::tensor::{Device as TensorDevice, Tensor};
use rand::RngExt as _;
use swm_core::env::PIXELS;
use swm_core::seed::keyed;
use swm_core::{EpisodeSeed, LiveEpisode};

use super::agent::{AgentConfig, Observation, OnlineAgent, Transitions};
use super::settings::CollectConfig;
use super::training::{check_form, differentiate, load_optimizer, tensor, trainable};
use crate::baseline::Losses;
use crate::device::Device;
use crate::error::BaselineError;
use crate::images::{Images, Normalization, to_tensor};
use crate::learner::follow;
use crate::weights;
use swm_nn::Pass;
use swm_nn::optim::{AdamW, Gradients, OptimConfig, Schedule};
use swm_nn::params;

pub(crate) use loss::{Minibatch, Noise, loss};
use network::TARGETS;
pub(crate) use network::{Observed, Tdmpc2Network};
pub use plan::{OPTIONS, Tdmpc2Plan};
use planner::{Planner, Searched};
pub(super) use settings::settings;
pub use settings::{Tdmpc2Config, Tdmpc2Image};

/// Its name.
pub(super) const NAME: &str = "tdmpc2";

/// What is trained.
pub(crate) const TRAINED: &[&str] =
    &["cnn", "pixel_encoder", "extra_encoders", "dynamics", "reward", "qs", "pi"];
/// Of it, the encoders.
const ENCODERS: &[&str] = &["cnn", "pixel_encoder", "extra_encoders"];
/// Epsilon of Adam for the policy; PyTorch's for all else.
const POLICY_EPSILON: f64 = 1e-5;

/// The agent.
pub(crate) struct Tdmpc2 {
    config: AgentConfig,
    settings: Tdmpc2Config,
    network: Tdmpc2Network,
    optimizer: AdamW,
    device: TensorDevice,
    /// By slot: what is left of the last plan.
    plans: Vec<Option<Rest>>,
}

/// The rest of a plan, for the next one to begin with.
struct Rest {
    /// Of this episode.
    seed: EpisodeSeed,
    /// From this step on.
    step: u64,
    /// `[H - 1, A]`.
    actions: Vec<f32>,
}

impl Tdmpc2 {
    /// Samples the initial weights, after checking the settings.
    pub(crate) fn new(config: AgentConfig, device: Device) -> Result<Self, BaselineError> {
        let settings = Tdmpc2Config::parse(&config.settings)?;
        let device = device.device()?;
        let network = Tdmpc2Network::new(&config, &settings, &device).initialized(config.seed);
        Ok(Self::with(config, settings, network, device))
    }

    pub(crate) fn with(
        config: AgentConfig,
        settings: Tdmpc2Config,
        network: Tdmpc2Network,
        device: TensorDevice,
    ) -> Self {
        Self { config, settings, network, optimizer: AdamW::default(), device, plans: Vec::new() }
    }

    pub(crate) fn minibatch(&self, clips: &Transitions<'_>) -> Result<Minibatch, BaselineError> {
        let ([observation, action], all) =
            ([self.config.observation_dim, self.config.action_dim], self.clip_steps());
        let Transitions { rows, steps, .. } = *clips;
        let given = [clips.observation, clips.action, clips.reward, clips.terminated].map(<[f32]>::len);
        let wanted = [observation, action, 1, 1].map(|dim| rows * all * dim);
        if steps != all || given != wanted {
            let reason = format!(
                "{given:?} values in {rows} clips of {steps} steps; TD-MPC2 takes {wanted:?} in {all}"
            );
            return Err(BaselineError::data("observation", reason));
        }
        let images = self.images(clips.images, [rows, steps])?;
        let steps_of = |values: &[f32], dim: usize, steps: std::ops::Range<usize>| {
            let count = steps.len() * rows;
            let place = |step: usize| move |clip: usize| (clip * all + step) * dim;
            let places = steps.flat_map(|step| (0..rows).map(place(step)));
            let of = places.flat_map(|place| &values[place..][..dim]).copied().collect();
            tensor(of, [count, dim], &self.device)
        };
        Ok(Minibatch {
            clips: rows,
            observed: Observed {
                images,
                vector: (observation > 0).then(|| steps_of(clips.observation, observation, 0..all)),
            },
            action: steps_of(clips.action, action, 0..all - 1),
            reward: steps_of(clips.reward, 1, 1..all),
            goes_on: steps_of(clips.terminated, 1, 1..all) * -1.0 + 1.0,
        })
    }

    /// `[T B, 3, S, S]`: B rows of T images, all of a step together, where this agent observes images.
    fn images(
        &self,
        images: Option<Images<'_>>,
        [rows, steps]: [usize; 2],
    ) -> Result<Option<Tensor<4>>, BaselineError> {
        let Some(side) = self.config.image else { return Ok(None) };
        let images = images.filter(|images| [images.rows, images.steps] == [rows, steps]);
        let wanted = || format!("no {rows} rows of {steps} images, and this agent learned from images");
        let images = images.ok_or_else(|| BaselineError::data(PIXELS, wanted()))?;
        let images = to_tensor(PIXELS, &images, (side, Normalization::Imagenet), &self.device)?;
        Ok(Some(images.swap_dims(0, 1).reshape([steps * rows, 3, side, side])))
    }

    /// What is random in update `index`, but for dropout.
    fn noise(&self, rows: usize, index: u64, pass: &mut Pass) -> Noise {
        let shape = [self.settings.horizon * rows, self.config.action_dim];
        let mut stream = keyed(self.config.seed, "tdmpc2 pairs of Qs", [index, 0]);
        let mut pairs = || {
            let pair = |_| {
                let (one, other) = (
                    stream.random_range(0..self.settings.num_q),
                    stream.random_range(1..self.settings.num_q),
                );
                [one, (one + other) % self.settings.num_q]
            };
            (0..self.settings.horizon).map(pair).collect()
        };
        Noise {
            next: pass.normal(shape, &self.device),
            policy: pass.normal(shape, &self.device),
            next_qs: pairs(),
            policy_qs: pairs(),
        }
    }

    /// An update in the order of the reference: loss, scale of values, target networks, gradients, Adam.
    pub(crate) fn update_with(
        &mut self,
        batch: &Minibatch,
        noise: Noise,
        index: u64,
        pass: &mut Pass,
    ) -> Result<Losses, BaselineError> {
        let tracked = params::track(&self.network, TRAINED);
        let (terms, scale) = loss(&tracked, &self.network, batch, &self.settings, noise, pass);
        let (mut losses, mut gradients) = differentiate(&tracked, terms, index)?;
        gradients.clip(self.settings.clip);
        let followed = follow(self.network.clone(), TARGETS, 1.0 - self.settings.tau);
        self.network = params::map(followed, |spec, tensor| match spec.name.as_str() {
            "scale.value" => params::from_host(spec, vec![scale], &tensor),
            _ => tensor,
        });
        self.apply(gradients);
        losses.parts.push(("scale", scale));
        Ok(losses)
    }

    /// A step of Adam, in which encoder and policy have learning rates of their own.
    fn apply(&mut self, gradients: Gradients) {
        let Tdmpc2Config { lr, encoder_lr_scale, policy_lr_scale, weight_decay, .. } = self.settings;
        let specs = params::specs(&self.network);
        let adam =
            OptimConfig { weight_decay, clip: None, schedule: Schedule::Constant, ..OptimConfig::default() };
        let groups: [(&[&str], f64, f64); 3] = [
            (ENCODERS, lr * encoder_lr_scale, adam.epsilon),
            (&["dynamics", "reward", "qs"], lr, adam.epsilon),
            (&["pi"], lr * policy_lr_scale, POLICY_EPSILON),
        ];
        let mut gradients = gradients;
        for (below, lr, epsilon) in groups {
            let of_group = gradients.take(|index| specs[index].is_below(below));
            let optim = OptimConfig { epsilon, ..adam.clone() };
            self.network = self.optimizer.step(self.network.clone(), of_group, &optim, lr);
        }
    }

    /// The first action of a plan, whose rest the next step in the slot begins with.
    fn plan(
        &mut self,
        slot: usize,
        episode: &LiveEpisode,
        explore: bool,
        observed: Observed,
    ) -> Result<Vec<f32>, BaselineError> {
        let Self { settings, network, device, plans, .. } = self;
        let (plan, actions) = (&settings.plan, self.config.action_dim);
        let latent = network.encode(observed);
        let discount = settings.discount.unwrap_or(1.0);
        let planner = Planner { network, plan, discount, device, episode };
        if !plan.mpc {
            return Ok(planner.prior(latent, explore));
        }
        plans.resize_with(plans.len().max(slot + 1), || None);
        let known = plans[slot].take().filter(|rest| (rest.seed, rest.step) == (episode.seed, episode.step));
        let known = known.map_or(Vec::new(), |rest| rest.actions);
        let (samples, iterations) = match explore {
            true => (plan.collect_samples, plan.collect_iterations),
            false => (plan.samples, plan.iterations),
        };
        let Searched { mut mean, std } = planner.search(&latent, &known, samples, iterations)?;
        let rest = mean.split_off(actions);
        if explore {
            planner.explore(&mut mean, &std[..actions]);
        }
        plans[slot] = Some(Rest { seed: episode.seed, step: episode.step + 1, actions: rest });
        Ok(mean)
    }
}

impl OnlineAgent for Tdmpc2 {
    fn config(&self) -> &AgentConfig {
        &self.config
    }

    fn collect(&self) -> &CollectConfig {
        &self.settings.collect
    }

    fn clip_steps(&self) -> usize {
        self.settings.horizon + 1
    }

    fn batch(&self) -> usize {
        self.settings.batch
    }

    fn parameters(&self) -> usize {
        trainable(&self.network, TARGETS)
    }

    /// Vectors are taken as they are, as by the reference: the encoder's layer norm sees to their scale.
    fn observe(&mut self, _observations: &[f32]) {}

    fn act(
        &mut self,
        slot: usize,
        episode: &LiveEpisode,
        explore: bool,
        observation: &Observation<'_>,
        action: &mut [f32],
    ) -> Result<(), BaselineError> {
        check_form(&self.config, observation, action)?;
        let dim = self.config.observation_dim;
        let observed = Observed {
            images: self.images(observation.image, [1, 1])?,
            vector: (dim > 0).then(|| tensor(observation.vector.to_vec(), [1, dim], &self.device)),
        };
        action.copy_from_slice(&self.plan(slot, episode, explore, observed)?);
        Ok(())
    }

    fn update(&mut self, clips: &Transitions<'_>, index: u64) -> Result<Losses, BaselineError> {
        let batch = self.minibatch(clips)?;
        let mut pass = Pass::train_on(&self.device, self.config.seed, index);
        let noise = self.noise(clips.rows, index, &mut pass);
        self.update_with(&batch, noise, index, &mut pass)
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

/// By name, what the functions of `math` give for `input`, for the comparison with the reference's.
#[cfg(test)]
pub(crate) fn check_functions(
    config: &Tdmpc2Config,
    input: impl Fn(&str) -> Tensor<2>,
) -> Vec<(&'static str, Tensor<2>)> {
    let bins = math::Bins { low: config.vmin, high: config.vmax, count: config.num_bins };
    let [action, density] = math::squash(input("gaussian"), input("log_density"));
    vec![
        ("symlog", math::symlog(input("values"))),
        ("symexp", math::symexp(input("values") / 8.0)),
        ("two_hot", bins.two_hot(input("inside"))),
        ("two_hot_inverse", bins.number(input("logits"))),
        ("simnorm", math::simnorm(input("latent"), config.simnorm_dim)),
        ("mish", math::mish(input("logits") * 8.0)),
        ("log_std", math::log_std(input("mean"))),
        ("action", action),
        ("density", density),
    ]
}

#[cfg(test)]
mod tests;
