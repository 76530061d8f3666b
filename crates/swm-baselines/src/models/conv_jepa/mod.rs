//! Conv-JEPA: a joint-embedding predictive world model whose latent is a feature map, predicted by convolutions that actions steer.
//!
//! Loss: squared error of predicted tokens, plus SIGReg of the encoded maps, flattened; no target network, no stop-gradient. As in
//! LeWM (arXiv 2603.19312), the regularizer sees exactly what is predicted, with no layer between. It must: tokens multiplied by s
//! have s² times the error, so behind a layer that can undo s (batch normalization, or a trained projection) the least loss is that
//! of s → 0. Here the variance along a unit direction d is dᵀ Cov d, which falls with s², and SIGReg (arXiv 2511.08544) asks for 1
//! along every d: of a map that is 0 its value per clip is 2 ∫ (1 − w)² w dt over [0, 3] with w = exp(−t² / 2), 0.40.
//! Directions cross all cells, so one cell need not be normal by itself: it may say the same in most images.
//!
//! Latents may also be places that an encoder finds, a map of one cell (`model.encoder.kind=keypoints`). They stand between -1 and 1,
//! and are drawn from (`weights.drawing`), which keeps them apart in place of SIGReg.

mod planner;
#[cfg(test)]
mod tests;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use crate::baseline::{InputSpec, Phase, PlanModel};
use crate::data::{DataDims, Form, Inputs};
use crate::error::BaselineError;
use crate::models::auxiliary::{Auxiliary, AuxiliaryWeights};
use crate::models::settings::check_sizes;
use crate::network::{Network, Parts};
use crate::plan::Planner;
use swm_nn::Pass;
use swm_nn::losses::{SigregConfig, Terms, mean_squared_error, sigreg};
use swm_nn::optim::OptimConfig;
use swm_nn::{
    ActionEmbedder, Drawing, FeatureMapEncoder, FilmPredictor, FilmPredictorConfig, InverseDynamics,
    KeypointConfig, Keypoints,
};

/// Its name.
pub(crate) const NAME: &str = "conv-jepa";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct ConvJepaConfig {
    /// The network.
    pub model: FeatureMapConfig,
    /// What keeps maps apart.
    pub sigreg: SigregConfig,
    /// Hidden dim of the inverse-dynamics MLP.
    pub inverse_hidden: usize,
    /// How many maps are predicted on end for `weights.rollout`.
    pub rollout_steps: usize,
    /// What additional terms are worth.
    pub weights: AuxiliaryWeights,
    /// The optimizer.
    pub optim: OptimConfig,
}

/// The network's size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct FeatureMapConfig {
    /// The side of images.
    pub image: usize,
    /// What looks at them.
    #[serde(default)]
    pub encoder: MapEncoderConfig,
    /// Channels of the encoder's layers: the first leaves a fourth of the side, each other half of what is left.
    pub channels: Vec<usize>,
    /// Hidden dim of the MLP over the last channels of a cell.
    pub projector: usize,
    /// Channels of the latent map: values of a token.
    pub token_dim: usize,
    /// What predicts.
    pub predictor: FilmPredictorConfig,
    /// Environment steps from one map to the next.
    pub frameskip: usize,
    /// Dim of the first layer of the action embedding.
    pub smoothed: usize,
    /// Clips of a batch.
    pub batch: usize,
}

/// What latents are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum MapEncoderConfig {
    /// Feature maps that keep the image's grid.
    #[default]
    Map,
    /// The places that a convolutional encoder finds: a map of one cell. `channels`, `projector` and `token_dim` say nothing then.
    Keypoints(KeypointConfig),
}

impl MapEncoderConfig {
    /// How many places it finds, if it finds any.
    fn places(&self) -> Option<usize> {
        match self {
            Self::Map => None,
            Self::Keypoints(config) => Some(config.count),
        }
    }
}

impl FeatureMapConfig {
    /// G and C: side and channels of a latent map.
    fn map(&self) -> [usize; 2] {
        match self.encoder.places() {
            None => [FeatureMapEncoder::grid(self.image, &self.channels), self.token_dim],
            Some(places) => [1, 2 * places],
        }
    }
}

