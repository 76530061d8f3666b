//! Vision transformers of two families, which differ in epsilon and in the scales on their branches: Hugging Face's
//! ViT, and DINOv2. Names are those of transformers 5; `weights` knows the older ones.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};

use super::attention::{Attend, attend, join, split};
use super::linear::{Conv, Linear, parameter};
use super::norm::LayerNorm;
use crate::pass::Pass;

/// Its size. The defaults are those of ViT-tiny with patches of 14 pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VitConfig {
    /// Embedding dim of a token.
    #[serde(alias = "width")]
    pub dim: usize,
    /// Blocks.
    pub depth: usize,
    /// Attention heads; they divide `dim`.
    pub heads: usize,
    /// Hidden dim of the MLP after each attention.
    pub hidden: usize,
    /// Side of a patch in pixels.
    pub patch: usize,
    /// Side in pixels of the images that the table of positions is for. Other sizes interpolate it.
    pub positions_for: usize,
    /// DINOv2's form: epsilon 1e-6 instead of 1e-12, and a learned scale on each branch.
    pub dinov2: bool,
}

impl Default for VitConfig {
    fn default() -> Self {
        Self { dim: 192, depth: 12, heads: 3, hidden: 768, patch: 14, positions_for: 224, dinov2: false }
    }
}

impl VitConfig {
    /// DINOv2-small: positions of 518-pixel images.
    pub fn dinov2_small() -> Self {
        Self { dim: 384, heads: 6, hidden: 1536, positions_for: 518, dinov2: true, ..Self::default() }
    }

    /// What is wrong with it, if anything is.
    ///
    /// # Errors
    ///
    /// What is wrong, which the caller adds the model to.
    pub fn check(&self, size: [usize; 2]) -> Result<(), String> {
        if self.heads == 0 || !self.dim.is_multiple_of(self.heads) {
            return Err(format!("{} heads do not divide a dim of {}", self.heads, self.dim));
        }
        if self.patch == 0 || self.positions_for < self.patch || size.iter().any(|side| *side < self.patch) {
            return Err(format!("no patch of {} pixels fits into an image of {size:?}", self.patch));
        }
        Ok(())
    }

    /// P: patches of an image.
    pub fn patches(&self, size: [usize; 2]) -> usize {
        size.iter().map(|side| side / self.patch).product()
    }
}

/// A vision transformer without pooling.
#[derive(Module, Debug)]
pub struct Vit {
    embeddings: Embeddings,
    layers: Vec<Layer>,
    layernorm: LayerNorm,
    #[module(skip)]
    config: VitConfig,
}

#[derive(Module, Debug)]
struct Embeddings {
    /// `[1, 1, W]`.
    cls_token: Param<Tensor<3>>,
    /// `[1, 1 + patches, W]`.
    position_embeddings: Param<Tensor<3>>,
    patch_embeddings: PatchEmbeddings,
}

#[derive(Module, Debug)]
struct PatchEmbeddings {
    projection: Conv,
}

#[derive(Module, Debug)]
struct Layer {
    norm1: LayerNorm,
    attention: SelfAttention,
    layer_scale1: Option<LayerScale>,
    norm2: LayerNorm,
    mlp: Mlp,
    layer_scale2: Option<LayerScale>,
}

#[derive(Module, Debug)]
struct SelfAttention {
    q_proj: Linear,
    k_proj: Linear,
    v_proj: Linear,
    o_proj: Linear,
}

#[derive(Module, Debug)]
struct LayerScale {
    lambda1: Param<Tensor<1>>,
}

#[derive(Module, Debug)]
struct Mlp {
    fc1: Linear,
    fc2: Linear,
}

impl Vit {
    /// A network of zeros.
    pub fn new(config: &VitConfig, device: &Device) -> Self {
        let &VitConfig { dim, patch, positions_for, .. } = config;
        let positions = (positions_for / patch).pow(2);
        Self {
            embeddings: Embeddings {
                cls_token: parameter([1, 1, dim], device),
                position_embeddings: parameter([1, 1 + positions, dim], device),
                patch_embeddings: PatchEmbeddings { projection: Conv::new([3, dim], patch, device) },
            },
            layers: (0..config.depth).map(|_| Layer::new(config, device)).collect(),
            layernorm: LayerNorm::with_epsilon(dim, vit_epsilon(config.dinov2), device),
            config: config.clone(),
        }
    }

    /// `[N, 3, H, W]` images → `[N, 1 + P, D]`: the summary token, then the patches row by row.
    pub fn forward(&self, images: Tensor<4>) -> Tensor<3> {
        let heads = self.config.heads;
        let tokens = self.embed(images);
        let tokens = self.layers.iter().fold(tokens, |tokens, layer| layer.forward(tokens, heads, false));
        self.layernorm.forward(tokens)
    }

    /// `[N, 3, H, W]` images → `[N, D]`: the summary tokens of [`Vit::forward`]. Of the last block only they are computed.
    pub fn summaries(&self, images: Tensor<4>) -> Tensor<2> {
        let (heads, last) = (self.config.heads, self.layers.len().saturating_sub(1));
        let tokens =
            self.layers.iter().enumerate().fold(self.embed(images), |tokens, (index, layer)| {
                layer.forward(tokens, heads, index == last)
            });
        self.layernorm.forward(tokens.narrow(1, 0, 1)).squeeze_dim(1)
    }

