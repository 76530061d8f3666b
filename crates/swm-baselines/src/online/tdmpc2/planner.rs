//! Planning in latent space: MPPI with plans of the policy prior among the candidates (Hansen, Su and Wang 2024, arXiv 2310.16828,
//! section 3.2), or the cross-entropy method, as the reference's script plans.
//!
//! All noise is keyed by the episode and its step, and a plan is made by itself: it does not depend on other environments.

use burn::tensor::{Device, Tensor};
use rand_distr::{Distribution as _, StandardNormal};
use swm_core::LiveEpisode;
use swm_core::seed::Stream;
use swm_solvers::{cheapest, count_non_finite};

use super::network::Tdmpc2Network;
use super::plan::Tdmpc2Plan;
use crate::error::BaselineError;
use crate::online::training::tensor;
use swm_nn::params::host;

/// What a plan is made with.
pub(super) struct Planner<'a> {
    pub(super) network: &'a Tdmpc2Network,
    pub(super) plan: &'a Tdmpc2Plan,
    pub(super) discount: f64,
    pub(super) device: &'a Device,
    pub(super) episode: &'a LiveEpisode,
}

/// A search distribution over action sequences.
pub(super) struct Searched {
    /// `[H, A]`: its mean, the plan.
    pub(super) mean: Vec<f32>,
    /// `[H, A]`: its std.
    pub(super) std: Vec<f32>,
}

impl Planner<'_> {
    /// Searches `iterations` times among `samples` candidates from `latent`, `[1, Z]`. The first mean begins with `known`, `[up to H,
    /// A]`: the rest of the last plan. The policy prior continues it.
    pub(super) fn search(
        &self,
        latent: &Tensor<2>,
        known: &[f32],
        samples: usize,
        iterations: usize,
    ) -> Result<Searched, BaselineError> {
        let Tdmpc2Plan { horizon, elites, policy_samples, sigma, .. } = *self.plan;
        let actions = self.network.form().actions;
        let size = horizon * actions;
        let mut stream = self.stream("tdmpc2 policy", 0);
        let mut mean = self.follow_policy(latent.clone(), known, 1, &mut stream);
        let mut std = vec![sigma as f32; size];
        let latents = latent.clone().repeat_dim(0, samples);
        let mut candidates = match policy_samples {
            0 => Vec::new(),
            count => self.follow_policy(latent.clone().repeat_dim(0, count), &[], count, &mut stream),
        };
        let (mut costs, mut order) = (Vec::new(), vec![0; samples]);
        for iteration in 0..iterations {
            candidates.truncate(policy_samples * size);
            candidates.extend_from_slice(&mean);
            let mut stream = self.stream("tdmpc2 plan", iteration as u64);
            for _ in policy_samples + 1..samples {
                let noise = mean.iter().zip(&std).map(|(mean, std)| mean + std * normal(&mut stream));
                candidates.extend(noise.map(|value| value.clamp(-1.0, 1.0)));
            }
            let plans = self.tensor(candidates.clone(), [samples, horizon, actions]);
            let returns =
                self.network.returns(latents.clone(), &plans, self.discount, self.plan.uncertainty_penalty);
            costs.clear();
            costs.extend(host(returns).into_iter().map(|value| -f64::from(value)));
            let usable = samples - count_non_finite(&mut costs) as usize;
            if usable == 0 {
                let reason = format!(
                    "no plan of {samples} has a finite return at step {} of episode {}: the observation or the weights are \
                     not finite; look for NaN in them",
                    self.episode.step, self.episode.index
                );
                return Err(BaselineError::data("observation", reason));
            }
            let best = cheapest(&costs, elites.min(usable), &mut order);
            self.refit(&candidates, &costs, best, &mut mean, &mut std);
        }
        Ok(Searched { mean, std })
    }

    /// An action with the noise of exploration: `spread`, `[A]`, are the stds of it.
    pub(super) fn explore(&self, action: &mut [f32], spread: &[f32]) {
        let mut stream = self.stream("tdmpc2 exploration", 0);
        for (value, std) in action.iter_mut().zip(spread) {
            *value = (*value + std * self.plan.exploration as f32 * normal(&mut stream)).clamp(-1.0, 1.0);
        }
    }

    /// The policy prior's action at `latent`, `[1, Z]`: a sample of it, or its best.
    pub(super) fn prior(&self, latent: Tensor<2>, explore: bool) -> Vec<f32> {
        let actions = self.network.form().actions;
        if !explore {
            let [mean, _] = self.network.policy(latent);
            return host(mean.tanh());
        }
        let mut stream = self.stream("tdmpc2 exploration", 0);
        let noise = (0..actions).map(|_| normal(&mut stream)).collect();
        host(self.network.sample(latent, self.tensor(noise, [1, actions])))
    }

    /// `[N, H, A]`: action sequences that begin with `known`, `[up to H, A]`, and go on with samples of the policy prior at predicted
    /// latents, from `[N, Z]`.
    fn follow_policy(
        &self,
        mut latent: Tensor<2>,
        known: &[f32],
        count: usize,
        stream: &mut Stream,
    ) -> Vec<f32> {
        let (actions, horizon) = (self.network.form().actions, self.plan.horizon);
        let mut steps: Vec<Tensor<3>> = Vec::with_capacity(horizon);
        for step in 0..horizon {
            let action = match known.get(step * actions..(step + 1) * actions) {
                Some(known) => self.tensor(known.repeat(count), [count, actions]),
                None => {
                    let noise = (0..count * actions).map(|_| normal(stream)).collect();
                    self.network.sample(latent.clone(), self.tensor(noise, [count, actions]))
                }
            };
            steps.push(action.clone().unsqueeze_dim(1));
            if step + 1 < horizon {
                latent = self.network.next(Tensor::cat(vec![latent, action], 1));
            }
        }
        host(Tensor::cat(steps, 1))
    }

    /// Fits mean and std to the `elites` of `candidates`, `[S, H, A]`, in ascending order of cost.
    fn refit(&self, candidates: &[f32], costs: &[f64], elites: &[u32], mean: &mut [f32], std: &mut [f32]) {
        let Tdmpc2Plan { temperature, sigma, sigma_min, .. } = *self.plan;
        let (size, least) = (mean.len(), costs[elites[0] as usize]);
        let weights: Vec<f64> = elites
            .iter()
            .map(|&elite| temperature.map_or(1.0, |unit| ((least - costs[elite as usize]) / unit).exp()))
            .collect();
        let total: f64 = weights.iter().sum();
        // Of elites that weigh the same, the unbiased std: the reference's cross-entropy method.
        let freedom = if temperature.is_none() && total > 1.0 { total - 1.0 } else { total };
        for (place, (mean, std)) in mean.iter_mut().zip(std).enumerate() {
            let values = || elites.iter().map(|&elite| f64::from(candidates[elite as usize * size + place]));
            let center = values().zip(&weights).map(|(value, weight)| value * weight).sum::<f64>() / total;
            let squares = values().zip(&weights).map(|(value, weight)| weight * (value - center).powi(2));
            *std = (squares.sum::<f64>() / freedom).sqrt().clamp(sigma_min, sigma) as f32;
            *mean = center as f32;
        }
    }

    fn stream(&self, purpose: &str, index: u64) -> Stream {
        self.episode.seed.indexed(purpose, [self.episode.step, index])
    }

    fn tensor<const D: usize>(&self, values: Vec<f32>, shape: [usize; D]) -> Tensor<D> {
        tensor(values, shape, self.device)
    }
}

fn normal(stream: &mut Stream) -> f32 {
    StandardNormal.sample(stream)
}