impl ConvJepaConfig {
    /// Settings for a CPU: images of 96 pixels, tokens of 16 values on a grid of 6 × 6. SIGReg's weight is that of LeWM's *small*
    /// preset, which has batches of the same size; maps are predicted on end, as plans are.
    pub fn small() -> Self {
        let sigreg = SigregConfig::default();
        Self {
            model: FeatureMapConfig {
                image: 96,
                encoder: MapEncoderConfig::Map,
                channels: vec![32, 64, 128],
                projector: 128,
                token_dim: 16,
                predictor: FilmPredictorConfig::default(),
                frameskip: 5,
                smoothed: 10,
                batch: 64,
            },
            sigreg: SigregConfig { projections: 256, weight: 2.0 * sigreg.weight, ..sigreg },
            inverse_hidden: 512,
            rollout_steps: 3,
            weights: AuxiliaryWeights { rollout: 1.0, ..AuxiliaryWeights::default() },
            optim: OptimConfig { lr: 1e-3, ..OptimConfig::default() },
        }
    }

    fn check(&self, auxiliary: &Auxiliary) -> Result<(), String> {
        let model = &self.model;
        match &model.encoder {
            MapEncoderConfig::Map => FeatureMapEncoder::check(model.image, &model.channels)?,
            MapEncoderConfig::Keypoints(config) => Keypoints::check(config)?,
        }
        let positive = [
            ("model.image", model.image),
            ("model.projector", model.projector),
            ("model.token_dim", model.token_dim),
            ("model.frameskip", model.frameskip),
            ("model.smoothed", model.smoothed),
            ("model.batch", model.batch),
            ("model.predictor.channels", model.predictor.channels),
            ("model.predictor.action", model.predictor.action),
        ];
        check_sizes(&positive, 0.0)?;
        self.sigreg.check()?;
        auxiliary.check(model.encoder.places(), model.image)
    }
}

/// An encoder of one of the kinds.
#[derive(Module, Debug)]
#[expect(clippy::large_enum_variant, reason = "a network has one")]
enum MapEncoder {
    Map(FeatureMapEncoder),
    Keypoints(Keypoints),
}

impl MapEncoder {
    fn new(config: &FeatureMapConfig, device: &Device) -> Self {
        let &FeatureMapConfig { image, projector, token_dim, .. } = config;
        match &config.encoder {
            MapEncoderConfig::Map => {
                Self::Map(FeatureMapEncoder::new(image, &config.channels, projector, token_dim, device))
            }
            MapEncoderConfig::Keypoints(places) => {
                Self::Keypoints(Keypoints::new(places, [image; 2], None, device))
            }
        }
    }

    /// `[N, 3, S, S]` → `[N, Z]`.
    fn forward(&self, images: Tensor<4>, pass: &mut Pass) -> Tensor<2> {
        match self {
            Self::Map(maps) => maps.forward(images, pass).flatten(1, 3),
            Self::Keypoints(keypoints) => keypoints.places(images),
        }
    }
}

