//! Names of tensors in the files of others, and the names that they have here.
//!
//! Here they are those of transformers 5. Older files of ViT and DINOv2 have other ones, training frameworks put
//! `model.` before all, and some tensors take no part in what a network computes.

use std::collections::{BTreeMap, BTreeSet};

use swm_weights::Stored;

use super::facebook;

/// What is put before all names by Lightning and by compiled or distributed modules.
const PREFIXES: [&str; 4] = ["model.", "_orig_mod.", "module.", "state_dict."];

/// What is put between the names of modules: by compiled ones, and by distributed ones.
const INNER: [&str; 2] = ["_orig_mod", "module"];

/// What the names of a trainer's own tensors begin with, beside those of the model below one of these: losses, metrics and probes, and
/// how many weights were averaged.
const BESIDE: [&str; 7] = ["sigreg.", "criterion", "val_", "train_", "_metrics", "callbacks_", "n_averaged"];
/// Beside those, copies of the model with averaged weights.
const AVERAGED: [&str; 3] = ["ema.", "ema_model.", "model_ema."];
/// Beside those, a part of the model (PLDM's).
const INVERSE: &str = "idm.";

/// What the names of tensors begin with that no model has here: the state of optimizers, and decoders for people to look at.
const DROPPED: [&str; 6] =
    ["predictor_optimizer.", "decoder.", "decoder_optimizer.", "opt.", "optimizer.", "scaler."];

/// Modules of others' archives, and where the model has them.
const MODULES: &[(&str, &str)] = &[
    ("action_encoder.patch_embed.", "extra_encoders.action.patch_embed."),
    ("proprio_encoder.patch_embed.", "extra_encoders.proprio.patch_embed."),
];

/// Parts of names in files, and what they are here. Tried in this order, each once.
const PARTS: &[(&str, &str)] = &[
    // transformers 4, ViT and DINOv2.
    ("encoder.layer.", "layers."),
    (".attention.attention.query.", ".attention.q_proj."),
    (".attention.attention.key.", ".attention.k_proj."),
    (".attention.attention.value.", ".attention.v_proj."),
    (".attention.output.dense.", ".attention.o_proj."),
    (".intermediate.dense.", ".mlp.fc1."),
    (".output.dense.", ".mlp.fc2."),
    // ViT's names of what DINOv2 calls norm1 and norm2.
    (".layernorm_before.", ".norm1."),
    (".layernorm_after.", ".norm2."),
];

/// Ends of names that no forward pass reads: counters, masks that are computed here, the token of masked images, poolers of
/// frozen encoders, rates of averages.
const IDLE: [&str; 6] = [
    "num_batches_tracked",
    "mask_token",
    "causal_mask",
    "ema_coefficient",
    "pooler.dense.weight",
    "pooler.dense.bias",
];

/// All tensors under the names that they have here, without the idle ones.
pub fn to_ours(stored: BTreeMap<String, Stored>) -> BTreeMap<String, Stored> {
    let stored = without_prefixes(without_inner(stored));
    let stored = if is_archive(stored.keys()) {
        stored
            .into_iter()
            .filter(|(name, _)| !DROPPED.iter().any(|dropped| name.starts_with(dropped)))
            .map(|(name, tensor)| (of_archive(name), tensor))
            .collect()
    } else {
        stored
    };
    let stored = facebook::renamed(of_one_key(stored));
    let renamed = stored.into_iter().filter_map(|(name, tensor)| {
        let is_idle = IDLE.iter().any(|end| name.ends_with(end)) || is_mask(&name, &tensor);
        (!is_idle).then(|| (ours(&name), tensor))
    });
    without_wrappers(renamed.collect())
}

/// Names without what frameworks put within them: parts of a model may have been compiled or distributed by themselves. Where two tensors
/// would have one name then, all keep theirs.
fn without_inner(stored: BTreeMap<String, Stored>) -> BTreeMap<String, Stored> {
    let names: BTreeSet<String> = stored.keys().map(|name| outer(name)).collect();
    if names.len() < stored.len() {
        return stored;
    }
    stored.into_iter().map(|(name, tensor)| (outer(&name), tensor)).collect()
}

/// A name without what frameworks put within it.
fn outer(name: &str) -> String {
    let Some((first, rest)) = name.split_once('.') else { return name.to_owned() };
    let (inner, last) = rest.rsplit_once('.').map_or((None, rest), |(inner, last)| (Some(inner), last));
    let kept = inner.into_iter().flat_map(|inner| inner.split('.')).filter(|part| !INNER.contains(part));
    [first].into_iter().chain(kept).chain([last]).collect::<Vec<_>>().join(".")
}

/// Whether names are those of a DINO-WM in the parts that its authors store, and facebookresearch/jepa-wms: encoders of vectors beside the
/// predictor. LeWM has an encoder of actions, too, with more layers.
pub fn is_archive<'a>(names: impl Iterator<Item = &'a String>) -> bool {
    let names: Vec<String> = names.map(|name| outer(name)).collect();
    let has = |prefix: &str| names.iter().any(|name| name.starts_with(prefix));
    has("predictor.") && has("action_encoder.patch_embed.") && !has("action_encoder.embed.")
}

