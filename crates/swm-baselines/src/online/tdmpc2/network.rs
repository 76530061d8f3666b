//! TD-MPC2's networks (Hansen, Su and Wang 2024, arXiv 2310.16828), as the reference computes them and with its names of tensors.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use rand::RngExt as _;
use rand_distr::StandardNormal;
use swm_core::seed::keyed;

use super::images::ImageEncoder;
use super::math::{Bins, log_std, mish, simnorm};
use super::settings::Tdmpc2Config;
use crate::learner::follow;
use crate::online::agent::AgentConfig;
use swm_nn::Pass;
use swm_nn::init::initialize;
use swm_nn::params;
use swm_nn::{LayerNorm, Linear, parameter};

/// The target networks, and what they follow.
pub(super) const TARGETS: &[(&str, &str)] = &[("qs", "target_qs")];
/// Std of the initial weights, and the initial scale of values.
const WEIGHT_STD: f32 = 0.02;
const SCALE: f32 = 10.0;

/// Encoders of what is observed, dynamics, reward, policy prior, and an ensemble of Qs with their target networks.
#[derive(Module, Debug)]
pub(crate) struct Tdmpc2Network {
    images: Option<ImageEncoder>,
    encoder: Option<StateEncoder>,
    dynamics: LatentMlp,
    reward: NormedMlp,
    pi: NormedMlp,
    pub(super) qs: Vec<NormedMlp>,
    pub(super) target_qs: Vec<NormedMlp>,
    scale: RunningScale,
    #[module(skip)]
    form: NetworkForm,
}

/// N observations on the device.
#[derive(Clone)]
pub(crate) struct Observed {
    /// `[N, 3, S, S]`, normalized, where images are observed.
    pub(crate) images: Option<Tensor<4>>,
    /// `[N, O]`, where vectors are.
    pub(crate) vector: Option<Tensor<2>>,
}

impl Observed {
    /// Some of them.
    pub(crate) fn narrow(&self, start: usize, length: usize) -> Self {
        Self {
            images: self.images.clone().map(|images| images.narrow(0, start, length)),
            vector: self.vector.clone().map(|vector| vector.narrow(0, start, length)),
        }
    }
}

/// What no tensor says.
#[derive(Clone, Copy, Debug)]
pub(super) struct NetworkForm {
    pub(super) bins: Bins,
    /// Values of a simplex.
    pub(super) group: usize,
    /// A.
    pub(super) actions: usize,
    pub(super) dropout: f64,
}

/// Linear, dropout, layer norm, Mish (the caller may take another activation).
#[derive(Module, Debug)]
struct NormedLinear {
    linear: Linear,
    norm: LayerNorm,
}

/// The network of a vector of observations, before SimNorm.
#[derive(Module, Debug)]
struct StateEncoder {
    hidden: NormedLinear,
    output: Linear,
    norm: LayerNorm,
}

/// Two hidden layers.
#[derive(Module, Debug)]
pub(super) struct NormedMlp {
    first: NormedLinear,
    second: NormedLinear,
    output: Linear,
}

/// Two hidden layers, and a third whose activation is SimNorm.
#[derive(Module, Debug)]
struct LatentMlp {
    first: NormedLinear,
    second: NormedLinear,
    output: NormedLinear,
}

/// What values are divided by in the policy's loss.
#[derive(Module, Debug)]
struct RunningScale {
    value: Param<Tensor<1>>,
}

impl NormedLinear {
    fn new(inputs: usize, outputs: usize, device: &Device) -> Self {
        Self { linear: Linear::new(inputs, outputs, device), norm: LayerNorm::new(outputs, device) }
    }

    fn forward(&self, input: Tensor<2>) -> Tensor<2> {
        mish(self.norm.forward(self.linear.forward(input)))
    }
}

impl NormedMlp {
    fn new(inputs: usize, hidden: usize, outputs: usize, device: &Device) -> Self {
        Self {
            first: NormedLinear::new(inputs, hidden, device),
            second: NormedLinear::new(hidden, hidden, device),
            output: Linear::new(hidden, outputs, device),
        }
    }

