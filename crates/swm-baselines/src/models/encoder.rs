//! Which network looks at images: a vision transformer, a small convolutional one, or one that finds places.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use swm_nn::{Cnn, CnnConfig, KeypointConfig, Keypoints, Vit, VitConfig};

/// Its kind and size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum EncoderConfig {
    /// A vision transformer.
    Vit(VitConfig),
    /// Convolutions.
    Cnn(CnnConfig),
    /// Convolutions, and the places that they find.
    Keypoints(KeypointConfig),
}

impl EncoderConfig {
    /// What is wrong with it, if anything is.
    pub(crate) fn check(&self, image: usize) -> Result<(), String> {
        match self {
            Self::Vit(config) => config.check([image; 2]),
            Self::Cnn(config) => Cnn::check(config),
            Self::Keypoints(config) => Keypoints::check(config),
        }
    }

    /// Dim of a summary, where `dim` is requested: a vision transformer has its own.
    pub(crate) fn summary_dim(&self, dim: usize) -> usize {
        match self {
            Self::Vit(config) => config.dim,
            Self::Cnn(_) | Self::Keypoints(_) => dim,
        }
    }

    /// How many places it finds, if it finds any.
    pub(crate) fn places(&self) -> Option<usize> {
        match self {
            Self::Keypoints(config) => Some(config.count),
            Self::Vit(_) | Self::Cnn(_) => None,
        }
    }

    /// P and W: tokens of an image, and dim of each.
    pub fn tokens(&self, image: usize) -> [usize; 2] {
        match self {
            Self::Vit(config) => [config.patches([image; 2]), config.dim],
            Self::Cnn(config) => {
                let [rows, columns] = Cnn::grid(config, [image; 2]);
                [rows * columns, config.channels.last().copied().unwrap_or(3)]
            }
            Self::Keypoints(config) => [1, 2 * config.count],
        }
    }
}

/// An encoder of one of the kinds.
#[derive(Module, Debug)]
pub(crate) enum Encoder {
    Vit(Vit),
    Cnn(Cnn),
    Keypoints(Keypoints),
}

impl Encoder {
    /// One that gives summaries.
    pub(crate) fn of_summaries(config: &EncoderConfig, image: usize, dim: usize, device: &Device) -> Self {
        match config {
            EncoderConfig::Vit(config) => Self::Vit(Vit::new(config, device)),
            EncoderConfig::Cnn(config) => Self::Cnn(Cnn::new(config, [image; 2], Some(dim), device)),
            EncoderConfig::Keypoints(config) => {
                Self::Keypoints(Keypoints::new(config, [image; 2], Some(dim), device))
            }
        }
    }

    /// One that gives tokens.
    pub(crate) fn of_tokens(config: &EncoderConfig, image: usize, device: &Device) -> Self {
        match config {
            EncoderConfig::Vit(config) => Self::Vit(Vit::new(config, device)),
            EncoderConfig::Cnn(config) => Self::Cnn(Cnn::new(config, [image; 2], None, device)),
            EncoderConfig::Keypoints(config) => {
                Self::Keypoints(Keypoints::new(config, [image; 2], None, device))
            }
        }
    }

    /// `[B, T, 3, S, S]` → `[B, T, W]`.
    pub(crate) fn summaries(&self, images: Tensor<5>) -> Tensor<3> {
        self.summaries_and_places(images).0
    }

    /// `[B, T, 3, S, S]` → `[B, T, W]`, and the K places that they are made of, `[B, T, 2 K]`, if this finds any.
    pub(crate) fn summaries_and_places(&self, images: Tensor<5>) -> (Tensor<3>, Option<Tensor<3>>) {
        let [batch, steps, ..] = images.dims();
        let frames = images.flatten::<4>(0, 1);
        let (summaries, places): (Tensor<2>, _) = match self {
            Self::Vit(vit) => (vit.summaries(frames), None),
            Self::Cnn(cnn) => (cnn.forward(frames), None),
            Self::Keypoints(keypoints) => {
                let places = keypoints.places(frames);
                (keypoints.summary(places.clone()), Some(places))
            }
        };
        let of_clips = |values: Tensor<2>| {
            let dim = values.dims()[1];
            values.reshape([batch, steps, dim])
        };
        (of_clips(summaries), places.map(of_clips))
    }

    /// `[B, T, 3, S, S]` → `[B, T, P, W]`.
    pub(crate) fn tokens(&self, images: Tensor<5>) -> Tensor<4> {
        let [batch, steps, ..] = images.dims();
        let frames = images.flatten::<4>(0, 1);
        let tokens = match self {
            Self::Vit(vit) => {
                let all = vit.forward(frames);
                let patches = all.dims()[1] - 1;
                all.narrow(1, 1, patches)
            }
            Self::Cnn(cnn) => cnn.tokens(frames),
            Self::Keypoints(keypoints) => keypoints.places(frames).unsqueeze_dim(1),
        };
        let [_, count, dim] = tokens.dims();
        tokens.reshape([batch, steps, count, dim])
    }
}
