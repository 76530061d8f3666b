//! LeWM and PLDM of the reference as settings of ours.

use serde_json::{Value as Json, json};
use swm_nn::vit_epsilon;
use swm_tasks::request::{Message, TaskError};

use super::config::{Node, is_far_above};
use super::recipe::{Given, Recipe, said, size};
use super::shapes::{VitShape, heads, unsaid_heads};

const ENCODER: [&str; 17] = [
    "size",
    "patch_size",
    "image_size",
    "pretrained",
    "use_mask_token",
    "hidden_size",
    "num_hidden_layers",
    "num_attention_heads",
    "intermediate_size",
    "hidden_act",
    "layer_norm_eps",
    "num_channels",
    "qkv_bias",
    "use_swiglu_ffn",
    "hidden_dropout_prob",
    "attention_probs_dropout_prob",
    "drop_path_rate",
];
const PREDICTOR: [&str; 10] = [
    "num_frames",
    "input_dim",
    "hidden_dim",
    "output_dim",
    "depth",
    "heads",
    "mlp_dim",
    "dim_head",
    "dropout",
    "emb_dropout",
];
/// Dim, blocks and heads of the sizes of the reference's vision transformers.
const SIZES: [(&str, [usize; 3]); 5] = [
    ("tiny", [192, 12, 3]),
    ("small", [384, 12, 6]),
    ("base", [768, 12, 12]),
    ("large", [1024, 24, 16]),
    ("huge", [1280, 32, 16]),
];

/// A LeWM or PLDM, of the name `name`.
pub(super) fn recipe(given: &Given<'_>, name: &'static str) -> Result<Recipe, TaskError> {
    let Given { shapes, config, .. } = given;
    // The settings of a whole training say how many heads and frames, and tensors say the rest.
    let (model, training) = match config {
        Some(config) if config.is_training() => (None, Some(config)),
        config => (config.as_ref(), None),
    };
    let part = |name: &str| model.map(|config| config.need(name)).transpose();
    let (encoder, predictor, embedder) = (part("encoder")?, part("predictor")?, part("action_encoder")?);
    let without = "; `load_pretrained` in Python has models without it";
    let projector = |name: &str| model.map(|config| config.need_or(name, without)).transpose();
    let (projector, pred_proj) = (projector("projector")?, projector("pred_proj")?);
    if let Some(config) = model {
        let parts = ["encoder", "predictor", "action_encoder", "projector", "pred_proj"];
        let mut fields = config.fields().into_iter().flatten();
        // Numbers and texts beside the parts are a trainer's.
        if let Some((other, _)) =
            fields.find(|(name, value)| !parts.contains(&name.as_str()) && value.is_object())
        {
            return Err(config.need(other)?.wrong("is a part that this program's model does not have"));
        }
    }
    let (encoder, vit) = vit(given, encoder.as_ref(), shapes.vit("encoder.")?, "model.encoder")?;
    let image = given.image.unwrap_or(vit.positions_for);
    let dim = shapes.dim("predictor.pos_embedding", 2);
    let found = shapes.predictor("predictor.transformer.", ["attn.to_qkv.weight", "mlp.net.1.weight"], 3);
    let predictor = predictor.as_ref();
    if let Some(predictor) = predictor {
        predictor.check_module(&["Predictor", "ARPredictor"], &PREDICTOR)?;
        let input = predictor.number("input_dim")?.unwrap_or(192);
        predictor.check_field("hidden_dim", input)?;
        predictor.check_field("output_dim", input)?;
    }
    let latent_dim = size(predictor, "input_dim", dim, 192)?;
    let trained = training.and_then(|config| config.get("predictor"));
    let sizes = predictor.or(trained.as_ref());
    let usual_dim = predictor.map(|_| 64);
    let [heads, head_dim] =
        heads(given, sizes, usual_dim, found.map(|found| found.inner), "model.predictor")?;
    let embedder = embedder.as_ref();
    if let Some(embedder) = embedder {
        embedder.check_module(&["Embedder"], &["input_dim", "smoothed_dim", "emb_dim", "mlp_scale"])?;
        embedder.check_field("emb_dim", latent_dim)?;
        embedder.check_field("mlp_scale", 4)?;
    }
    let block = said(embedder, "input_dim", shapes.dim("action_encoder.patch_embed.weight", 1))?;
    let smoothed = size(embedder, "smoothed_dim", shapes.dim("action_encoder.patch_embed.weight", 0), 10)?;
    [&projector, &pred_proj].into_iter().flatten().try_for_each(|node| mlp(node, latent_dim))?;
    let projector = size(projector.as_ref(), "hidden_dim", shapes.dim("projector.net.0.weight", 0), 2048)?;
    if let Some(pred_proj) = &pred_proj {
        pred_proj.check_field("hidden_dim", projector)?;
    }
    let history = size(predictor, "num_frames", shapes.dim("predictor.pos_embedding", 1), 3)?;
    let depth = size(sizes, "depth", found.map(|found| found.depth), 6)?;
    let hidden = size(sizes, "mlp_dim", found.map(|found| found.hidden), 2048)?;
    let dropout = sizes.map_or(Ok(None), |sizes| sizes.real("dropout"))?.unwrap_or(0.1);
    let mut settings = json!({ "model": {
        "image": image, "encoder": encoder, "latent_dim": latent_dim, "projector": projector, "history": history,
        "smoothed": smoothed, "predictor": { "depth": depth, "heads": heads, "head_dim": head_dim, "hidden": hidden,
            "dropout": dropout },
    } });
    if let (Some(inverse), "pldm") = (shapes.dim("idm.net.0.weight", 0), name) {
        settings["inverse_hidden"] = inverse.into();
    }
    Ok(Recipe {
        name,
        settings,
        frameskip_at: Some("model.frameskip"),
        block: block.unwrap_or(10),
        frameskip: None,
        vector: 0,
        column: String::new(),
        image,
        history,
        without_encoder: false,
        action_scale: None,
    })
}

