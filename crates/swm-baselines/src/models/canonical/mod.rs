//! From images of any look to images of one canonical look of the same state. In front of an encoder that has seen the canonical look
//! alone, it makes a model indifferent to colors that it was never trained for. Not the reference's.
//!
//! It learns from pairs: a recording without images renders the same row in a sampled look and in the canonical one. One image cannot
//! say which of two equal shapes is the block and which marks the goal; two frames of an episode can, as marks never move. So it sees
//! a second frame beside the one that it draws: in training another one of the clip, at work the goal beside the observation, and the
//! observation beside the goal.

#[cfg(test)]
mod tests;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use crate::baseline::{Canonicalizer, InputSpec, Phase};
use crate::data::{DataDims, Form, Images, Inputs};
use crate::error::BaselineError;
use crate::images::{to_bytes, to_tensor};
use crate::models::settings::check_sizes;
use crate::network::{Network, Parts};
use swm_nn::Pass;
use swm_nn::losses::Terms;
use swm_nn::optim::OptimConfig;
use swm_nn::params::device_of;
use swm_nn::{Background, HALVINGS, ImageTranslator, coordinates};

/// Its name.
pub(crate) const NAME: &str = "canonical";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct CanonicalConfig {
    /// The network.
    pub model: CanonicalModelConfig,
    /// The optimizer.
    pub optim: OptimConfig,
}

/// What it sees, and how large it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct CanonicalModelConfig {
    /// The side of images: a multiple of 8.
    pub image: usize,
    /// Channels at a half, a quarter and an eighth of the image.
    pub channels: [usize; HALVINGS],
    /// Frames that it sees to draw one: 1, or 2.
    pub frames: usize,
    /// Frames of a clip, each of which is drawn.
    pub clip: usize,
    /// Environment steps from one of them to the next.
    pub frameskip: usize,
    /// Clips of a batch.
    pub batch: usize,
}

impl CanonicalConfig {
    /// Settings for a CPU: images of 64 pixels, 32 a step.
    pub fn small() -> Self {
        Self {
            model: CanonicalModelConfig {
                image: 64,
                channels: [24, 40, 56],
                frames: 2,
                clip: 4,
                frameskip: 8,
                batch: 8,
            },
            optim: OptimConfig { lr: 2e-3, weight_decay: 1e-4, ema: 0.998, ..OptimConfig::default() },
        }
    }

    fn check(&self) -> Result<(), String> {
        let CanonicalModelConfig { image, channels: [half, quarter, eighth], frames, clip, frameskip, batch } =
            self.model;
        let positive = [
            ("model.image", image),
            ("model.channels", half.min(quarter).min(eighth)),
            ("model.clip", clip),
            ("model.frameskip", frameskip),
            ("model.batch", batch),
        ];
        check_sizes(&positive, 0.0)?;
        if !image.is_multiple_of(1 << HALVINGS) {
            return Err(format!("`model.image` is {image}; it must be a multiple of {}", 1 << HALVINGS));
        }
        match frames {
            1 | 2 => Ok(()),
            _ => Err(format!("`model.frames` is {frames}; it draws from 1 frame or 2")),
        }
    }
}

#[derive(Module, Debug)]
struct Canonical {
    /// Of images in the canonical look: what never changes in them is not learned.
    background: Background,
    network: ImageTranslator,
    #[module(skip)]
    frames: usize,
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &CanonicalConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    config.check().map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    let CanonicalModelConfig { image, channels, frames, clip, frameskip, batch } = config.model;
    let inputs = OWN + (frames - 1) * 3;
    let network = Canonical {
        background: Background::new([image; 2], device),
        network: ImageTranslator::new(inputs, channels, device),
        frames,
    };
    let input_spec = InputSpec { num_steps: clip, frameskip, image, proprio: false, batch };
    let form = Form::new(image, frameskip * dims.action_dim, 0);
    let phase = Phase::only(&config.optim, &["network"]);
    Ok(Parts { network, input_spec, form, phases: vec![phase] })
}

/// Maps of the frame that is drawn: its colors, the same as they differ from its own mean, and where each pixel is.
const OWN: usize = 3 + 3 + 2;

impl Canonical {
    /// Frames `[N, 3, S, S]` beside others → what is drawn of them, without the background.
    fn draw(&self, frames: &Tensor<4>, others: Tensor<4>) -> Tensor<4> {
        let [count, _, side, _] = frames.dims();
        let mean = frames.clone().mean_dim(3).mean_dim(2);
        let apart = frames.clone() - mean.clone();
        let std = apart.clone().square().mean_dim(3).mean_dim(2).sqrt() + 0.1;
        let last = |maps: Tensor<4>| maps.permute([0, 2, 3, 1]);
        let mut seen = vec![
            last(frames.clone()),
            last(apart / std.clone()),
            coordinates(count, side, &frames.device().inner()),
        ];
        if self.frames == 2 {
            seen.push(last((others - mean) / std));
        }
        self.network.forward(Tensor::cat(seen, 3))
    }
}

impl Network for Canonical {
    const LEARNS_CANONICAL: bool = true;

    fn begin(self, inputs: &Inputs) -> Self {
        match &inputs.canonical {
            Some(canonical) => Background::find(self, canonical),
            None => self,
        }
    }

    /// The share of the variance of canonical images, around what never changes in them, that is not drawn.
    fn loss(&self, _phase: usize, inputs: &Inputs, _pass: &mut Pass) -> Result<Terms, BaselineError> {
        let Some(canonical) = inputs.canonical.clone() else {
            let reason = "the batch has no images in the canonical look; name that look: `canonical`";
            return Err(BaselineError::data("canonical", reason));
        };
        let frames = inputs.pixels.clone();
        let steps = frames.dims()[1];
        let others = match steps {
            1 => frames.clone(),
            _ => Tensor::cat(vec![frames.clone().narrow(1, 1, steps - 1), frames.clone().narrow(1, 0, 1)], 1),
        };
        let drawn = self.draw(&frames.flatten(0, 1), others.flatten(0, 1));
        let wanted = self.background.remove(canonical.flatten(0, 1));
        let variance = wanted.clone().square().mean().clamp_min(1e-6);
        let total = (drawn - wanted).square().mean() / variance;
        Ok(Terms { total, parts: Vec::new() })
    }

    fn canonicalizer(&self, form: &Form) -> Option<Box<dyn Canonicalizer>> {
        Some(Box::new(Drawer { network: self.clone(), form: *form }))
    }
}

/// A copy that draws.
struct Drawer {
    network: Canonical,
    form: Form,
}

impl Canonicalizer for Drawer {
    fn side(&self) -> usize {
        self.form.image
    }

    fn draw(&self, images: &Images<'_>, others: &Images<'_>) -> Result<Vec<u8>, BaselineError> {
        if images.rows * images.steps != others.rows * others.steps {
            let reason = format!(
                "{} images beside {} others; each is drawn beside one",
                images.rows * images.steps,
                others.rows * others.steps
            );
            return Err(BaselineError::data("pixels", reason));
        }
        let Self { network, form } = self;
        let device = device_of(network);
        let how = (form.image, form.normalization);
        let [images, others] = [images, others].map(|images| to_tensor("pixels", images, how, &device));
        let drawn = network.draw(&images?.flatten(0, 1), others?.flatten(0, 1));
        Ok(to_bytes(network.background.add(drawn), form.normalization))
    }

    fn share(&self) -> Box<dyn Canonicalizer> {
        Box::new(Self { network: self.network.clone(), form: self.form })
    }
}
