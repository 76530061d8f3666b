//! A frozen DINOv2 or ViT, which the reference makes by its name: that of a published one, or of a folder in the form of transformers.

use std::collections::BTreeMap;

use serde_json::{Value as Json, json};
use swm_baselines::EncoderConfig;
use swm_nn::VitConfig;
use swm_weights::{Saved, Stored, Values};

use super::layout::Unfit;
use super::names::{Encoder, Generation};

/// The folder beside the weights.
pub(super) const FOLDER: &str = "backbone";
/// Names, dims, blocks and heads of the published DINOv2s, whose patches have 14 pixels and whose positions are for 518.
const PUBLISHED: [(&str, [usize; 3]); 3] = [
    ("facebook/dinov2-small", [384, 12, 6]),
    ("facebook/dinov2-base", [768, 12, 12]),
    ("facebook/dinov2-large", [1024, 24, 16]),
];

/// A folder with an encoder.
pub(super) struct Backbone {
    /// Its `config.json`.
    pub(super) config: Json,
    /// Its `model.safetensors`.
    pub(super) tensors: Vec<(String, Vec<usize>, Vec<f32>)>,
}

/// How a config names a frozen encoder.
pub(super) struct Named {
    /// Its part of the model's config.
    pub(super) config: Json,
    /// The config of its folder, where it is not published.
    pub(super) folder: Option<Json>,
    /// Whether it is a DINOv2.
    pub(super) dinov2: bool,
    /// Tensors that take no part in what it computes, which its class has all the same.
    pub(super) idle: Vec<Saved>,
    pub(super) notes: Vec<String>,
}

impl Backbone {
    /// Of all tensors of a model.
    pub(super) fn new(config: Json, encoder: Option<&Encoder>, stored: &BTreeMap<String, Stored>) -> Self {
        let Some(encoder) = encoder else { return Self { config, tensors: Vec::new() } };
        let own = stored.iter().filter_map(|(name, Stored { shape, values, .. })| {
            // All versions of transformers write and read the old names in its files.
            let name = encoder.inner(name.strip_prefix(encoder.prefix)?, Generation::Four);
            Some((name, shape.clone(), values.clone()))
        });
        let mut tensors: Vec<_> = own.collect();
        let dim = config["hidden_size"].as_u64().unwrap_or(0) as usize;
        tensors.extend(idle(dim, encoder.dinov2).map(|(name, shape, zeros)| (name.to_owned(), shape, zeros)));
        Self { config, tensors }
    }
}

/// What an encoder's class has and nothing reads: the token of masked images, or the layer behind the first token.
fn idle(dim: usize, dinov2: bool) -> impl Iterator<Item = (&'static str, Vec<usize>, Vec<f32>)> {
    let tensors = match dinov2 {
        true => vec![("embeddings.mask_token", vec![1, dim])],
        false => vec![("pooler.dense.weight", vec![dim, dim]), ("pooler.dense.bias", vec![dim])],
    };
    tensors.into_iter().map(|(name, shape)| {
        let zeros = vec![0.0; shape.iter().product()];
        (name, shape, zeros)
    })
}

/// The frozen encoder of a model, whose tensors begin with `prefix`.
pub(super) fn named(config: &EncoderConfig, prefix: &str, place: &str) -> Result<Named, Unfit> {
    let EncoderConfig::Vit(vit) = config else {
        return Err(format!(
            "its encoder is not a vision transformer (`{place}.kind`), and the reference's model has one; train it with a \
             frozen DINOv2, as the preset `paper` has it"
        )
        .into());
    };
    let &VitConfig { dim, depth, heads, hidden, patch, positions_for, dinov2 } = vit;
    let is_published = dinov2 && patch == 14 && positions_for == 518 && hidden == 4 * dim;
    let published = PUBLISHED.iter().find(|(_, sizes)| is_published && *sizes == [dim, depth, heads]);
    let name = published.map_or(FOLDER, |(name, _)| name);
    let mut notes = Vec::new();
    // A whole number as such: transformers 5 takes no float.
    let ratio: Json = match hidden.is_multiple_of(dim.max(1)) {
        _ if !dinov2 => Json::Null,
        true => (hidden / dim.max(1)).into(),
        false => {
            let ratio = hidden as f64 / dim as f64;
            if (dim as f64 * ratio) as usize != hidden {
                return Err(
                    format!("its encoder's hidden dim of {hidden} is no multiple of its dim, {dim}").into()
                );
            }
            notes.push(format!(
                "its encoder's hidden dim of {hidden} (`{place}.hidden`) is no multiple of its dim, {dim}: transformers 4 loads it, and 5 does \
                 not"
            ));
            ratio.into()
        }
    };
    let folder = match dinov2 {
        true => json!({
            "architectures": ["Dinov2Model"], "model_type": "dinov2", "hidden_size": dim, "num_hidden_layers": depth,
            "num_attention_heads": heads, "mlp_ratio": ratio, "patch_size": patch, "image_size": positions_for,
            "num_channels": 3, "hidden_act": "gelu", "layer_norm_eps": 1e-6, "layerscale_value": 1.0, "qkv_bias": true,
            "use_swiglu_ffn": false, "use_mask_token": true, "hidden_dropout_prob": 0.0,
            "attention_probs_dropout_prob": 0.0, "drop_path_rate": 0.0,
        }),
        false => json!({
            "architectures": ["ViTModel"], "model_type": "vit", "hidden_size": dim, "num_hidden_layers": depth,
            "num_attention_heads": heads, "intermediate_size": hidden, "patch_size": patch, "image_size": positions_for,
            "num_channels": 3, "hidden_act": "gelu", "layer_norm_eps": 1e-12, "qkv_bias": true,
            "hidden_dropout_prob": 0.0, "attention_probs_dropout_prob": 0.0,
        }),
    };
    let beside = format!(
        "the encoder is in the folder `{FOLDER}`, which the reference looks for below the current folder: load it from within the \
         checkpoint's folder, or with extra_args={{\"encoder.name\": …}}"
    );
    notes.extend(published.is_none().then_some(beside));
    Ok(Named {
        config: json!({ "_target_": "stable_worldmodel.wm.prejepa.module.create_backbone", "name": name }),
        notes,
        folder: published.is_none().then_some(folder),
        dinov2,
        idle: idle(dim, dinov2)
            .map(|(name, shape, zeros)| (format!("{prefix}{name}"), shape, Values::Floats(zeros)))
            .collect(),
    })
}