    /// `[N, inputs]` → `[N, outputs]`.
    fn forward(&self, input: Tensor<2>) -> Tensor<2> {
        self.output.forward(self.second.forward(self.first.forward(input)))
    }

    /// With dropout of this rate in the first layer.
    pub(super) fn forward_with_dropout(&self, input: Tensor<2>, rate: f64, pass: &mut Pass) -> Tensor<2> {
        let NormedLinear { linear, norm } = &self.first;
        let first = mish(norm.forward(pass.dropout(linear.forward(input), rate)));
        self.output.forward(self.second.forward(first))
    }
}

impl StateEncoder {
    fn new([inputs, hidden, outputs]: [usize; 3], device: &Device) -> Self {
        Self {
            hidden: NormedLinear::new(inputs, hidden, device),
            output: Linear::new(hidden, outputs, device),
            norm: LayerNorm::new(outputs, device),
        }
    }

    /// `[N, inputs]` → `[N, outputs]`.
    fn forward(&self, vector: Tensor<2>) -> Tensor<2> {
        self.norm.forward(self.output.forward(self.hidden.forward(vector)))
    }
}

impl Tdmpc2Network {
    /// A network of zeros, for the observations and actions of this agent. Z is `latent_dim` for vectors, and for images as much or `image.latent_dim`.
    pub(crate) fn new(agent: &AgentConfig, config: &Tdmpc2Config, device: &Device) -> Self {
        let AgentConfig { observation_dim: observation, action_dim: actions, image, .. } = *agent;
        let Tdmpc2Config { latent_dim: part, encoder_dim, mlp_dim: hidden, num_bins, .. } = *config;
        let of_images = config.image.latent_dim.unwrap_or(part);
        let images = image.map(|side| ImageEncoder::new(side, config.image.channels, of_images, device));
        let dims = [observation, encoder_dim, part];
        let encoder = (observation > 0).then(|| StateEncoder::new(dims, device));
        let latent = images.as_ref().map_or(0, |_| of_images) + encoder.as_ref().map_or(0, |_| part);
        let of_action = |outputs| NormedMlp::new(latent + actions, hidden, outputs, device);
        let qs = || (0..config.num_q).map(|_| of_action(num_bins)).collect();
        Self {
            images,
            encoder,
            dynamics: LatentMlp {
                first: NormedLinear::new(latent + actions, hidden, device),
                second: NormedLinear::new(hidden, hidden, device),
                output: NormedLinear::new(hidden, latent, device),
            },
            reward: of_action(num_bins),
            pi: NormedMlp::new(latent, hidden, 2 * actions, device),
            qs: qs(),
            target_qs: qs(),
            scale: RunningScale { value: parameter([1], device) },
            form: NetworkForm {
                bins: Bins { low: config.vmin, high: config.vmax, count: num_bins },
                group: config.simnorm_dim,
                actions,
                dropout: config.dropout,
            },
        }
    }

    /// The first weights: normal with std 0.02, biases 0, layer norms 1 and 0, convolutions as in PyTorch, last weights of rewards and
    /// Qs 0; target networks are copies. (The reference truncates at ±2, a hundred stds away.)
    pub(super) fn initialized(self, seed: u64) -> Self {
        let network = params::map(initialize(self, seed), |spec, tensor| {
            let count = spec.shape.iter().product();
            let is_last = ["reward", "qs"].iter().any(|part| spec.is_below(&[part]))
                && spec.name.ends_with(".2.weight");
            let values = match (spec.place.0, spec.place.1.as_str()) {
                ("Conv", _) => return tensor,
                ("RunningScale", _) => vec![SCALE; count],
                ("LayerNorm", "weight") => vec![1.0; count],
                (_, "weight") if !is_last => {
                    let mut stream = keyed(seed, &format!("weights {}", spec.name), [0, 0]);
                    (0..count).map(|_| stream.sample::<f32, _>(StandardNormal) * WEIGHT_STD).collect()
                }
                _ => vec![0.0; count],
            };
            params::from_host(spec, values, &tensor)
        });
        follow(network, TARGETS, 0.0)
    }

