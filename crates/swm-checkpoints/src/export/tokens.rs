//! Models of the tokens of a frozen DINOv2 or ViT in the reference's words: DINO-WM, which it calls PreJEPA, and goal-conditioned policies.

use std::collections::BTreeMap;

use serde_json::{Map, Value as Json, json};
use swm_baselines::{DinoWmConfig, GoalConfig, ModelConfig, Normalization};
use swm_nn::{GoalTransformerConfig, Pool};
use swm_weights::{Saved, Stored, Values};

use super::backbone::{Named, named};
use super::layout::{Layout, Unfit};
use super::names::Encoder;

const PREJEPA: &str = "stable_worldmodel.wm.prejepa.module";
const GCRL: &str = "stable_worldmodel.wm.gcrl.module";

/// A DINO-WM.
pub(super) fn dino_wm(model: &ModelConfig) -> Result<Layout, Unfit> {
    let settings: DinoWmConfig = parse(&model.settings)?;
    let DinoWmConfig { image, proprio, action, history, frameskip, ref predictor, .. } = settings;
    let Named { config: encoder, folder, dinov2, idle, mut notes } =
        named(&settings.encoder, "backbone.", "encoder")?;
    let [patches, dim] = settings.encoder.tokens(image);
    let dim = dim + proprio + action;
    let block = frameskip * model.dims.action_dim;
    let embedder = |inputs: usize, dim: usize| json!({ "_target_": format!("{PREJEPA}.Embedder"), "in_chans": inputs, "emb_dim": dim });
    let mut modules = Map::new();
    if proprio > 0 {
        modules.insert("proprio".to_owned(), embedder(model.dims.proprio_dim, proprio));
    }
    modules.insert("action".to_owned(), embedder(block, action));
    let config = json!({
        "_target_": "stable_worldmodel.wm.PreJEPA",
        "history_size": history,
        "num_pred": 1,
        // A DINOv2 interpolates its positions in any case.
        "interpolate_pos_encoding": !dinov2,
        "encoder": encoder,
        "predictor": {
            "_target_": format!("{PREJEPA}.CausalPredictor"), "num_patches": patches, "num_frames": history, "dim": dim,
            "depth": predictor.depth, "heads": predictor.heads, "mlp_dim": predictor.hidden, "dim_head": predictor.head_dim,
            "dropout": predictor.dropout, "emb_dropout": 0.0,
        },
        "extra_encoders": { "_target_": "torch.nn.ModuleDict", "modules": modules },
    });
    let mask = causal(history, patches, patches).into_iter().map(|allowed| f32::from(u8::from(allowed)));
    let mask: Vec<f32> = mask.collect();
    let tokens = history * patches;
    let mut added = idle;
    added.extend((0..predictor.depth).map(|layer| {
        let name = format!("predictor.transformer.layers.{layer}.0.bias");
        (name, vec![1, 1, tokens, tokens], Values::Floats(mask.clone()))
    }));
    if settings.normalization == Normalization::Half {
        notes.push(
            "images are scaled to [-1, 1], and not by ImageNet's moments as the reference does".to_owned(),
        );
    }
    Ok(Layout {
        config,
        encoder: Some(Encoder { prefix: "backbone.", dinov2 }),
        backbone: folder,
        added,
        facts: facts(image, history, frameskip, block, patches),
        notes,
        ..Layout::default()
    })
}