/// Names without what frameworks put before them, once or several times; and without what stands beside the model.
fn without_prefixes(mut stored: BTreeMap<String, Stored>) -> BTreeMap<String, Stored> {
    loop {
        let common = |prefix: &&&str| stored.keys().all(|name| name.starts_with(**prefix));
        let among_others = || PREFIXES.iter().find(|prefix| is_beside_a_model(&stored, prefix));
        let prefix = match PREFIXES.iter().find(common).or_else(among_others) {
            _ if stored.is_empty() => return stored,
            Some(prefix) => *prefix,
            None => return stored,
        };
        stored = stored
            .into_iter()
            .filter_map(|(name, tensor)| match name.strip_prefix(prefix) {
                Some(name) => Some((name.to_owned(), tensor)),
                None => name.starts_with(INVERSE).then_some((name, tensor)),
            })
            .collect();
    }
}

/// Whether the model is below `prefix`, and all else is a trainer's.
fn is_beside_a_model(stored: &BTreeMap<String, Stored>, prefix: &str) -> bool {
    let is_known = |name: &String| {
        name.starts_with(prefix)
            || name.starts_with(INVERSE)
            || BESIDE.iter().chain(&AVERAGED).any(|beside| name.starts_with(beside))
    };
    stored.keys().any(|name| name.starts_with(prefix)) && stored.keys().all(is_known)
}

/// The name of a tensor in a copy of the model with averaged weights, if there is one.
pub fn averaged<'a>(mut names: impl Iterator<Item = &'a String>) -> Option<&'a String> {
    names.find(|name| AVERAGED.iter().any(|averaged| name.starts_with(averaged)))
}

/// The name of a tensor of an archive of modules: encoders of actions and of proprioception have names of their own there.
fn of_archive(name: String) -> String {
    match MODULES.iter().find_map(|(theirs, ours)| Some((ours, name.strip_prefix(theirs)?))) {
        Some((ours, rest)) => format!("{ours}{rest}"),
        None => name,
    }
}

/// TD-MPC2's encoder of vectors, of which there is one here, whatever the column is called.
fn of_one_key(stored: BTreeMap<String, Stored>) -> BTreeMap<String, Stored> {
    let keys: Vec<String> = vector_keys(stored.keys());
    let [key] = &keys[..] else { return stored };
    let prefix = format!("extra_encoders.{key}.");
    let rename = |(name, tensor): (String, Stored)| match name.strip_prefix(&prefix) {
        Some(rest) => (format!("extra_encoders.observation.{rest}"), tensor),
        None => (name, tensor),
    };
    stored.into_iter().map(rename).collect()
}

/// The columns of which TD-MPC2 has an encoder, by names of its tensors with or without what frameworks put before them.
pub fn vector_keys<'a>(names: impl Iterator<Item = &'a String>) -> Vec<String> {
    let key = |name: &'a String| {
        Some(name.split_once("extra_encoders.")?.1.strip_suffix(".0.ln.weight")?.to_owned())
    };
    names.filter_map(key).collect::<BTreeSet<String>>().into_iter().collect()
}

/// Names without the wrapper of modules that are not trained any more. A value in it has no target network: it is its own.
fn without_wrappers(stored: BTreeMap<String, Stored>) -> BTreeMap<String, Stored> {
    let mut found = BTreeMap::new();
    for (name, tensor) in stored {
        if let Some(rest) = name.strip_prefix("value_predictor.backbone.") {
            found.insert(format!("value_predictor.teacher.{rest}"), tensor.clone());
            found.insert(format!("value_predictor.student.{rest}"), tensor);
        } else if let Some(rest) = name.strip_prefix("encoder.backbone.") {
            found.insert(format!("encoder.{rest}"), tensor);
        } else if let Some(rest) = name.strip_prefix("backbone.backbone.") {
            found.insert(format!("backbone.{rest}"), tensor);
        } else {
            found.insert(name, tensor);
        }
    }
    found
}

/// The buffer of a block-causal mask: `[1, 1, N, N]` and called `bias`.
fn is_mask(name: &str, tensor: &Stored) -> bool {
    name.ends_with(".bias") && matches!(tensor.shape[..], [1, 1, rows, columns] if rows == columns)
}

