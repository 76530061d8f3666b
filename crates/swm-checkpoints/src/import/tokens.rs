//! What looks at tokens of a frozen encoder, as settings of ours: DINO-WM, which the reference calls PreJEPA, also as its authors'
//! archive; and the goal-conditioned policies.

use std::fs;
use std::path::Path;

use serde_json::{Value as Json, json};
use swm_baselines::train::LONGEST_CONFIG;
use swm_tasks::request::{Fix, Message, TaskError};

use super::config::Node;
use super::joint::{self, check_fixed};
use super::recipe::{Given, Recipe, of, said, size};
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
    // The authors' `hydra.yaml` describes a training, as some files of the reference's trainers, and the reference's `config.json` a model.
    let archive = config.as_ref().filter(|config| {
        config.get("wm").is_none() && (config.get("img_size").is_some() || config.get("num_hist").is_some())
    });
    let training = archive.or(config.as_ref().filter(|config| config.is_training()));
    let node = match training {
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
    let trained = training.and_then(|config| config.get("predictor"));
    let sizes = predictor.or(trained.as_ref());
    let frames = of(predictor, "num_frames")?;
    let history = of(node, "history_size")?.or(of(archive, "num_hist")?);
    let history = history.or(of(training.and_then(|config| config.get("wm")).as_ref(), "history_size")?);
    let history = given.set_number("history").or(history).or(frames).unwrap_or(3).max(1);
    if let (Some(predictor), Some(frames)) = (predictor, frames) {
        check_frames(predictor, frames, history, "history")?;
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
    let encoder = config.as_ref().and_then(|config| config.get("encoder").or_else(|| config.get("backbone")));
    let (encoder, patch) = frozen(given, encoder, at_encoder, "encoder")?;
    let positions = shapes.dim("predictor.pos_embedding", 1);
    let patches = positions.filter(|all| all.is_multiple_of(history)).map(|all| all / history);
    let tokens = said(predictor, "num_patches", patches)?.map(|patches| patches * history);
    let image = image(given, tokens.or(positions).unwrap_or(256 * history), history, patch, "history")?;
    let found = shapes.predictor("predictor.transformer.", ["0.to_qkv.weight", "1.net.1.weight"], 3);
    let usual_dim = predictor.map(|_| 64);
    let [heads, head_dim] = heads(given, sizes, usual_dim, found.map(|found| found.inner), "predictor")?;
    let extra = |key: &str, axis| shapes.dim(&format!("extra_encoders.{key}.patch_embed.weight"), axis);
    let modules = node.and_then(|config| config.get("extra_encoders")).and_then(|extra| extra.get("modules"));
    let extra = |key: &str, name: &str, axis| -> Result<Option<usize>, TaskError> {
        let module = modules.as_ref().and_then(|modules| modules.get(key));
        said(module.as_ref(), name, extra(key, axis))
    };
    let dropout = sizes.map_or(Ok(None), |sizes| sizes.real("dropout"))?.unwrap_or(0.1);
    let is_pusht = archive.and_then(|config| config.get("env")?.text("name").ok()?) == Some("pusht");
    let scaled = archive.is_some_and(|config| config.is_true("normalize_action")) && is_pusht;
    let constants = PUSHT_ACTIONS;
    Ok(Recipe {
        name: "dino-wm",
        settings: json!({
            "image": image, "encoder": encoder, "history": history,
            // The authors' code has 0.5 for mean and std, and so has facebookresearch/jepa-wms.
            "normalization": if archive.is_some() || given.is_archive { "half" } else { "imagenet" },
            "proprio": extra("proprio", "emb_dim", 0)?.unwrap_or(0),
            "action": extra("action", "emb_dim", 0)?.unwrap_or(10),
            "predictor": {
                "depth": size(sizes, "depth", found.map(|found| found.depth), 6)?, "heads": heads,
                "head_dim": head_dim, "hidden": size(sizes, "mlp_dim", found.map(|found| found.hidden), 2048)?,
                "dropout": dropout,
            },
        }),
        frameskip_at: Some("frameskip"),
        block: extra("action", "in_chans", 1)?.unwrap_or(10),
        frameskip: of(training, "frameskip")?,
        vector: extra("proprio", "in_chans", 1)?.unwrap_or(0),
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
        actor.check_true("causal")?;
    }
    // The trainers of values store the settings of the whole training.
    let sizes = actor.clone().or_else(|| config.as_ref().and_then(|config| config.get("predictor")));
    let training = config.as_ref().and_then(|config| config.get("dinowm"));
    let (sizes, config) = (sizes.as_ref(), config.as_ref());
    let (frames, set) = (of(sizes, "num_frames")?, given.set_number("model.history"));
    let history = of(config, "history_size")?.or(of(training.as_ref(), "history_size")?).or(frames);
    // A frame of the goal has as many tokens as one of the history.
    let [positions, patches] =
        ["", "_goal"].map(|of| shapes.dim(&format!("action_predictor.pos_embedding{of}"), 1));
    let found = positions.zip(patches).filter(|(all, one)| *one > 0 && all.is_multiple_of(*one));
    let history = set.or(history).or(found.map(|(all, one)| all / one)).unwrap_or(3).max(1);
    if let (Some(sizes), Some(frames)) = (sizes, frames) {
        check_frames(sizes, frames, history, "model.history")?;
    }
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
    let (encoder, patch) = frozen(given, encoder, found, "model.encoder")?;
    let tokens = said(sizes, "num_patches", patches)?.map(|patches| patches * history);
    let image = image(given, tokens.or(positions).unwrap_or(256 * history), history, patch, "model.history")?;
    let place = "action_predictor.transformer.";
    let transformer = shapes.predictor(place, ["0.to_q.weight", "1.net.1.weight"], 1);
    let inner = transformer.map(|found| found.inner);
    let usual_dim = actor.as_ref().map(|_| 64);
    let [heads, head_dim] = heads(given, sizes, usual_dim, inner, "model.predictor")?;
    let pools = (0..64).any(|layer| shapes.has_below(&format!("{place}layers.{layer}.0.frame_tokens")));
    let pool = if pools || shapes.is_empty() { "attention" } else { "mean" };
    let extra = |axis| shapes.dim("extra_encoders.proprio.patch_embed.weight", axis);
    let block = said(sizes, "out_dim", shapes.dim("log_stds", 0))?.or(of(training.as_ref(), "action_dim")?);
    let dropout = sizes.map_or(Ok(None), |sizes| sizes.real("dropout"))?.unwrap_or(0.0);
    let mut settings = json!({ "model": {
        "image": image, "encoder": encoder, "train_encoder": false, "proprio": extra(0).unwrap_or(0), "history": history,
        "predictor": {
            "depth": size(sizes, "depth", transformer.map(|found| found.depth), 6)?, "heads": heads,
            "head_dim": head_dim, "hidden": size(sizes, "mlp_dim", transformer.map(|found| found.hidden), 2048)?,
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

/// Refuses a predictor with another number of frames than the model sees: its positions are those of all frames.
fn check_frames(node: &Node<'_>, frames: usize, history: usize, place: &str) -> Result<(), TaskError> {
    if frames == history {
        return Ok(());
    }
    let text =
        format!("is {frames}, and its history_size is {history}: this program has one number of frames");
    let set = Fix::set("set", format!("{place}={frames}"));
    Err(Message::new(node.told_of("num_frames", &text)).fix(set).into())
}

/// Settings of a frozen encoder, and the side of its patches.
fn frozen(
    given: &Given<'_>,
    node: Option<Node<'_>>,
    found: Option<VitShape>,
    place: &str,
) -> Result<(Json, usize), TaskError> {
    let node = match node {
        Some(wrapper) if wrapper.class()? == Some("EvalOnly") => {
            wrapper.check_module(&["EvalOnly"], &["backbone"])?;
            Some(wrapper.need("backbone")?)
        }
        node => node,
    };
    let node = node.as_ref();
    match node.map_or(Ok(None), Node::class)? {
        Some("vit_hf") => {
            let (settings, vit) = joint::vit(given, node, found, place)?;
            return Ok((settings, vit.patch));
        }
        // The authors' archive names a class of its own.
        Some(class) if class != "DinoV2Encoder" => {
            node.map_or(Ok(()), |node| node.check_class(&["create_backbone", "vit_hf"]))?;
        }
        _ => {}
    }
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
    let set = given.set_number(&format!("{place}.heads"));
    let shape = found.or(published).unwrap_or(VitShape {
        dim: 384,
        depth: 12,
        hidden: 1536,
        patch: 14,
        positions_for: 518,
        dinov2: true,
    });
    let beside = match given.folder.zip(named) {
        Some((folder, name)) => heads_beside(folder, name, shape.dinov2)?,
        None => None,
    };
    let heads = set.or(beside).or_else(|| shape.usual_heads());
    let heads = heads.ok_or_else(|| unsaid_heads(place, "the encoder"))?;
    let settings = shape.settings(heads, &|reason| match (set.or(beside), set, named) {
        (Some(_), None, Some(name)) => {
            Message::new(format!("{name}/config.json: num_attention_heads {reason}")).into()
        }
        _ => Message::new(format!("{place}.heads {reason}")).into(),
    })?;
    Ok((settings, shape.patch))
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
fn heads_beside(folder: &Path, name: &str, dinov2: bool) -> Result<Option<usize>, TaskError> {
    let Some(config) = config_beside(folder, name) else { return Ok(None) };
    let file = format!("{name}/config.json");
    let node = Node::root(&file, &config)?;
    check_fixed(&node, dinov2)?;
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
fn image(
    given: &Given<'_>,
    tokens: usize,
    history: usize,
    patch: usize,
    place: &str,
) -> Result<usize, TaskError> {
    if let Some(image) = given.image {
        return Ok(image);
    }
    let side = tokens.is_multiple_of(history).then(|| root(tokens / history)).flatten();
    let side = side.ok_or_else(|| {
        Message::new(format!("its {tokens} positions are not those of {history} square images of patches"))
            .fix(Fix::Any(vec![Fix::set("set", format!("{place}=N")), Fix::give("image")]))
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
