//! A small convolutional encoder for small images: not the reference's, made to train on a CPU in minutes.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use super::background::Background;
use super::linear::{Conv, Linear};

/// Its size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CnnConfig {
    /// Channels of each layer; each halves the image.
    pub channels: Vec<usize>,
}

impl Default for CnnConfig {
    fn default() -> Self {
        Self { channels: vec![16, 32, 64, 128] }
    }
}

/// Convolutions that halve the image, then one linear layer over all that is left. Nothing between them but ReLU: what
/// else is computed for each pixel costs a CPU more than the convolutions do.
#[derive(Module, Debug)]
pub struct Cnn {
    background: Background,
    layers: Vec<Conv>,
    head: Option<Linear>,
}

impl Cnn {
    /// For images of `[height, width]` pixels; with a `head` of so many outputs, or without: a grid of tokens.
    pub fn new(config: &CnnConfig, size: [usize; 2], head: Option<usize>, device: &Device) -> Self {
        let mut inputs = 3;
        let mut layers = Vec::with_capacity(config.channels.len());
        for &outputs in &config.channels {
            let kernel = if inputs == 3 { 5 } else { 3 };
            layers.push(Conv::new([inputs, outputs], kernel, device));
            inputs = outputs;
        }
        let [rows, columns] = Self::grid(config, size);
        let head = head.map(|outputs| Linear::new(inputs * rows * columns, outputs, device));
        Self { background: Background::new(size, device), layers, head }
    }

    /// Rows and columns that are left of an image.
    pub fn grid(config: &CnnConfig, size: [usize; 2]) -> [usize; 2] {
        size.map(|pixels| config.channels.iter().fold(pixels, |pixels, _| pixels.div_ceil(2)))
    }

    /// What is wrong with a configuration, if anything is.
    ///
    /// # Errors
    ///
    /// What is wrong, which the caller adds the model to.
    pub fn check(config: &CnnConfig) -> Result<(), String> {
        if config.channels.is_empty() || config.channels.contains(&0) {
            return Err("`channels` must name the channels of at least one layer, none of them 0".to_owned());
        }
        Ok(())
    }

    /// `[N, 3, H, W]` → `[N, W]`; of an encoder with a head.
    pub fn forward(&self, images: Tensor<4>) -> Tensor<2> {
        let maps: Tensor<2> = self.maps(images).permute([0, 3, 1, 2]).flatten(1, 3);
        match &self.head {
            Some(head) => head.forward(maps),
            None => maps,
        }
    }

    /// `[N, 3, H, W]` → `[N, P, C]`: what each place of the last layer says.
    pub fn tokens(&self, images: Tensor<4>) -> Tensor<3> {
        self.maps(images).flatten(1, 2)
    }

    /// `[N, 3, H, W]` → `[N, H', W', C]`.
    fn maps(&self, images: Tensor<4>) -> Tensor<4> {
        self.layers
            .iter()
            .fold(self.background.remove(images).permute([0, 2, 3, 1]), |maps, layer| layer.halve(maps))
    }
}
