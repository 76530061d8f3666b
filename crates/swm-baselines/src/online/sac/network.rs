//! SAC's networks and losses (Haarnoja et al. 2018, arXiv 1812.05905), as Stable-Baselines3 2.7 computes them and with its
//! names of tensors.

use burn::module::{Module, Param};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use swm_nn::losses::{Terms, mean_squared_error};
use swm_nn::params::host;
use swm_nn::{Linear, QHead, parameter};

/// Bounds of the logarithms of the policy's stds.
const LOG_STDS: [f32; 2] = [-20.0, 2.0];
/// Added to 1 − tanh² before its logarithm, and to variances before their root.
const SQUASH: f64 = 1e-6;
const VARIANCE: f32 = 1e-8;
/// Normalized observations are clipped to ± this.
const CLIP: f32 = 10.0;

/// Policy, twin critics, their target networks, and the temperature.
#[derive(Module, Debug)]
pub(crate) struct SacNetwork {
    actor: Actor,
    critic: Twin,
    critic_target: Twin,
    /// `[1]`: the logarithm of the temperature.
    log_ent_coef: Param<Tensor<1>>,
    observation: Running,
}

/// A Gaussian, squashed by tanh.
#[derive(Module, Debug)]
struct Actor {
    latent_pi: Trunk,
    mu: Linear,
    log_std: Linear,
}

#[derive(Module, Debug)]
struct Trunk {
    first: Linear,
    second: Linear,
}

#[derive(Module, Debug)]
struct Twin {
    qf0: QHead,
    qf1: QHead,
}

/// Mean and variance of all observations so far, and their number.
#[derive(Module, Debug)]
struct Running {
    running_mean: Param<Tensor<1>>,
    running_var: Param<Tensor<1>>,
    running_count: Param<Tensor<1>>,
}

/// Transitions on the device, observations normalized.
pub(crate) struct Minibatch {
    /// `[B, O]`.
    pub(crate) observation: Tensor<2>,
    /// `[B, A]`.
    pub(crate) action: Tensor<2>,
    /// `[B, 1]`.
    pub(crate) reward: Tensor<2>,
    /// `[B, O]`.
    pub(crate) next: Tensor<2>,
    /// `[B, 1]`: 0 where the task ended, else 1.
    pub(crate) goes_on: Tensor<2>,
}

impl SacNetwork {
    /// A network of zeros.
    pub(crate) fn new([observation, action]: [usize; 2], hidden: [usize; 2], device: &Device) -> Self {
        let [first, second] = hidden;
        let critic = || QHead::new(observation + action, hidden, device);
        let twin = || Twin { qf0: critic(), qf1: critic() };
        Self {
            actor: Actor {
                latent_pi: Trunk {
                    first: Linear::new(observation, first, device),
                    second: Linear::new(first, second, device),
                },
                mu: Linear::new(second, action, device),
                log_std: Linear::new(second, action, device),
            },
            critic: twin(),
            critic_target: twin(),
            log_ent_coef: parameter([1], device),
            observation: Running {
                running_mean: parameter([observation], device),
                running_var: parameter([observation], device),
                running_count: parameter([1], device),
            },
        }
    }

    /// The temperature.
    pub(crate) fn temperature(&self) -> f64 {
        f64::from(host(self.log_ent_coef.val())[0]).exp()
    }

    /// `[B, O]` observations, standardized and clipped.
    pub(crate) fn normalize(&self, observation: Tensor<2>) -> Tensor<2> {
        let mean: Tensor<2> = self.observation.running_mean.val().unsqueeze();
        let std: Tensor<2> = (self.observation.running_var.val() + VARIANCE).sqrt().unsqueeze();
        ((observation - mean) / std).clamp(-CLIP, CLIP)
    }

    /// Mean and log std of the Gaussian, `[B, A]` each.
    fn gaussian(&self, observation: Tensor<2>) -> [Tensor<2>; 2] {
        let Actor { latent_pi: Trunk { first, second }, mu, log_std } = &self.actor;
        let hidden = relu(second.forward(relu(first.forward(observation))));
        [mu.forward(hidden.clone()), log_std.forward(hidden).clamp(LOG_STDS[0], LOG_STDS[1])]
    }

    /// The action that the policy thinks best: `[B, O]` → `[B, A]`.
    pub(crate) fn best_action(&self, observation: Tensor<2>) -> Tensor<2> {
        let [mean, _] = self.gaussian(observation);
        mean.tanh()
    }

    /// The action of standard normal `noise`, `[B, A]`, and the logarithm of its density, `[B, 1]`.
    pub(crate) fn sample(&self, observation: Tensor<2>, noise: Tensor<2>) -> [Tensor<2>; 2] {
        let [mean, log_std] = self.gaussian(observation);
        let action = (mean + log_std.clone().exp() * noise.clone()).tanh();
        let gaussian = noise.square() * -0.5 - log_std - 0.5 * (2.0 * std::f64::consts::PI).ln();
        let squashed = (action.clone().square() * -1.0 + (1.0 + SQUASH)).log();
        [action, (gaussian - squashed).sum_dim(1)]
    }

    /// Half the squared error of both critics against the reward plus the discounted soft value of what came next.
    pub(crate) fn critic_loss(
        &self,
        batch: &Minibatch,
        temperature: f64,
        discount: f64,
        noise: Tensor<2>,
    ) -> Terms {
        let [action, density] = self.sample(batch.next.clone(), noise);
        let [q0, q1] = self.critic_target.values(batch.next.clone(), action);
        let soft_value = q0.min_pair(q1) - density * temperature;
        let target = (batch.reward.clone() + batch.goes_on.clone() * soft_value * discount).detach();
        let [q0, q1] = self.critic.values(batch.observation.clone(), batch.action.clone());
        let q = q0.clone().mean();
        let total = (mean_squared_error(q0, target.clone()) + mean_squared_error(q1, target)) * 0.5;
        Terms { total, parts: vec![("q", q)] }
    }

    /// The temperature times the log density of the policy's actions, minus their value.
    pub(crate) fn actor_loss(&self, batch: &Minibatch, temperature: f64, noise: Tensor<2>) -> Terms {
        let [action, density] = self.sample(batch.observation.clone(), noise);
        let [q0, q1] = self.critic.values(batch.observation.clone(), action);
        let total = (density.clone() * temperature - q0.min_pair(q1)).mean();
        Terms { total, parts: vec![("entropy", -density.mean())] }
    }

    /// Mean, variance and number of the observations so far.
    pub(crate) fn statistics(&self) -> [Vec<f32>; 3] {
        let Running { running_mean, running_var, running_count } = &self.observation;
        [running_mean, running_var, running_count].map(|values| host(values.val()))
    }
}

impl Twin {
    /// `[B, O]` and `[B, A]` → `[B, 1]` of each.
    fn values(&self, observation: Tensor<2>, action: Tensor<2>) -> [Tensor<2>; 2] {
        let both = Tensor::cat(vec![observation, action], 1);
        [self.qf0.forward(both.clone()), self.qf1.forward(both)]
    }
}
