//! GCSL: goal-conditioned supervised learning (Ghosh et al. 2019, arXiv 1912.06088), as far as it learns from a dataset. A policy
//! that knows how many decisions are left imitates how each state was reached from the states before it.
//!
//! Every two images of a clip of K + 1 are a frame and a goal k decisions later, 1 to K. The loss is the squared error of the
//! actions at the frame, its mean over clips, then over the pairs of equal k, then over k: goals are as important far as near.
//!
//! Actions tell an encoder of places little of what it sees: with `weights.drawing`, the image must also be drawn from them.

#[cfg(test)]
mod tests;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use crate::baseline::{GoalPolicy, InputSpec, Phase};
use crate::data::{DataDims, Form, Inputs, PlanningBatch, Start};
use crate::dynamics::for_each_group;
use crate::error::BaselineError;
use crate::models::countdown::imitation;
use crate::models::encoder::{Encoder, EncoderConfig};
use crate::models::settings::check_sizes;
use crate::network::{Network, Parts};
use swm_nn::Pass;
use swm_nn::losses::Terms;
use swm_nn::optim::OptimConfig;
use swm_nn::params::{device_of, host};
use swm_nn::placement::Placement;
use swm_nn::{CountdownPredictor, CountdownSizes, Drawing, KeypointConfig};

/// Its name.
pub(crate) const NAME: &str = "gcsl";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct GcslConfig {
    /// The network.
    pub model: CountdownConfig,
    /// What is learned besides.
    #[serde(default)]
    pub weights: CountdownWeights,
    /// The optimizer.
    pub optim: OptimConfig,
}

/// Weights of additional terms. A term of weight 0 is not computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct CountdownWeights {
    /// The share of the variance of images that drawings from their places do not explain; of keypoints only.
    pub drawing: f64,
}

/// How it sees, how large it is, and how far ahead its goals are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct CountdownConfig {
    /// The side of images.
    pub image: usize,
    /// What looks at them.
    pub encoder: EncoderConfig,
    /// Dim of the policy's hidden layers.
    pub hidden: usize,
    /// Hidden layers of the policy.
    pub depth: usize,
    /// K: decisions to the farthest goals, in training and at work.
    pub horizon: usize,
    /// Environment steps from one observation to the next; a decision is so many actions.
    pub frameskip: usize,
    /// Clips of a batch.
    pub batch: usize,
}

impl GcslConfig {
    /// Settings for a CPU: places in images of 64 pixels, and goals 5 decisions of 5 actions ahead, as those of the historic
    /// protocol are.
    pub fn small() -> Self {
        Self {
            model: CountdownConfig {
                image: 64,
                encoder: EncoderConfig::Keypoints(KeypointConfig::default()),
                hidden: 512,
                depth: 3,
                horizon: 5,
                frameskip: 5,
                batch: 24,
            },
            weights: CountdownWeights::default(),
            optim: OptimConfig { lr: 1e-3, weight_decay: 0.01, ema: 0.999, ..OptimConfig::default() },
        }
    }

    fn check(&self) -> Result<(), String> {
        let CountdownConfig { image, encoder, hidden, depth, horizon, frameskip, batch } = &self.model;
        let positive = [
            ("model.image", *image),
            ("model.hidden", *hidden),
            ("model.depth", *depth),
            ("model.horizon", *horizon),
            ("model.frameskip", *frameskip),
            ("model.batch", *batch),
        ];
        check_sizes(&positive, 0.0)?;
        encoder.check(*image)?;
        Drawing::check(self.weights.drawing, encoder.places().is_some(), *image)
    }
}

