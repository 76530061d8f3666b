//! What looks at tokens of a frozen encoder, as settings of ours: DINO-WM, which the reference calls PreJEPA, also as its authors'
//! archive; and the goal-conditioned policies.

use std::fs;
use std::path::Path;

use serde_json::{Value as Json, json};
use swm_baselines::train::LONGEST_CONFIG;
use swm_nn::vit_epsilon;
use swm_tasks::request::{Fix, Message, TaskError};

use super::config::Node;
use super::recipe::{Given, Recipe, first, of};
use super::shapes::{Shapes, VitShape, heads, root, unsaid_heads};

/// Settings of the reference's predictors. Nothing reads `pool`, there or here.
const PREDICTOR: [&str; 13] = [
    "num_patches",
    "num_frames",
    "dim",
    "depth",
    "heads",
    "mlp_dim",
    "dim_head",
    "dropout",
    "emb_dropout",
    "out_dim",
    "pool",
    "pool_type",
    "causal",
];

/// Mean and std of PushT's actions in the authors' archive, which are constants of its code (`datasets/pusht_dset.py`).
const PUSHT_ACTIONS: ([f64; 2], [f64; 2]) = ([-0.0087, 0.0068], [0.2019, 0.2002]);

/// A DINO-WM.
pub(super) fn dino_wm(given: &Given<'_>) -> Result<Recipe, TaskError> {
    let Given { shapes, config, .. } = given;
    // The authors' `hydra.yaml` describes a training, the reference's `config.json` a model.
    let archive =
        config.as_ref().filter(|config| config.get("img_size").is_some() || config.get("num_hist").is_some());
    let node = match archive {
        Some(_) => None,
        None => config.as_ref(),
    };
    let predictor = node.map(|config| config.need("predictor")).transpose()?;
    if let Some(predictor) = &predictor {
        predictor.check_module(&["CausalPredictor"], &PREDICTOR)?;
    }
    if let Some(extra) = node.and_then(|config| config.get("extra_encoders")) {
        check_extra(&extra)?;
    }
    let predictor = predictor.as_ref();
    let history = of(node, "history_size")?.or(of(archive, "num_hist")?).or(of(predictor, "num_frames")?);
    let history = history.unwrap_or(3);
    if let Some(predictor) = predictor {
        predictor.check_field("num_frames", history)?;
    }
    let at_encoder = match (given.encoder.is_empty(), shapes.has_below("backbone.")) {
        (false, _) => given.encoder.vit("")?.or(given.encoder.vit("backbone.")?),
        (true, _) => shapes.vit("backbone.")?,
    };
    let without_encoder = !shapes.is_empty() && !shapes.has_below("backbone.");
    if without_encoder && given.encoder.is_empty() {
        let message = Message::new("the weights of the encoder, a frozen DINOv2, are not in the file");
        return Err(message.fix(Fix::set("encoder", "dinov2_vits14_pretrain.pth")).into());
    }
    let encoder = config.as_ref().and_then(|config| config.get("encoder"));
    let (encoder, patch) = frozen(given, encoder.as_ref(), at_encoder, "encoder")?;
    let tokens = of(predictor, "num_patches")?.map(|patches| patches * history);
    let tokens = tokens.or_else(|| shapes.dim("predictor.pos_embedding", 1)).unwrap_or(256 * history);
    let image = image(given, tokens, history, patch)?;
    let found = shapes.predictor("predictor.transformer.", ["0.to_qkv.weight", "1.net.1.weight"], 3);
    let said = (of(predictor, "heads")?, of(predictor, "dim_head")?.or(predictor.map(|_| 64)));
    let [heads, head_dim] = heads(said, found.map(|found| found.inner), "predictor", given.set)?;
    let extra = |key: &str, axis| shapes.dim(&format!("extra_encoders.{key}.patch_embed.weight"), axis);
    let config_extra = |key: &str, name: &str| -> Result<Option<usize>, TaskError> {
        let modules =
            node.and_then(|config| config.get("extra_encoders")).and_then(|extra| extra.get("modules"));
        modules.and_then(|modules| modules.get(key)).map_or(Ok(None), |of| of.number(name))
    };
    let (block, action) = (config_extra("action", "in_chans")?.or(extra("action", 1)), extra("action", 0));
    let (vector, proprio) =
        (config_extra("proprio", "in_chans")?.or(extra("proprio", 1)), extra("proprio", 0));
    let dropout = predictor.map_or(Ok(None), |predictor| predictor.real("dropout"))?.unwrap_or(0.1);
    let is_pusht = archive.and_then(|config| config.get("env")?.text("name").ok()?) == Some("pusht");
    let scaled = archive.is_some_and(|config| config.is_true("normalize_action")) && is_pusht;
    let constants = PUSHT_ACTIONS;
    Ok(Recipe {
        name: "dino-wm",
        settings: json!({
            "image": image, "encoder": encoder, "history": history,
            "normalization": if archive.is_some() { "half" } else { "imagenet" },
            "proprio": first(config_extra("proprio", "emb_dim")?, proprio, 0),
            "action": first(config_extra("action", "emb_dim")?, action, 10),
            "predictor": {
                "depth": first(of(predictor, "depth")?, found.map(|found| found.depth), 6), "heads": heads,
                "head_dim": head_dim, "hidden": first(of(predictor, "mlp_dim")?, found.map(|found| found.hidden), 2048),
                "dropout": dropout,
            },
        }),
        frameskip_at: Some("frameskip"),
        block: block.unwrap_or(10),
        frameskip: of(archive, "frameskip")?,
        vector: vector.unwrap_or(0),
        column: "proprio".to_owned(),
        image,
        history,
        without_encoder,
        action_scale: scaled.then(|| {
            (constants.0.to_vec(), constants.1.to_vec(), "constants of the archive's code for PushT")
        }),
    })
}

