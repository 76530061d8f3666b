//! A convolutional predictor of feature maps that actions steer by FiLM, feature-wise linear modulation (arXiv 1709.07871): a scale
//! and a shift of each channel, the same at all cells. The same motion looks the same everywhere on the grid.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use super::linear::{Conv, Linear};
use super::norm::LayerNorm;

/// Its size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FilmPredictorConfig {
    /// Residual blocks, each a convolution of 3 × 3 cells: a prediction sees as many cells to each side.
    pub depth: usize,
    /// Channels between them.
    pub channels: usize,
    /// Dim of the action embedding.
    pub action: usize,
}

impl Default for FilmPredictorConfig {
    fn default() -> Self {
        Self { depth: 4, channels: 64, action: 64 }
    }
}

/// Predicts how a feature map changes under an action.
#[derive(Module, Debug)]
pub struct FilmPredictor {
    input: Linear,
    blocks: Vec<FilmBlock>,
    norm: LayerNorm,
    output: Linear,
}

#[derive(Module, Debug)]
struct FilmBlock {
    norm: LayerNorm,
    film: Linear,
    conv: Conv,
    output: Linear,
}

impl FilmPredictor {
    /// For maps of `grid` × `grid` cells of `token_dim` channels. A single cell has no neighbors, and kernels of one cell.
    pub fn new(config: &FilmPredictorConfig, [grid, token_dim]: [usize; 2], device: &Device) -> Self {
        let &FilmPredictorConfig { depth, channels, action } = config;
        let kernel = if grid == 1 { 1 } else { 3 };
        let block = || FilmBlock {
            norm: LayerNorm::plain(1e-6),
            film: Linear::new(action, 2 * channels, device),
            conv: Conv::new([channels; 2], kernel, device),
            output: Linear::new(channels, channels, device),
        };
        Self {
            input: Linear::new(token_dim, channels, device),
            blocks: std::iter::repeat_with(block).take(depth).collect(),
            norm: LayerNorm::new(channels, device),
            output: Linear::new(channels, token_dim, device),
        }
    }

    /// `[N, G, G, C]` and embedded actions `[N, E]` → the maps after them, `[N, G, G, C]`.
    pub fn forward(&self, maps: Tensor<4>, actions: &Tensor<2>) -> Tensor<4> {
        let [count, rows, columns, dim] = maps.dims();
        let cells = self.input.forward(maps.clone().reshape([count * rows * columns, dim]));
        let grid = [count, rows, columns];
        let cells =
            self.blocks.iter().fold(cells, |cells, block| block.forward(cells, actions.clone(), grid));
        maps + self.output.forward(self.norm.forward(cells)).reshape([count, rows, columns, dim])
    }
}

impl FilmBlock {
    /// Cells `[N × G × G, C]` of so many maps, rows and columns.
    fn forward(&self, cells: Tensor<2>, actions: Tensor<2>, [count, rows, columns]: [usize; 3]) -> Tensor<2> {
        let channels = cells.dims()[1];
        let film: Tensor<3> = self.film.forward(actions).unsqueeze_dim(1);
        let (scale, shift) = (film.clone().narrow(2, 0, channels), film.narrow(2, channels, channels));
        let input = self.norm.forward(cells.clone()).reshape([count, rows * columns, channels]);
        let input = input * (scale + 1.0) + shift;
        let seen = self.conv.rectified(input.reshape([count, rows, columns, channels]), 1);
        cells + self.output.forward(seen.reshape([count * rows * columns, channels]))
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::TensorData;

    use super::*;
    use crate::params::{self, host};

    /// One block over two channels whose kernel takes each cell's own value.
    fn simple(device: &Device) -> FilmPredictor {
        let config = FilmPredictorConfig { depth: 1, channels: 2, action: 1 };
        params::map(FilmPredictor::new(&config, [2, 2], device), |spec, zeros| {
            let values = match spec.name.as_str() {
                "input.weight" | "blocks.0.output.weight" | "output.weight" => vec![1.0, 0.0, 0.0, 1.0],
                // Scales by 1 + 2 a and 1 - a; shifts by 0.5 a and 0.
                "blocks.0.film.weight" => vec![2.0, -1.0, 0.5, 0.0],
                // [out, in, 3, 3]: 1 in the middle, of the same channel.
                "blocks.0.conv.weight" => {
                    (0..36).map(|at| if [4, 31].contains(&at) { 1.0 } else { 0.0 }).collect()
                }
                "norm.weight" => vec![1.0; 2],
                _ => return zeros,
            };
            params::from_host(spec, values, &zeros)
        })
    }

    #[test]
    fn a_cell_is_scaled_shifted_rectified_and_added() {
        let device = Device::flex();
        let predictor = simple(&device);
        let tensor =
            |values: Vec<f32>, shape| Tensor::<4>::from_data(TensorData::new(values, shape), &device);
        let maps = tensor(vec![3.0, 1.0, -1.0, 5.0], [1, 1, 2, 2]);
        let action = Tensor::<2>::from_data(TensorData::new(vec![0.5_f32], [1, 1]), &device);
        let next = host(predictor.forward(maps, &action));
        // Of two channels, layer norm leaves ±1. Cell 1: (1, -1) → FiLM (2.25, -0.5) → rectified (2.25, 0), added (5.25, 1), whose
        // norm is (1, -1), added: (4, 0). Cell 2: (-1, 1) → (-1.75, 0.5) → (0, 0.5), added (-1, 5.5) → (-1, 1) → (-2, 6).
        for (found, wanted) in next.iter().zip([4.0, 0.0, -2.0, 6.0]) {
            assert!((found - wanted).abs() < 1e-4, "{next:?}");
        }
    }
}