#[derive(Module, Debug)]
struct ConvJepa {
    encoder: MapEncoder,
    action_encoder: ActionEmbedder,
    predictor: FilmPredictor,
    /// Only where it has a weight: others' weights have none.
    inverse: Option<InverseDynamics>,
    /// The same.
    drawing: Option<Drawing>,
    #[module(skip)]
    form: Form,
    /// G and C: side and channels of a map.
    #[module(skip)]
    map: [usize; 2],
    #[module(skip)]
    sigreg: SigregConfig,
    #[module(skip)]
    auxiliary: Auxiliary,
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &ConvJepaConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    let auxiliary = Auxiliary::new(&config.weights, config.rollout_steps);
    config.check(&auxiliary).map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    let FeatureMapConfig { image, encoder, predictor, frameskip, smoothed, batch, .. } = &config.model;
    let form = Form::new(*image, frameskip * dims.action_dim, 0);
    let map = config.model.map();
    let network = ConvJepa {
        encoder: MapEncoder::new(&config.model, device),
        action_encoder: ActionEmbedder::new(form.action, *smoothed, predictor.action, device),
        predictor: FilmPredictor::new(predictor, map, device),
        inverse: auxiliary.inverse(map[0] * map[0] * map[1], config.inverse_hidden, form.action, device),
        drawing: auxiliary.drawing(encoder.places(), *image, device),
        form,
        map,
        sigreg: config.sigreg,
        auxiliary,
    };
    let phase = Phase::only(&config.optim, &[""]);
    // Straightening compares two changes: three maps.
    let num_steps = auxiliary.steps().max(if config.weights.straightening == 0.0 { 1 } else { 2 }) + 1;
    let input_spec =
        InputSpec { num_steps, frameskip: *frameskip, image: *image, proprio: false, batch: *batch };
    Ok(Parts { network, input_spec, form, phases: vec![phase] })
}

impl ConvJepa {
    /// Z: values of a map.
    fn dim(&self) -> usize {
        let [grid, channels] = self.map;
        grid * grid * channels
    }

    /// `[B, T, 3, S, S]` → `[B, T, Z]`.
    fn encode(&self, pixels: Tensor<5>, pass: &mut Pass) -> Tensor<3> {
        let [batch, steps, ..] = pixels.dims();
        self.encoder.forward(pixels.flatten::<4>(0, 1), pass).reshape([batch, steps, self.dim()])
    }

    /// Maps `[N, Z]` and embedded actions `[N, E]` → the maps after them, `[N, Z]`.
    fn predict(&self, maps: Tensor<2>, actions: &Tensor<2>) -> Tensor<2> {
        let ([count, dim], [grid, channels]) = (maps.dims(), self.map);
        self.predictor.forward(maps.reshape([count, grid, grid, channels]), actions).reshape([count, dim])
    }

    /// Predicts `[B, R, Z]` on end from maps `[B, 1, Z]` under actions `[B, R, D]`.
    fn roll_out(&self, first: Tensor<3>, actions: Tensor<3>) -> Tensor<3> {
        let actions = self.action_encoder.forward(actions);
        let mut map: Tensor<2> = first.squeeze_dim(1);
        let next = |step| {
            map = self.predict(map.clone(), &actions.clone().narrow(1, step, 1).squeeze_dim(1));
            map.clone()
        };
        Tensor::stack((0..actions.dims()[1]).map(next).collect(), 1)
    }
}

impl Network for ConvJepa {
    fn loss(&self, _phase: usize, inputs: &Inputs, pass: &mut Pass) -> Result<Terms, BaselineError> {
        let states = self.encode(inputs.pixels.clone(), pass);
        let places = matches!(self.encoder, MapEncoder::Keypoints(_)).then_some(&states);
        let [batch, steps, dim] = states.dims();
        let seen = steps - 1;
        let actions = self.action_encoder.forward(inputs.action.clone().narrow(1, 0, seen));
        let embedding = actions.dims()[2];
        let before = states.clone().narrow(1, 0, seen).reshape([batch * seen, dim]);
        let predicted = self.predict(before, &actions.reshape([batch * seen, embedding]));
        let targets = states.clone().narrow(1, 1, seen).reshape([batch * seen, dim]);
        let prediction = mean_squared_error(predicted, targets);
        let mut terms = Terms { total: prediction.clone(), parts: vec![("prediction", prediction)] };
        terms.add("sigreg", self.sigreg.weight, sigreg(states.clone(), &self.sigreg, pass));
        self.auxiliary.add_drawing(&mut terms, self.drawing.as_ref(), inputs, places);
        self.auxiliary.add_to(&mut terms, self.inverse.as_ref(), &states, inputs, |first, actions| {
            self.roll_out(first, actions)
        });
        Ok(terms)
    }

    fn planner(&self) -> Option<Box<dyn PlanModel>> {
        Some(Box::new(Planner::new(self.clone())))
    }
}