    fn embed(&self, images: Tensor<4>) -> Tensor<3> {
        let [count, ..] = images.dims();
        let patches = self.embeddings.patch_embeddings.projection.forward_patches(images);
        let grid = [patches.dims()[2], patches.dims()[3]];
        let patches = patches.flatten::<3>(2, 3).swap_dims(1, 2);
        let cls = self.embeddings.cls_token.val().expand([count, 1, self.config.dim]);
        Tensor::cat(vec![cls, patches], 1) + self.positions(grid)
    }

    /// `[1, 1 + P, D]`: the table of positions, resampled to a grid of patches.
    fn positions(&self, [rows, columns]: [usize; 2]) -> Tensor<3> {
        let table = self.embeddings.position_embeddings.val();
        let side = self.config.positions_for / self.config.patch;
        if [rows, columns] == [side; 2] {
            return table;
        }
        let (down, across) = (bicubic(side, rows), bicubic(side, columns));
        let mut weights = Vec::with_capacity(rows * columns * side * side);
        for row in down.chunks_exact(side) {
            for column in across.chunks_exact(side) {
                weights.extend(row.iter().flat_map(|y| column.iter().map(move |x| (y * x) as f32)));
            }
        }
        let weights = TensorData::new(weights, [1, rows * columns, side * side]);
        let weights = Tensor::<3>::from_data(weights, &table.device().inner());
        let patches = weights.matmul(table.clone().narrow(1, 1, side * side));
        Tensor::cat(vec![table.narrow(1, 0, 1), patches], 1)
    }
}

/// What is added to variances before they divide, in the form of DINOv2 or the other.
pub fn vit_epsilon(dinov2: bool) -> f64 {
    if dinov2 { 1e-6 } else { 1e-12 }
}

impl Layer {
    fn new(config: &VitConfig, device: &Device) -> Self {
        let (dim, linear) = (config.dim, |inputs, outputs| Linear::new(inputs, outputs, device));
        let scale = || config.dinov2.then(|| LayerScale { lambda1: parameter([dim], device) });
        Self {
            norm1: LayerNorm::with_epsilon(dim, vit_epsilon(config.dinov2), device),
            attention: SelfAttention {
                q_proj: linear(dim, dim),
                k_proj: linear(dim, dim),
                v_proj: linear(dim, dim),
                o_proj: linear(dim, dim),
            },
            layer_scale1: scale(),
            norm2: LayerNorm::with_epsilon(dim, vit_epsilon(config.dinov2), device),
            mlp: Mlp { fc1: linear(dim, config.hidden), fc2: linear(config.hidden, dim) },
            layer_scale2: scale(),
        }
    }

    /// All tokens, or the first alone.
    fn forward(&self, tokens: Tensor<3>, heads: usize, only_first: bool) -> Tensor<3> {
        let branch = self.attention.forward(self.norm1.forward(tokens.clone()), heads, only_first);
        let tokens = if only_first { tokens.narrow(1, 0, 1) } else { tokens };
        let tokens = tokens + scaled(branch, self.layer_scale1.as_ref());
        let hidden = self.mlp.fc1.forward_gelu(self.norm2.forward(tokens.clone()));
        tokens + scaled(self.mlp.fc2.forward(hidden), self.layer_scale2.as_ref())
    }
}

fn scaled(branch: Tensor<3>, scale: Option<&LayerScale>) -> Tensor<3> {
    match scale {
        Some(scale) => branch * scale.lambda1.val().unsqueeze(),
        None => branch,
    }
}

impl SelfAttention {
    fn forward(&self, tokens: Tensor<3>, heads: usize, only_first: bool) -> Tensor<3> {
        let asking = if only_first { tokens.clone().narrow(1, 0, 1) } else { tokens.clone() };
        let q = self.q_proj.forward_narrow(asking);
        let [k, v] = [self.k_proj.forward_narrow(tokens.clone()), self.v_proj.forward_narrow(tokens)];
        // These networks drop nothing, in training either.
        let qkv = [q, k, v].map(|part| split(part, heads));
        self.o_proj.forward(join(attend(qkv, &Attend::All, 0.0, &mut Pass::evaluate())))
    }
}

/// `[to, from]`: the weights of PyTorch's bicubic interpolation (a = -0.75, corners not aligned, edges repeated).
fn bicubic(from: usize, to: usize) -> Vec<f64> {
    const A: f64 = -0.75;
    let near = |x: f64| ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0;
    let far = |x: f64| ((A * x - 5.0 * A) * x + 8.0 * A) * x - 4.0 * A;
    let mut weights = vec![0.0; to * from];
    for (index, row) in weights.chunks_exact_mut(from).enumerate() {
        let place = (index as f64 + 0.5) * from as f64 / to as f64 - 0.5;
        let t = place - place.floor();
        for (offset, weight) in (-1..).zip([far(t + 1.0), near(t), near(1.0 - t), far(2.0 - t)]) {
            let column = (place.floor() as i64 + offset).clamp(0, from as i64 - 1);
            row[column as usize] += weight;
        }
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bicubic_weights_sum_to_one_and_keep_equal_sizes() {
        for row in bicubic(5, 3).chunks_exact(5) {
            assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        let same = bicubic(4, 4);
        assert!((0..4).all(|i| (0..4).all(|j| (same[i * 4 + j] - f64::from(i == j)).abs() < 1e-12)));
    }

    #[test]
    fn settings_that_do_not_fit_are_refused() {
        assert!(VitConfig::default().check([224; 2]).is_ok());
        assert!(VitConfig { heads: 5, ..VitConfig::default() }.check([224; 2]).is_err());
        assert!(VitConfig::default().check([224, 8]).is_err());
    }
}