/// Refuses a projector whose other sides are not those of the latent, or of other layers.
fn mlp(node: &Node<'_>, latent_dim: usize) -> Result<(), TaskError> {
    node.check_module(&["MLP"], &["input_dim", "output_dim", "hidden_dim", "norm_fn", "act_fn"])?;
    node.check_field("output_dim", latent_dim)?;
    if let Some(act) = node.get("act_fn") {
        act.check_module(&["GELU"], &[])?;
    }
    node.need("norm_fn")?.check_module(&["BatchNorm1d"], &[])
}

/// Settings of a vision transformer at `place`, and its shape: what a `vit_hf` says, which the weights must have, or these alone.
pub(super) fn vit(
    given: &Given<'_>,
    node: Option<&Node<'_>>,
    found: Option<VitShape>,
    place: &str,
) -> Result<(Json, VitShape), TaskError> {
    let mut known_heads = None;
    let mut vit = found.unwrap_or(VitShape {
        dim: 192,
        depth: 12,
        hidden: 768,
        patch: 14,
        positions_for: 224,
        dinov2: false,
    });
    if let Some(node) = node {
        node.check_module(&["vit_hf"], &ENCODER)?;
        check_fixed(node, false)?;
        let size = node.text("size")?.unwrap_or("tiny");
        let Some((_, [dim, depth, heads])) = SIZES.iter().find(|(name, _)| *name == size) else {
            return Err(node
                .need("size")?
                .wrong(&format!("is {size}; known are tiny, small, base, large and huge")));
        };
        let of = |name: &str, at: fn(&VitShape) -> usize, usual: usize| {
            Ok::<usize, TaskError>(match node.number(name)? {
                Some(_) => node.size(name, found.as_ref().map(at))?.unwrap_or(usual),
                None => usual,
            })
        };
        vit = VitShape {
            dim: of("hidden_size", |vit| vit.dim, *dim)?,
            depth: of("num_hidden_layers", |vit| vit.depth, *depth)?,
            hidden: of("intermediate_size", |vit| vit.hidden, 4 * dim)?,
            patch: of("patch_size", |vit| vit.patch, 16)?,
            positions_for: node.number("image_size")?.unwrap_or(224),
            dinov2: false,
        };
        known_heads = Some(node.number("num_attention_heads")?.unwrap_or(*heads));
        if let Some(found) = found.filter(|found| is_far_above(vit.positions_for, found.positions_for)) {
            let (said, found) = (vit.positions_for, found.positions_for);
            return Err(node.wrong_field("image_size", &format!("is {said}, and the weights have {found}")));
        }
    }
    let set = given.set_number(&format!("{place}.heads"));
    let heads = set.or(known_heads).or_else(|| vit.usual_heads());
    let heads = heads.ok_or_else(|| unsaid_heads(place, "the encoder"))?;
    let settings = vit.settings(heads, &|reason| match node.filter(|_| set.is_none()) {
        Some(node) => node.wrong_field("num_attention_heads", reason),
        None => Message::new(format!("{place}.heads {reason}")).into(),
    })?;
    Ok((settings, vit))
}

/// Refuses settings of transformers that have another value here. What they drop in training changes no output.
pub(super) fn check_fixed(node: &Node<'_>, dinov2: bool) -> Result<(), TaskError> {
    if let Some(other) = node.text("hidden_act")?.filter(|&name| name != "gelu") {
        return Err(node.other("hidden_act", other, "gelu"));
    }
    let epsilon = vit_epsilon(dinov2);
    if let Some(other) = node.real("layer_norm_eps")?.filter(|&found| found != epsilon) {
        return Err(node.other("layer_norm_eps", other, format_args!("{epsilon:e}")));
    }
    if node.is_true("use_swiglu_ffn") {
        return Err(node.other("use_swiglu_ffn", true, false));
    }
    node.check_true("qkv_bias")?;
    node.check_field("num_channels", 3)
}