/// Refuses other encoders of vectors than those of ours, in their order.
fn check_extra(extra: &Node<'_>) -> Result<(), TaskError> {
    let modules = extra.need("modules")?;
    let names: Vec<&str> = modules.fields().into_iter().flatten().map(|(name, _)| name.as_str()).collect();
    match names[..] {
        ["proprio", "action"] | ["action"] => names.iter().try_for_each(|name| {
            modules
                .need(name)?
                .check_module(&["Embedder"], &["in_chans", "emb_dim", "num_frames", "tubelet_size"])
        }),
        _ => Err(modules.wrong(&format!("are {}; this program has proprio, then action", names.join(", ")))),
    }
}

/// A goal-conditioned policy, of the name `name` or told by its tensors.
pub(super) fn goal(given: &Given<'_>, name: Option<&'static str>) -> Result<Recipe, TaskError> {
    let Given { shapes, config, .. } = given;
    let name = match name {
        Some(name) => name,
        None if shapes.dim("value_predictor.student.embed_proj.weight", 0).is_some() => "hilp",
        None if shapes.has_below("critic_predictor.") => "gciql",
        None if !shapes.has_below("value_predictor.") => "gcbc",
        None => {
            let message = Message::new(
                "its tensors are those of a policy that was extracted from a value, of gciql or gcivl",
            );
            return Err(message.fix(Fix::set("kind", "gciql")).into());
        }
    };
    let pools_by_attention = ["value_predictor.student", "critic_predictor.student"].iter().any(|part| {
        let place = |layer| format!("{part}.transformer.layers.{layer}.0.frame_tokens");
        (0..64).any(|layer: usize| shapes.has_below(&place(layer)))
    });
    if name != "hilp" && pools_by_attention {
        let text = "its values take a frame's tokens together by attention (`frame_tokens`), and this program's by their mean; \
                    `load_pretrained` in Python has both";
        return Err(Message::new(text).into());
    }
    let actor = config.as_ref().and_then(|config| config.get("action_predictor"));
    if let Some(actor) = &actor {
        actor.check_module(&["Predictor"], &PREDICTOR)?;
        if actor.get("causal").is_some() && !actor.is_true("causal") {
            return Err(actor.other("causal", "false", "true"));
        }
    }
    // The trainers of values store the settings of the whole training.
    let sizes = actor.clone().or_else(|| config.as_ref().and_then(|config| config.get("predictor")));
    let training = config.as_ref().and_then(|config| config.get("dinowm"));
    let (sizes, config) = (sizes.as_ref(), config.as_ref());
    let history =
        of(config, "history_size")?.or(of(training.as_ref(), "history_size")?).or(of(sizes, "num_frames")?);
    let history = history.unwrap_or(3);
    let encoder = config.and_then(|config| config.get("encoder"));
    let without_encoder = !shapes.is_empty() && !shapes.has_below("encoder.");
    if without_encoder && given.encoder.is_empty() {
        let message = Message::new("the weights of the encoder, a frozen DINOv2, are not in the file");
        return Err(message.fix(Fix::set("encoder", "dinov2_vits14_pretrain.pth")).into());
    }
    let found = match given.encoder.is_empty() {
        true => shapes.vit("encoder.")?,
        false => given.encoder.vit("")?.or(given.encoder.vit("encoder.")?),
    };
    let (encoder, patch) = frozen(given, encoder.as_ref(), found, "model.encoder")?;
    let tokens = of(sizes, "num_patches")?.map(|patches| patches * history);
    let tokens = tokens.or_else(|| shapes.dim("action_predictor.pos_embedding", 1)).unwrap_or(256 * history);
    let image = image(given, tokens, history, patch)?;
    let place = "action_predictor.transformer.";
    let transformer = shapes.predictor(place, ["0.to_q.weight", "1.net.1.weight"], 1);
    let said = (of(sizes, "heads")?, of(sizes, "dim_head")?.or(sizes.map(|_| 64)));
    let [heads, head_dim] = heads(said, transformer.map(|found| found.inner), "model.predictor", given.set)?;
    let pools = (0..64).any(|layer| shapes.has_below(&format!("{place}layers.{layer}.0.frame_tokens")));
    let pool = if pools || shapes.is_empty() { "attention" } else { "mean" };
    let extra = |axis| shapes.dim("extra_encoders.proprio.patch_embed.weight", axis);
    let block =
        of(sizes, "out_dim")?.or_else(|| shapes.dim("log_stds", 0)).or(of(training.as_ref(), "action_dim")?);
    let dropout = sizes.map_or(Ok(None), |sizes| sizes.real("dropout"))?.unwrap_or(0.0);
    let mut settings = json!({ "model": {
        "image": image, "encoder": encoder, "train_encoder": false, "proprio": extra(0).unwrap_or(0), "history": history,
        "predictor": {
            "depth": first(of(sizes, "depth")?, transformer.map(|found| found.depth), 6), "heads": heads,
            "head_dim": head_dim, "hidden": first(of(sizes, "mlp_dim")?, transformer.map(|found| found.hidden), 2048),
            "dropout": dropout, "pool": pool,
        },
    } });
    match name {
        "gciql" => {
            let hidden = shapes.dim("critic_predictor.student.q_head.0.weight", 0);
            settings["critic_hidden"] = hidden.unwrap_or(256).into();
        }
        "hilp" => {
            let dim = shapes.dim("value_predictor.student.embed_proj.weight", 0);
            settings["embed_dim"] = dim.unwrap_or(64).into();
        }
        _ => {}
    }
    Ok(Recipe {
        name,
        settings,
        frameskip_at: Some("model.frameskip"),
        block: block.unwrap_or(2),
        frameskip: of(config, "frameskip")?,
        vector: extra(1).unwrap_or(0),
        column: "proprio".to_owned(),
        image,
        history,
        without_encoder,
        action_scale: None,
    })
}