    pub(super) fn form(&self) -> &NetworkForm {
        &self.form
    }

    /// What values are divided by in the policy's loss: `[1]`.
    pub(super) fn scale(&self) -> Tensor<1> {
        self.scale.value.val()
    }

    /// `[N, Z]`: the latent of N observations, first what images say, then vectors.
    pub(crate) fn encode(&self, observed: Observed) -> Tensor<2> {
        let of_images = self.images.as_ref().zip(observed.images);
        let of_images = of_images.map(|(encoder, images)| encoder.forward(images));
        let of_vector = self.encoder.as_ref().zip(observed.vector);
        let of_vector = of_vector.map(|(encoder, vector)| encoder.forward(vector));
        simnorm(Tensor::cat(of_images.into_iter().chain(of_vector).collect(), 1), self.form.group)
    }

    /// `[N, Z + A]` → `[N, Z]`: the latent that follows a latent and an action.
    pub(super) fn next(&self, both: Tensor<2>) -> Tensor<2> {
        let LatentMlp { first, second, output } = &self.dynamics;
        let hidden = second.forward(first.forward(both));
        simnorm(output.norm.forward(output.linear.forward(hidden)), self.form.group)
    }

    /// `[N, Z + A]` → `[N, K]`: logits of the reward.
    pub(super) fn reward_logits(&self, both: Tensor<2>) -> Tensor<2> {
        self.reward.forward(both)
    }

    /// Mean and log std of the policy's Gaussian, before tanh: `[N, Z]` → `[N, A]` each.
    pub(super) fn policy(&self, latent: Tensor<2>) -> [Tensor<2>; 2] {
        let (both, actions) = (self.pi.forward(latent), self.form.actions);
        [both.clone().narrow(1, 0, actions), log_std(both.narrow(1, actions, actions))]
    }

    /// The action of standard normal noise: `[N, Z]` and `[N, A]` → `[N, A]`.
    pub(super) fn sample(&self, latent: Tensor<2>, noise: Tensor<2>) -> Tensor<2> {
        let [mean, log_std] = self.policy(latent);
        (mean + log_std.exp() * noise).tanh()
    }

    /// `[N]`: the discounted return of action sequences `[N, H, A]` from latents `[N, Z]`: Σ γᵗ r + γᴴ (Q̄ − c |Q̄| σ), where Q̄ and σ
    /// are the mean and the std of all Qs of the policy's mean action.
    pub(crate) fn returns(
        &self,
        mut latent: Tensor<2>,
        actions: &Tensor<3>,
        discount: f64,
        uncertainty_penalty: f64,
    ) -> Tensor<1> {
        let [_, horizon, _] = actions.dims();
        let (mut total, mut weight) = (None::<Tensor<2>>, 1.0);
        for step in 0..horizon {
            let both = Tensor::cat(vec![latent, actions.clone().narrow(1, step, 1).squeeze_dim(1)], 1);
            let reward = self.form.bins.number(self.reward_logits(both.clone())) * weight;
            total = Some(total.map_or(reward.clone(), |sum| sum + reward));
            latent = self.next(both);
            weight *= discount;
        }
        let [mean, _] = self.policy(latent.clone());
        let both = Tensor::cat(vec![latent, mean.tanh()], 1);
        let value = |q: &NormedMlp| self.form.bins.number(q.forward(both.clone()));
        let values = Tensor::cat(self.qs.iter().map(value).collect(), 1);
        let mean = values.clone().mean_dim(1);
        let doubt = values.var(1).sqrt() * mean.clone().abs() * uncertainty_penalty;
        let last = (mean - doubt) * weight;
        total.map_or(last.clone(), |total| total + last).squeeze_dim(1)
    }
}
