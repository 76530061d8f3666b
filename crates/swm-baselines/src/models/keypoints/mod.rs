//! An encoder of places by itself, which learns to draw what it sees from them: no actions, no goals. Where things stand out (a schematic
//! look: a black table, a bright agent, a dim block), drawing alone finds them, and a world model over them needs nothing else.
//!
//! In the usual look it does not: the goal's mark and a pale table explain so little that the agent is not worth a place.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use crate::baseline::{InputSpec, Phase};
use crate::data::{DataDims, Form, Inputs};
use crate::error::BaselineError;
use crate::models::encoder::{Encoder, EncoderConfig};
use crate::models::settings::check_sizes;
use crate::network::{Network, Parts};
use swm_nn::Pass;
use swm_nn::losses::Terms;
use swm_nn::optim::OptimConfig;
use swm_nn::{Drawing, KeypointConfig, Keypoints};

/// Its name.
pub(crate) const NAME: &str = "keypoints";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct KeypointsConfig {
    /// The network.
    pub model: KeypointEncoderConfig,
    /// The optimizer.
    pub optim: OptimConfig,
}

/// What it sees, and how large it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct KeypointEncoderConfig {
    /// The side of images: a multiple of 32.
    pub image: usize,
    /// The encoder.
    pub encoder: KeypointConfig,
    /// Images of a batch.
    pub batch: usize,
}

impl KeypointsConfig {
    /// Settings for a CPU: those of `keypoint-wm`'s encoder.
    pub fn small() -> Self {
        Self {
            model: KeypointEncoderConfig { image: 64, encoder: KeypointConfig::default(), batch: 64 },
            optim: OptimConfig { lr: 1e-3, weight_decay: 0.01, ..OptimConfig::default() },
        }
    }

    fn check(&self) -> Result<(), String> {
        let KeypointEncoderConfig { image, encoder, batch } = &self.model;
        check_sizes(&[("model.image", *image), ("model.batch", *batch)], 0.0)?;
        Keypoints::check(encoder)?;
        match Drawing::check(1.0, true, *image) {
            Ok(()) => Ok(()),
            Err(_) => Err(format!(
                "`model.image` is {image}; it is drawn in 32 × 32 cells and must be a multiple of 32"
            )),
        }
    }
}

#[derive(Module, Debug)]
struct DrawnKeypoints {
    encoder: Encoder,
    drawing: Drawing,
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &KeypointsConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    config.check().map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    let &KeypointEncoderConfig { image, ref encoder, batch } = &config.model;
    let network = DrawnKeypoints {
        encoder: Encoder::of_tokens(&EncoderConfig::Keypoints(encoder.clone()), image, device),
        drawing: Drawing::new(encoder.count, image, device),
    };
    let input_spec = InputSpec { num_steps: 1, frameskip: 1, image, proprio: false, batch };
    let phase = Phase::only(&config.optim, &[""]);
    Ok(Parts { network, input_spec, form: Form::new(image, dims.action_dim, 0), phases: vec![phase] })
}

impl Network for DrawnKeypoints {
    /// The share of the variance of images that drawings from their places do not explain.
    fn loss(&self, _phase: usize, inputs: &Inputs, _pass: &mut Pass) -> Result<Terms, BaselineError> {
        let places: Tensor<2> = self.encoder.tokens(inputs.pixels.clone()).flatten::<3>(2, 3).flatten(0, 1);
        let total = self.drawing.unexplained(inputs.pixels.clone().flatten(0, 1), places);
        Ok(Terms { total, parts: Vec::new() })
    }
}