#[derive(Module, Debug)]
struct Gcsl {
    encoder: Encoder,
    action_predictor: CountdownPredictor,
    drawing: Option<Drawing>,
    #[module(skip)]
    weights: CountdownWeights,
    #[module(skip)]
    form: Form,
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &GcslConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    config.check().map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    let CountdownConfig { image, encoder, hidden, depth, horizon, frameskip, batch } = &config.model;
    let form = Form::new(*image, frameskip * dims.action_dim, 0);
    let sizes = CountdownSizes {
        inputs: encoder.tokens(*image).iter().product(),
        // Places are compared as they are.
        normalizes: !matches!(encoder, EncoderConfig::Keypoints(_)),
        hidden: *hidden,
        depth: *depth,
        outputs: form.action,
        horizon: *horizon,
    };
    let network = Gcsl {
        encoder: Encoder::of_tokens(encoder, *image, device),
        action_predictor: CountdownPredictor::new(sizes, device),
        drawing: (config.weights.drawing != 0.0).then(|| Drawing::new(sizes.inputs / 2, *image, device)),
        weights: config.weights,
        form,
    };
    let input_spec = InputSpec {
        num_steps: horizon + 1,
        frameskip: *frameskip,
        image: *image,
        proprio: false,
        batch: *batch,
    };
    let phase = Phase { name: "policy", ..Phase::only(&config.optim, &[""]) };
    Ok(Parts { network, input_spec, form, phases: vec![phase] })
}

impl Network for Gcsl {
    fn loss(&self, _phase: usize, inputs: &Inputs, _pass: &mut Pass) -> Result<Terms, BaselineError> {
        let policy = &self.action_predictor;
        let tokens = self.encoder.tokens(inputs.pixels.clone());
        let mut terms = imitation(policy, policy.look(tokens.clone()), &inputs.action);
        if let Some(drawing) = &self.drawing {
            // What it imitates stays comparable with other weights.
            terms.parts.push(("actions", terms.total.clone()));
            let drawing = drawing.unexplained_in_clips(&inputs.pixels, &tokens.flatten::<3>(2, 3));
            terms.add("drawing", self.weights.drawing, drawing);
        }
        Ok(terms)
    }

    fn policy(&self) -> Option<Box<dyn GoalPolicy>> {
        Some(Box::new(Countdown { network: self.clone() }))
    }
}

/// A copy of what acts.
struct Countdown {
    network: Gcsl,
}

impl GoalPolicy for Countdown {
    fn block_dim(&self) -> usize {
        self.network.form.action
    }

    fn history(&self) -> usize {
        1
    }

    fn horizon(&self) -> usize {
        self.network.action_predictor.horizon()
    }

    fn act_within(
        &mut self,
        batch: &PlanningBatch<'_>,
        left: &[usize],
        actions: &mut [f32],
    ) -> Result<(), BaselineError> {
        let Gcsl { encoder, action_predictor: policy, form, .. } = &self.network;
        let device = device_of(policy);
        let start = Start::new(batch, form, &device)?;
        let (rows, dim) = (batch.pixels.rows, form.action);
        if batch.pixels.steps != 1 || left.len() != rows || actions.len() != rows * dim {
            let reason = format!(
                "{} observations, decisions left for {} of {rows} rows, and room for {} values; this policy takes one \
                 observation and gives {dim} values per row",
                batch.pixels.steps,
                left.len(),
                actions.len()
            );
            return Err(BaselineError::data("pixels", reason));
        }
        // One by one on a CPU: the bits of a decision must not depend on its neighbors.
        let most = match Placement::of(&device) {
            Placement::Host => 1,
            Placement::Device => rows.max(1),
        };
        let groups = left.chunks(most).zip(actions.chunks_mut(most * dim)).enumerate().collect();
        for_each_group(&device, groups, |(index, (left, out)): (usize, (&[usize], &mut [f32]))| {
            let look = |images: &Tensor<5>| {
                policy.look(encoder.tokens(images.clone().narrow(0, index * most, left.len())))
            };
            let (from, to) = (look(&start.pixels).from, look(&start.goal_pixels).to);
            let of_row = |(row, &left): (usize, &usize)| {
                policy.join(from.clone().narrow(0, row, 1), to.clone().narrow(0, row, 1), left)
            };
            let first = Tensor::cat(left.iter().enumerate().map(of_row).collect(), 0);
            out.copy_from_slice(&host(policy.decide(first)));
        });
        Ok(())
    }
}