/// Settings of a frozen encoder, and the side of its patches.
fn frozen(
    given: &Given<'_>,
    node: Option<&Node<'_>>,
    found: Option<VitShape>,
    place: &str,
) -> Result<(Json, usize), TaskError> {
    let named = node.map_or(Ok(None), |node| node.text("name"))?;
    let published = named.and_then(published);
    if let (Some(node), Some(name), None) = (node, named, &published)
        && [
            "dinov3",
            "siglip",
            "mae",
            "ijepa",
            "vjepa",
            "webssl",
            "resnet",
            "dinov2-giant",
            "dinov2_giant",
            "reg4",
            "registers",
        ]
        .iter()
        .any(|other| name.contains(other))
    {
        let reason = format!("is {name}; this program has DINOv2 small, base and large without registers");
        return Err(node.need("name")?.wrong(&reason));
    }
    let set = given.set.pointer(&format!("/{}/heads", place.replace('.', "/"))).and_then(Json::as_u64);
    let shape = found.or(published).unwrap_or(VitShape {
        dim: 384,
        depth: 12,
        hidden: 1536,
        patch: 14,
        positions_for: 518,
        dinov2: true,
    });
    let beside = match given.folder.zip(named) {
        Some((folder, name)) => heads_beside(folder, name, vit_epsilon(shape.dinov2))?,
        None => None,
    };
    let heads = set.map(|heads| heads as usize).or(beside).or_else(|| shape.usual_heads());
    let heads = heads.ok_or_else(|| unsaid_heads(place, "the encoder"))?;
    Ok((shape.settings(heads), shape.patch))
}