/// A goal-conditioned policy, with the value that it was extracted from, where there is one that was learned.
pub(super) fn goal(
    model: &ModelConfig,
    stored: &BTreeMap<String, Stored>,
    lacks: &[String],
) -> Result<Layout, Unfit> {
    let settings: GoalConfig = parse(&model.settings["model"])?;
    let GoalConfig { image, proprio, history, frameskip, ref predictor, .. } = settings;
    let Named { config: encoder, folder, dinov2, idle, notes } =
        named(&settings.encoder, "encoder.", "model.encoder")?;
    if predictor.compare {
        let reason = "its transformers see what sets a frame apart from the goal (`model.predictor.compare`), which the reference's \
                      do not";
        return Err(reason.into());
    }
    let [patches, dim] = settings.encoder.tokens(image);
    let dim = dim + proprio;
    let block = frameskip * model.dims.action_dim;
    let part = |class: &str, predictor: &GoalTransformerConfig| {
        json!({
            "_target_": format!("{GCRL}.{class}"), "num_patches": patches, "num_frames": history, "dim": dim,
            "depth": predictor.depth, "heads": predictor.heads, "mlp_dim": predictor.hidden, "dim_head": predictor.head_dim,
            "dropout": predictor.dropout, "emb_dropout": 0.0,
        })
    };
    let mut actor = part("Predictor", predictor);
    actor["out_dim"] = block.into();
    if predictor.pool == Pool::Mean {
        actor["pool_type"] = "mean".into();
    }
    let mut config = json!({
        "_target_": "stable_worldmodel.wm.gcrl.gcrl.GCRL", "history_size": history, "encoder": encoder, "action_predictor": actor,
    });
    let student = "value_predictor.student.";
    let has_value = stored.keys().any(|name| name.starts_with(student))
        && !lacks.iter().any(|name| name.starts_with("value_predictor."));
    if has_value {
        let mut value =
            part(if model.baseline == "hilp" { "MetricValuePredictor" } else { "Predictor" }, predictor);
        if model.baseline == "hilp" {
            value["embed_dim"] = model.settings["embed_dim"].clone();
        } else {
            (value["out_dim"], value["pool_type"]) = (1.into(), "mean".into());
        }
        config["value_predictor"] =
            json!({ "_target_": "stable_pretraining.backbone.EvalOnly", "backbone": value });
    }
    if proprio > 0 {
        let inputs = model.dims.proprio_dim;
        let embedder =
            json!({ "_target_": format!("{GCRL}.Embedder"), "in_chans": inputs, "emb_dim": proprio });
        config["extra_encoders"] =
            json!({ "_target_": "torch.nn.ModuleDict", "modules": { "proprio": embedder } });
    }
    let mut added = idle;
    added.extend(masks(stored, "action_predictor.", "action_predictor.", history, patches));
    if has_value {
        added.extend(masks(stored, student, "value_predictor.backbone.", history, patches));
    }
    let left_out: &[&str] = match has_value {
        true => &["value_predictor.teacher.", "critic_predictor."],
        false => &["value_predictor.", "critic_predictor."],
    };
    Ok(Layout {
        config,
        encoder: Some(Encoder { prefix: "encoder.", dinov2 }),
        backbone: folder,
        left_out,
        renamed: vec![(student.to_owned(), "value_predictor.backbone.".to_owned())],
        added,
        facts: facts(image, history, frameskip, block, patches),
        notes,
    })
}

fn parse<C: serde::de::DeserializeOwned>(settings: &Json) -> Result<C, Unfit> {
    serde_json::from_value(settings.clone())
        .map_err(|error| format!("its settings cannot be read: {error}").into())
}

/// Which of `frames × patches` tokens each of `frames × queries` sees: those of its frame and of earlier ones.
fn causal(frames: usize, queries: usize, patches: usize) -> Vec<bool> {
    let rows = (0..frames * queries).map(|row| row / queries.max(1));
    rows.flat_map(|frame| (0..frames * patches).map(move |column| column / patches.max(1) <= frame)).collect()
}

/// The masks of the layers of a transformer that look at frames: those at a goal have none.
fn masks(
    stored: &BTreeMap<String, Stored>,
    ours: &str,
    theirs: &str,
    frames: usize,
    patches: usize,
) -> Vec<Saved> {
    let mut masks = Vec::new();
    for layer in 0.. {
        let place = format!("transformer.layers.{layer}.0.");
        let has = |name: &str| stored.contains_key(&format!("{ours}{place}{name}"));
        if !has("norm.weight") {
            break;
        }
        if has("norm_c.weight") {
            continue;
        }
        let queries = if has("frame_tokens") { 1 } else { patches };
        let shape = vec![1, 1, frames * queries, frames * patches];
        masks.push((
            format!("{theirs}{place}causal_mask"),
            shape,
            Values::Bools(causal(frames, queries, patches)),
        ));
    }
    masks
}

fn facts(
    image: usize,
    history: usize,
    frameskip: usize,
    block: usize,
    patches: usize,
) -> Vec<(&'static str, String)> {
    vec![
        ("images", format!("{image} × {image} pixels, {patches} tokens")),
        ("history", format!("{history} frames")),
        ("action block", format!("{frameskip} actions, {block} values")),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_sees_itself_and_what_was_before() {
        let [yes, no] = [true, false];
        assert_eq!(causal(2, 1, 2), [yes, yes, no, no, yes, yes, yes, yes]);
        assert_eq!(causal(2, 2, 2)[..8], [yes, yes, no, no, yes, yes, no, no]);
    }
}
