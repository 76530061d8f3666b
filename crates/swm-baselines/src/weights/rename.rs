//! Names of tensors in the files of others, and the names that they have here.
//!
//! Here they are those of transformers 5. Older files of ViT and DINOv2 have other ones, training frameworks put
//! `model.` before all, and some tensors take no part in what a network computes.

use std::collections::BTreeMap;

use super::file::Stored;

/// What is put before all names by Lightning and by compiled or distributed modules.
const PREFIXES: [&str; 4] = ["model.", "_orig_mod.", "module.", "state_dict."];

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

/// Ends of names that no forward pass reads: counters, masks that are computed here, the token of masked images.
const IDLE: [&str; 3] = ["num_batches_tracked", "mask_token", "causal_mask"];

/// All tensors under the names that they have here, without the idle ones.
pub(super) fn to_ours(stored: BTreeMap<String, Stored>) -> BTreeMap<String, Stored> {
    let common = |prefix: &str| stored.keys().all(|name| name.starts_with(prefix));
    let prefix = PREFIXES.iter().find(|prefix| common(prefix)).copied().unwrap_or("");
    let rename = |(name, tensor): (String, Stored)| {
        let name = &name[prefix.len()..];
        let is_idle = IDLE.iter().any(|end| name.ends_with(end)) || is_mask(name, &tensor);
        (!is_idle).then(|| (ours(name), tensor))
    };
    stored.into_iter().filter_map(rename).collect()
}

/// The buffer of a block-causal mask: `[1, 1, N, N]` and called `bias`.
fn is_mask(name: &str, tensor: &Stored) -> bool {
    name.ends_with(".bias") && matches!(tensor.shape[..], [1, 1, rows, columns] if rows == columns)
}

/// The name here of a tensor of a file.
pub(crate) fn ours(name: &str) -> String {
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
        let tensor = || Stored { shape: vec![1], values: vec![0.0] };
        let names = ["model.a.weight", "model.norm.num_batches_tracked", "model.embeddings.mask_token"];
        let stored = names.map(|name| (name.to_owned(), tensor())).into();
        assert_eq!(to_ours(stored).into_keys().collect::<Vec<_>>(), ["a.weight"]);
    }
}