/// The name here of a tensor of a file.
pub fn ours(name: &str) -> String {
    PARTS.iter().fold(name.to_owned(), |name, (theirs, ours)| name.replacen(theirs, ours, 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_generations_of_vision_transformers_get_one_name() {
        let pairs = [
            (
                "encoder.encoder.layer.3.attention.attention.query.weight",
                "encoder.layers.3.attention.q_proj.weight",
            ),
            ("encoder.layers.3.attention.q_proj.weight", "encoder.layers.3.attention.q_proj.weight"),
            ("encoder.layer.0.attention.output.dense.bias", "layers.0.attention.o_proj.bias"),
            ("encoder.layer.0.output.dense.bias", "layers.0.mlp.fc2.bias"),
            ("encoder.layer.0.intermediate.dense.bias", "layers.0.mlp.fc1.bias"),
            ("layers.0.layernorm_before.weight", "layers.0.norm1.weight"),
            ("encoder.layer.0.norm1.weight", "layers.0.norm1.weight"),
            (
                "predictor.transformer.layers.0.attn.to_qkv.weight",
                "predictor.transformer.layers.0.attn.to_qkv.weight",
            ),
        ];
        for (theirs, expected) in pairs {
            assert_eq!(ours(theirs), expected);
        }
    }

    #[test]
    fn prefixes_of_frameworks_go_and_idle_tensors_too() {
        let tensor = || Stored { shape: vec![1], values: vec![0.0], is_whole: false };
        let idle =
            ["norm.num_batches_tracked", "embeddings.mask_token", "pooler.dense.weight", "pooler.dense.bias"];
        let names = ["a.weight"].into_iter().chain(idle).map(|name| format!("model.{name}"));
        let stored = names.map(|name| (name, tensor())).collect();
        assert_eq!(to_ours(stored).into_keys().collect::<Vec<_>>(), ["a.weight"]);
    }

    fn renamed(names: &[&str]) -> Vec<String> {
        to_ours(names.iter().map(|name| ((*name).to_owned(), Stored::default())).collect())
            .into_keys()
            .collect()
    }

    #[test]
    fn what_a_trainer_keeps_beside_a_model_goes() {
        assert_eq!(
            renamed(&["model.a.weight", "sigreg.phi", "idm.net.0.weight"]),
            ["a.weight", "idm.net.0.weight"]
        );
        assert_eq!(renamed(&["model._orig_mod.a.weight", "model._orig_mod.b.bias"]), ["a.weight", "b.bias"]);
        assert_eq!(renamed(&["model.a.weight", "ema_model.a.weight", "n_averaged"]), ["a.weight"]);
        assert_eq!(renamed(&["module.a.weight", "module.b.bias", "n_averaged"]), ["a.weight", "b.bias"]);
        assert_eq!(renamed(&["ema.a.weight", "n_averaged"]), ["ema.a.weight", "n_averaged"]);
        // Something else beside it may be another model.
        assert_eq!(renamed(&["model.a", "head.b"]), ["head.b", "model.a"]);
    }

    #[test]
    fn parts_that_were_compiled_have_the_names_of_others() {
        assert_eq!(
            renamed(&["model.a._orig_mod.b.weight", "model.a.c._orig_mod.weight"]),
            ["a.b.weight", "a.c.weight"]
        );
    }

    #[test]
    fn parts_that_were_distributed_have_the_names_of_others() {
        let archive = [
            "predictor.module.transformer.layers.0.0.norm.weight",
            "action_encoder.module.patch_embed.weight",
            "proprio_encoder.module._orig_mod.patch_embed.weight",
            "opt.state.0.exp_avg",
        ];
        let ours = [
            "extra_encoders.action.patch_embed.weight",
            "extra_encoders.proprio.patch_embed.weight",
            "predictor.transformer.layers.0.0.norm.weight",
        ];
        assert_eq!(renamed(&archive), ours);
        // No tensor takes the place of another, and a tensor may be called so itself.
        assert_eq!(renamed(&["a.module.b", "a.b"]), ["a.b", "a.module.b"]);
        assert_eq!(renamed(&["a.module", "b.c"]), ["a.module", "b.c"]);
    }

    #[test]
    fn wrapped_values_are_student_and_teacher() {
        let names = ["encoder.backbone.layernorm.weight", "value_predictor.backbone.out_proj.bias"];
        let ours = [
            "encoder.layernorm.weight",
            "value_predictor.student.out_proj.bias",
            "value_predictor.teacher.out_proj.bias",
        ];
        assert_eq!(renamed(&names), ours);
        assert_eq!(renamed(&["backbone.backbone.layernorm.bias"]), ["backbone.layernorm.bias"]);
    }

    #[test]
    fn an_archive_of_modules_loses_optimizers_and_decoders() {
        let names = ["predictor.norm.weight", "action_encoder.patch_embed.bias", "decoder.a", "opt.state.0"];
        assert_eq!(renamed(&names), ["extra_encoders.action.patch_embed.bias", "predictor.norm.weight"]);
    }

    #[test]
    fn the_one_encoder_of_vectors_is_that_of_observations() {
        let of = |key: &str| format!("extra_encoders.{key}.0.ln.weight");
        assert_eq!(renamed(&[&of("state")]), [of("observation")]);
        assert_eq!(renamed(&[&of("state"), &of("goal")]), [of("goal"), of("state")]);
        let prefixed = [format!("model.{}", of("state")), format!("ema.{}", of("state"))];
        assert_eq!(vector_keys(prefixed.iter()), ["state"]);
    }
}
