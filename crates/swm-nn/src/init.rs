//! Initial weights, sampled from keyed streams: a function of the seed and the name of a tensor, as PyTorch distributes them.

use burn::module::Module;
use rand::RngExt as _;
use rand_distr::StandardNormal;
use swm_core::seed::keyed;

use crate::params::{self, Spec};

/// The initial std of Hugging Face's vision transformers; also that of the tokens that gather a frame.
const TOKEN_STD: f32 = 0.02;

/// Replaces all weights. Layers begin as in `torch.nn`, those of vision transformers as Hugging Face's do, and the
/// modulations of AdaLN-zero with zeros.
pub fn initialize<M: Module>(module: M, seed: u64) -> M {
    // A bias is sampled from the range of its layer's weight, which comes before it.
    let mut inputs = 1;
    params::map(module, |spec, tensor| {
        if spec.shape.len() > 1 {
            inputs = spec.shape[1..].iter().product();
        }
        let mut values = vec![0.0; spec.shape.iter().product()];
        fill(spec, inputs, seed, &mut values);
        params::from_host(spec, values, &tensor)
    })
}

/// Fills the values of a tensor of a layer with this many inputs.
fn fill(spec: &Spec, inputs: usize, seed: u64, values: &mut [f32]) {
    let mut stream = keyed(seed, &format!("weights {}", spec.name), [0, 0]);
    let (layer, name) = (spec.place.0, spec.place.1.as_str());
    let std = match (layer, name) {
        ("LayerNorm" | "BatchNorm", "weight")
        | (_, "running_var" | "lambda1" | "deviation")
        | ("LatentScale", "std" | "change")
        | ("LatentMoments", "std") => {
            return values.fill(1.0);
        }
        ("LayerNorm" | "BatchNorm" | "Background" | "LatentScale" | "LatentMoments", _)
        | (_, "log_stds" | "log_ent_coef" | "running_mean" | "running_count") => return,
        _ if spec.name.contains("adaLN_modulation") => return,
        (_, "bias") if spec.is_in_vit => return,
        (_, "pos_embedding" | "pos_embedding_goal") => 1.0,
        (_, "frame_tokens") => TOKEN_STD,
        _ if spec.is_in_vit => TOKEN_STD,
        _ => {
            let bound = 1.0 / (inputs as f32).sqrt();
            return values.iter_mut().for_each(|value| *value = stream.random_range(-bound..bound));
        }
    };
    values.iter_mut().for_each(|value| *value = stream.sample::<f32, _>(StandardNormal) * std);
}