/// The sizes of a published DINOv2.
fn published(name: &str) -> Option<VitShape> {
    let last = name.rsplit('/').next()?.replace('_', "-");
    let dim = match last.as_str() {
        "dinov2-small" | "dinov2-vits14" => 384,
        "dinov2-base" | "dinov2-vitb14" => 768,
        "dinov2-large" | "dinov2-vitl14" => 1024,
        _ => return None,
    };
    let depth = if dim == 1024 { 24 } else { 12 };
    Some(VitShape { dim, depth, hidden: 4 * dim, patch: 14, positions_for: 518, dinov2: true })
}

/// The heads of an encoder whose `config.json` is in a folder beside the checkpoint. One that computes otherwise than ours is refused.
fn heads_beside(folder: &Path, name: &str, epsilon: f64) -> Result<Option<usize>, TaskError> {
    let Some(config) = config_beside(folder, name) else { return Ok(None) };
    let file = format!("{name}/config.json");
    let node = Node::root(&file, &config)?;
    if let Some(other) = node.text("hidden_act")?.filter(|&name| name != "gelu") {
        return Err(node.other("hidden_act", other, "gelu"));
    }
    if let Some(other) = node.real("layer_norm_eps")?.filter(|&found| found != epsilon) {
        return Err(node.other("layer_norm_eps", other, format_args!("{epsilon:e}")));
    }
    node.number("num_attention_heads")
}

/// The `config.json` of an encoder in the checkpoint's folder, if it is there; links lead nowhere else.
fn config_beside(folder: &Path, name: &str) -> Option<Json> {
    let inside = folder.canonicalize().ok()?;
    let file = folder.join(name).join("config.json").canonicalize().ok()?;
    if !file.starts_with(&inside) || fs::metadata(&file).ok()?.len() > LONGEST_CONFIG {
        return None;
    }
    serde_json::from_slice(&fs::read(file).ok()?).ok()
}

/// The side of images whose patches are `tokens` of `history` frames.
fn image(given: &Given<'_>, tokens: usize, history: usize, patch: usize) -> Result<usize, TaskError> {
    if let Some(image) = given.image {
        return Ok(image);
    }
    let side = tokens.is_multiple_of(history.max(1)).then(|| root(tokens / history.max(1))).flatten();
    let side = side.ok_or_else(|| {
        Message::new(format!("its {tokens} positions are not those of {history} square images of patches"))
            .fix(Fix::Set { setting: swm_tasks::request::Assignment::name("image"), to: "" })
    })?;
    Ok(side * patch)
}

/// Refuses networks of others by the names of their tensors.
pub(super) fn check_names(shapes: &Shapes) -> Result<(), TaskError> {
    let others = [
        ("level1.", "a model of vladisai/PLDM (MeNet)"),
        ("predictor.action_proj.", "the GCBC of stable-worldmodel 0.0.3"),
        ("predictor.predictor_blocks.", "a predictor of facebookresearch/jepa-wms (jepa_wm, vjepa2_ac)"),
        ("predictor.rnn", "a model of vladisai/PLDM (RNN)"),
    ];
    match others.iter().find(|(prefix, _)| shapes.has_below(prefix)) {
        Some((_, what)) => {
            Err(Message::new(format!("it is {what}, which this program does not have")).into())
        }
        None => Ok(()),
    }
}
