//! The loss of TD-MPC2 (Hansen, Su and Wang 2024, arXiv 2310.16828, section 3.1), as the reference's `tdmpc2_forward` computes it,
//! with its noise and its choice of Qs given.

use burn::tensor::Tensor;

use super::math::{cross_entropy, gaussian_log_density, percentile_range, squash};
use super::network::{Observed, Tdmpc2Network};
use super::settings::Tdmpc2Config;
use swm_nn::Pass;
use swm_nn::losses::{Terms, mean_squared_error};
use swm_nn::params::host;

/// B clips of H + 1 steps on the device, all of a step together.
pub(crate) struct Minibatch {
    /// B.
    pub(crate) clips: usize,
    /// (H + 1) B of them.
    pub(crate) observed: Observed,
    /// `[H B, A]`: what was done there.
    pub(crate) action: Tensor<2>,
    /// `[H B, 1]`: the reward of it.
    pub(crate) reward: Tensor<2>,
    /// `[H B, 1]`: 0 where it ended the task, else 1.
    pub(crate) goes_on: Tensor<2>,
}

/// What is random in a loss, but for dropout.
pub(crate) struct Noise {
    /// `[H B, A]`, standard normal: of the actions after each step, in targets.
    pub(crate) next: Tensor<2>,
    /// `[H B, A]`: of the policy's actions.
    pub(crate) policy: Tensor<2>,
    /// `[H]`: two different Qs of each step, in targets.
    pub(crate) next_qs: Vec<[usize; 2]>,
    /// `[H]`: and in the policy's loss.
    pub(crate) policy_qs: Vec<[usize; 2]>,
}

/// The loss of `tracked`, a copy of `network` that is differentiated, and the new scale of values.
///
/// - Consistency: squared error between latents that are predicted from the first one, and encoded ones.
/// - Reward and value: cross-entropy to the two-hot encoding of r, and of r + γ min(two target Qs) of the policy's next action.
/// - Policy: entropy and scaled mean of two Qs, at predicted latents without gradient.
///
/// Each step weighs ρ times the one before; sums are divided by H.
pub(crate) fn loss(
    tracked: &Tdmpc2Network,
    network: &Tdmpc2Network,
    batch: &Minibatch,
    config: &Tdmpc2Config,
    noise: Noise,
    pass: &mut Pass,
) -> (Terms, f32) {
    let (clips, horizon, form) = (batch.clips, config.horizon, *network.form());
    let of_step = |rows: &Tensor<2>, step: usize| rows.clone().narrow(0, step * clips, clips);
    let weight = |step: usize| config.rho.powi(step as i32) / horizon as f64;

    let encoded = network.encode(batch.observed.narrow(clips, horizon * clips));
    let mut latent = tracked.encode(batch.observed.narrow(0, clips));
    let (mut latents, mut consistency) = (Vec::with_capacity(horizon), None::<Tensor<1>>);
    for step in 0..horizon {
        latents.push(latent.clone());
        latent = tracked.next(Tensor::cat(vec![latent, of_step(&batch.action, step)], 1));
        let error = mean_squared_error(latent.clone(), of_step(&encoded, step)) * weight(step);
        consistency = Some(consistency.map_or(error.clone(), |sum| sum + error));
    }
    let consistency = consistency.expect("a horizon of 1 or more");
    let latents = Tensor::cat(latents, 0);
    let both = Tensor::cat(vec![latents.clone(), batch.action.clone()], 1);
    // Σ over steps of the mean over clips, weighed.
    let weights: Vec<Tensor<2>> = (0..horizon)
        .map(|step| Tensor::full([clips, 1], weight(step) / clips as f64, &batch.reward.device()))
        .collect();
    let weights = Tensor::cat(weights, 0);
    let weighed = |rows: Tensor<2>| (rows * weights.clone()).sum();

    let reward =
        weighed(cross_entropy(tracked.reward_logits(both.clone()), form.bins.two_hot(batch.reward.clone())));

    // Two Qs of each step: `[H B, 1]` each.
    let pair = |qs: &[super::network::NormedMlp], pairs: &[[usize; 2]], both: &Tensor<2>, pass: &mut Pass| {
        [0, 1].map(|which| {
            let of_steps = pairs.iter().enumerate().map(|(step, pair)| {
                let logits = qs[pair[which]].forward_with_dropout(of_step(both, step), form.dropout, pass);
                form.bins.number(logits)
            });
            Tensor::cat(of_steps.collect(), 0)
        })
    };
    let next_action = network.sample(encoded.clone(), noise.next);
    let next = Tensor::cat(vec![encoded, next_action], 1);
    let [one, other] = pair(&network.target_qs, &noise.next_qs, &next, pass);
    let discount = config.discount.unwrap_or(1.0);
    let target = batch.reward.clone() + batch.goes_on.clone() * one.min_pair(other) * discount;
    let target = form.bins.two_hot(target);
    let mut value = None::<Tensor<1>>;
    for q in &tracked.qs {
        let logits = q.forward_with_dropout(both.clone(), form.dropout, pass);
        let error = weighed(cross_entropy(logits, target.clone()));
        value = Some(value.map_or(error.clone(), |sum| sum + error));
    }
    let value = value.expect("two Qs or more") / config.num_q as f64;

    let latents = latents.inner();
    let [mean, log_std] = tracked.policy(latents.clone());
    let density = gaussian_log_density(noise.policy.clone(), log_std.clone());
    let [action, density] = squash(mean + log_std.exp() * noise.policy, density);
    let both = Tensor::cat(vec![latents, action], 1);
    let [one, other] = pair(&network.qs, &noise.policy_qs, &both, pass);
    let q = (one + other) * 0.5;
    let new = percentile_range(host(of_step(&q, 0).inner()));
    let old = host(network.scale())[0];
    let scale = old + (new - old) * config.tau as f32;
    let entropy = density * (form.actions as f64 * config.entropy_coef);
    let policy = weighed(entropy - q.clone() / scale);

    let mut terms = Terms { total: policy.clone(), parts: vec![("policy_loss", policy)] };
    terms.add("consistency_loss", config.consistency_coef, consistency);
    terms.add("reward_loss", config.reward_coef, reward);
    terms.add("value_loss", config.value_coef, value);
    terms.parts.push(("q", q.mean()));
    (terms, scale)
}
