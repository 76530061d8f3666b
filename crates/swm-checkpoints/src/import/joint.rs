//! LeWM and PLDM of the reference as settings of ours.

use serde_json::{Value as Json, json};
use swm_tasks::request::TaskError;

use super::config::Node;
use super::recipe::{Given, Recipe, first, of};
use super::shapes::{Shapes, VitShape, heads, unsaid_heads};

const ENCODER: [&str; 9] = [
    "size",
    "patch_size",
    "image_size",
    "pretrained",
    "use_mask_token",
    "hidden_size",
    "num_hidden_layers",
    "num_attention_heads",
    "intermediate_size",
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
    let part = |name: &str| config.as_ref().map(|config| config.need(name)).transpose();
    let (encoder, predictor, embedder) = (part("encoder")?, part("predictor")?, part("action_encoder")?);
    let (projector, pred_proj) = (part("projector")?, part("pred_proj")?);
    if let Some(config) = config {
        let parts = ["encoder", "predictor", "action_encoder", "projector", "pred_proj"];
        let mut fields = config.fields().into_iter().flatten();
        // Numbers and texts beside the parts are a trainer's.
        if let Some((other, _)) =
            fields.find(|(name, value)| !parts.contains(&name.as_str()) && value.is_object())
        {
            return Err(config.need(other)?.wrong("is a part that this program's model does not have"));
        }
    }
    let (encoder, image) = vit(encoder.as_ref(), shapes, given)?;
    let dim = shapes.dim("predictor.pos_embedding", 2);
    let found = shapes.predictor("predictor.transformer.", ["attn.to_qkv.weight", "mlp.net.1.weight"], 3);
    let predictor = predictor.as_ref();
    if let Some(predictor) = predictor {
        predictor.check_module(&["Predictor", "ARPredictor"], &PREDICTOR)?;
        let input = predictor.number("input_dim")?.unwrap_or(192);
        predictor.check_field("hidden_dim", input)?;
        predictor.check_field("output_dim", input)?;
    }
    let latent_dim = first(of(predictor, "input_dim")?, dim, 192);
    let said = (of(predictor, "heads")?, of(predictor, "dim_head")?.or(predictor.map(|_| 64)));
    let [heads, head_dim] = heads(said, found.map(|found| found.inner), "model.predictor", given.set)?;
    let embedder = embedder.as_ref();
    if let Some(embedder) = embedder {
        embedder.check_module(&["Embedder"], &["input_dim", "smoothed_dim", "emb_dim", "mlp_scale"])?;
        embedder.check_field("emb_dim", latent_dim)?;
        embedder.check_field("mlp_scale", 4)?;
    }
    let block = of(embedder, "input_dim")?.or_else(|| shapes.dim("action_encoder.patch_embed.weight", 1));
    let smoothed = of(embedder, "smoothed_dim")?.or(embedder.map(|_| 10));
    let smoothed = first(smoothed, shapes.dim("action_encoder.patch_embed.weight", 0), 10);
    let hidden = mlp(projector.as_ref(), latent_dim)?;
    if let (Some(hidden), Some(pred_proj)) = (hidden, &pred_proj) {
        mlp(Some(pred_proj), latent_dim)?;
        pred_proj.check_field("hidden_dim", hidden)?;
    }
    let projector = first(hidden, shapes.dim("projector.net.0.weight", 0), 2048);
    let history = first(of(predictor, "num_frames")?, shapes.dim("predictor.pos_embedding", 1), 3);
    let depth = first(of(predictor, "depth")?, found.map(|found| found.depth), 6);
    let hidden = first(of(predictor, "mlp_dim")?, found.map(|found| found.hidden), 2048);
    let dropout = predictor.map_or(Ok(None), |predictor| predictor.real("dropout"))?.unwrap_or(0.1);
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

/// The hidden dim of a projector, whose other sides are those of the latent.
fn mlp(node: Option<&Node<'_>>, latent_dim: usize) -> Result<Option<usize>, TaskError> {
    let Some(node) = node else { return Ok(None) };
    node.check_module(&["MLP"], &["input_dim", "output_dim", "hidden_dim", "norm_fn", "act_fn"])?;
    node.check_field("output_dim", latent_dim)?;
    if let Some(act) = node.get("act_fn") {
        act.check_module(&["GELU"], &[])?;
    }
    node.need("norm_fn")?.check_module(&["BatchNorm1d"], &[])?;
    node.number("hidden_dim")
}

/// Settings of the encoder, and the side of its images.
fn vit(node: Option<&Node<'_>>, shapes: &Shapes, given: &Given<'_>) -> Result<(Json, usize), TaskError> {
    let found = shapes.vit("encoder.")?;
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
        let size = node.text("size")?.unwrap_or("tiny");
        let Some((_, [dim, depth, heads])) = SIZES.iter().find(|(name, _)| *name == size) else {
            return Err(node
                .need("size")?
                .wrong(&format!("is {size}; known are tiny, small, base, large and huge")));
        };
        vit = VitShape {
            dim: node.number("hidden_size")?.unwrap_or(*dim),
            depth: node.number("num_hidden_layers")?.unwrap_or(*depth),
            hidden: node.number("intermediate_size")?.unwrap_or(4 * dim),
            patch: node.number("patch_size")?.unwrap_or(16),
            positions_for: node.number("image_size")?.unwrap_or(224),
            dinov2: false,
        };
        known_heads = Some(node.number("num_attention_heads")?.unwrap_or(*heads));
    }
    let set = given.set.pointer("/model/encoder/heads").and_then(Json::as_u64).map(|heads| heads as usize);
    let heads = set.or(known_heads).or_else(|| vit.usual_heads());
    let heads = heads.ok_or_else(|| unsaid_heads("model.encoder", "the encoder"))?;
    Ok((vit.settings(heads), given.image.unwrap_or(vit.positions_for)))
}
