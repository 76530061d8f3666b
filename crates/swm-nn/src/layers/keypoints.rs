//! A convolutional encoder that says where things are: a spatial soft-argmax (Levine et al. 2016, arXiv 1504.00702) of each of its
//! last maps. Not the reference's.

use burn::module::Module;
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};

use super::background::Background;
use super::linear::{Conv, Linear};

/// Its size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct KeypointConfig {
    /// Channels of each layer; each halves the image. One more of the last size follows.
    pub channels: Vec<usize>,
    /// How many places are found.
    pub count: usize,
}

impl Default for KeypointConfig {
    fn default() -> Self {
        Self { channels: vec![32, 32], count: 32 }
    }
}

/// What maps are multiplied by before the softmax: with initial weights they differ by tenths.
const SHARPNESS: f64 = 10.0;

/// Convolutions that halve the image, one that does not, a linear layer over the channels of each cell, and the mean place of
/// the softmax of each map.
#[derive(Module, Debug)]
pub struct Keypoints {
    background: Background,
    layers: Vec<Conv>,
    last: Conv,
    maps: Linear,
    head: Option<Linear>,
}

impl Keypoints {
    /// For images of `[height, width]` pixels; with a `head` of so many outputs, or without.
    pub fn new(config: &KeypointConfig, size: [usize; 2], head: Option<usize>, device: &Device) -> Self {
        let mut inputs = 3;
        let mut layers = Vec::with_capacity(config.channels.len());
        for &outputs in &config.channels {
            layers.push(Conv::new([inputs, outputs], if inputs == 3 { 5 } else { 3 }, device));
            inputs = outputs;
        }
        Self {
            background: Background::new(size, device),
            layers,
            last: Conv::new([inputs; 2], 3, device),
            maps: Linear::new(inputs, config.count, device),
            head: head.map(|outputs| Linear::new(2 * config.count, outputs, device)),
        }
    }

    /// What is wrong with a configuration, if anything is.
    ///
    /// # Errors
    ///
    /// What is wrong, which the caller adds the model to.
    pub fn check(config: &KeypointConfig) -> Result<(), String> {
        if config.channels.is_empty() || config.channels.contains(&0) || config.count == 0 {
            return Err("`channels` must name the channels of at least one layer, none of them 0, and `count` at least 1 \
                        place"
                .to_owned());
        }
        Ok(())
    }

    /// `[N, 3, H, W]` → `[N, 2 × count]`: x and y of each place, from -1 to 1 over the image.
    pub fn places(&self, images: Tensor<4>) -> Tensor<2> {
        let seen = self.background.remove(images).permute([0, 2, 3, 1]);
        let maps = self.layers.iter().fold(seen, |maps, layer| layer.halve(maps));
        let maps = self.last.rectified(maps, 1);
        let [count, rows, columns, channels] = maps.dims();
        let maps = self.maps.forward(maps.reshape([count, rows * columns, channels]));
        mean_places(maps * SHARPNESS, [rows, columns])
    }

    /// Places `[N, 2 × count]` → `[N, W]`: what the head makes of them, or themselves.
    pub fn summary(&self, places: Tensor<2>) -> Tensor<2> {
        match &self.head {
            Some(head) => head.forward(places),
            None => places,
        }
    }
}

/// Maps `[N, rows × columns, K]` → `[N, 2 K]`: x and y of the mean place under the softmax of each.
fn mean_places(maps: Tensor<3>, [rows, columns]: [usize; 2]) -> Tensor<2> {
    let [count, cells, places] = maps.dims();
    let place = |index: usize, cells: usize| (2 * index + 1) as f32 / cells as f32 - 1.0;
    let grid: Vec<f32> =
        (0..cells).flat_map(|cell| [place(cell % columns, columns), place(cell / columns, rows)]).collect();
    let grid = Tensor::<3>::from_data(TensorData::new(grid, [1, cells, 2]), &maps.device().inner());
    let shares = softmax(maps.swap_dims(1, 2), 2);
    shares.matmul(grid.expand([count, cells, 2])).reshape([count, 2 * places])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::init::initialize;
    use crate::params::host;

    #[test]
    fn places_are_those_of_the_greatest_values() {
        let device = Device::flex();
        // 2 rows of 4 cells. The first map has its peak in row 1, column 2; the second is flat; the third has two equal peaks.
        let mut maps = vec![0.0; 8 * 3];
        maps[(4 + 2) * 3] = 50.0;
        maps[2] = 50.0;
        maps[7 * 3 + 2] = 50.0;
        let maps = Tensor::<3>::from_data(TensorData::new(maps, [1, 8, 3]), &device);
        let found = host(mean_places(maps, [2, 4]));
        let wanted = [0.25, 0.5, 0.0, 0.0, 0.0, 0.0];
        assert!(found.iter().zip(wanted).all(|(found, wanted)| (found - wanted).abs() < 1e-5), "{found:?}");
    }

    #[test]
    fn places_move_with_the_image() {
        let device = Device::flex();
        let config = KeypointConfig { channels: vec![4, 4], count: 3 };
        let encoder = initialize(Keypoints::new(&config, [64, 64], None, &device), 1);
        // A square of 4 pixels, far from the edges, before and after a move to the right.
        let image = |left: usize| {
            let inside = |pixel: usize| {
                (left..left + 4).contains(&(pixel % 64)) && (28..32).contains(&(pixel % 4096 / 64))
            };
            (0..3 * 4096).map(|pixel| if inside(pixel) { 30.0 } else { 0.0 }).collect::<Vec<f32>>()
        };
        let images =
            Tensor::<4>::from_data(TensorData::new([image(24), image(32)].concat(), [2, 3, 64, 64]), &device);
        let found = host(encoder.places(images));
        let moved: Vec<f32> = (0..6).map(|at| found[6 + at] - found[at]).collect();
        assert!(moved.iter().skip(1).step_by(2).all(|y| y.abs() < 1e-4), "{moved:?}");
        assert!(moved.iter().step_by(2).any(|x| x.abs() > 0.002), "{moved:?}");
    }
}
