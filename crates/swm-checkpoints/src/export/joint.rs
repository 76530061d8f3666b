//! LeWM and PLDM in the reference's words.

use std::collections::BTreeMap;

use serde_json::{Map, Value as Json, json};
use swm_baselines::{EncoderConfig, JointConfig, ModelConfig};
use swm_nn::VitConfig;
use swm_weights::{Saved, Stored, Values};

use super::layout::{Layout, Unfit};
use super::names::Encoder;

/// Dim, blocks and heads of the reference's sizes.
const SIZES: [(&str, [usize; 3]); 5] = [
    ("tiny", [192, 12, 3]),
    ("small", [384, 12, 6]),
    ("base", [768, 12, 12]),
    ("large", [1024, 24, 16]),
    ("huge", [1280, 32, 16]),
];

/// A LeWM or PLDM.
pub(super) fn layout(model: &ModelConfig, stored: &BTreeMap<String, Stored>) -> Result<Layout, Unfit> {
    let joint: JointConfig = serde_json::from_value(model.settings["model"].clone())
        .map_err(|error| format!("its settings cannot be read: {error}"))?;
    let is_pldm = model.baseline == "pldm";
    let JointConfig { latent_dim: dim, projector, history, smoothed, frameskip, .. } = joint;
    let predictor = &joint.predictor;
    let (encoder, encoder_dim) = vit(&joint.encoder)?;
    let (root, target) = match is_pldm {
        true => ("stable_worldmodel.wm.pldm", "stable_worldmodel.wm.pldm.pldm.PLDM"),
        false => ("stable_worldmodel.wm.lewm", "stable_worldmodel.wm.lewm.LeWM"),
    };
    let norm = json!({ "_target_": "torch.nn.BatchNorm1d", "_partial_": true });
    let mlp = |inputs: usize| {
        json!({ "_target_": format!("{root}.module.MLP"), "input_dim": inputs, "output_dim": dim, "hidden_dim": projector,
            "norm_fn": norm })
    };
    let action = frameskip * model.dims.action_dim;
    let config = json!({
        "_target_": target,
        "encoder": encoder,
        "predictor": {
            "_target_": format!("{root}.module.Predictor"), "num_frames": history, "input_dim": dim, "hidden_dim": dim,
            "output_dim": dim, "depth": predictor.depth, "heads": predictor.heads, "mlp_dim": predictor.hidden,
            "dim_head": predictor.head_dim, "dropout": predictor.dropout, "emb_dropout": 0.0,
        },
        "action_encoder": {
            "_target_": format!("{root}.module.Embedder"), "input_dim": action, "smoothed_dim": smoothed, "emb_dim": dim,
        },
        "projector": mlp(encoder_dim),
        "pred_proj": mlp(dim),
    });
    let counters = stored.keys().filter_map(|name| counter(name)).collect();
    Ok(Layout {
        config,
        encoder: Some(Encoder { prefix: "encoder.", dinov2: false }),
        left_out: &["idm.", "drawing."],
        added: counters,
        facts: vec![
            ("latent", format!("{dim} values")),
            ("history", format!("{history} frames")),
            ("action block", format!("{frameskip} actions, {action} values")),
        ],
        ..Layout::default()
    })
}

/// The batches that a batch normalization has counted: nobody reads it, and its class has it.
fn counter(name: &str) -> Option<Saved> {
    let norm = name.strip_suffix("running_mean")?;
    Some((format!("{norm}num_batches_tracked"), Vec::new(), Values::Integers(vec![0])))
}

/// The encoder's part of the config, and the dim of its summary.
fn vit(config: &EncoderConfig) -> Result<(Json, usize), Unfit> {
    let vit = match config {
        EncoderConfig::Vit(vit) if !vit.dinov2 => vit,
        EncoderConfig::Vit(_) => {
            let reason =
                "its encoder is a DINOv2 (`model.encoder.dinov2`), and the reference's model has a ViT";
            return Err(reason.into());
        }
        _ => {
            let reason = "its encoder is not a vision transformer (`model.encoder.kind`), and the reference's model has one; train \
                          one with the setting `model.encoder.kind` at vit, as the preset `paper` has it";
            return Err(reason.into());
        }
    };
    let &VitConfig { dim, depth, heads, hidden, patch, positions_for, .. } = vit;
    let named = SIZES.iter().find(|(_, sizes)| *sizes == [dim, depth, heads] && hidden == 4 * dim);
    let mut config = Map::from_iter([
        ("_target_".to_owned(), json!("stable_pretraining.backbone.utils.vit_hf")),
        ("size".to_owned(), json!(named.map_or(SIZES[0].0, |(name, _)| name))),
        ("patch_size".to_owned(), json!(patch)),
        ("image_size".to_owned(), json!(positions_for)),
        ("pretrained".to_owned(), json!(false)),
        ("use_mask_token".to_owned(), json!(false)),
    ]);
    if named.is_none() {
        for (name, value) in [
            ("hidden_size", dim),
            ("num_hidden_layers", depth),
            ("num_attention_heads", heads),
            ("intermediate_size", hidden),
        ] {
            config.insert(name.to_owned(), json!(value));
        }
    }
    Ok((config.into(), dim))
}
