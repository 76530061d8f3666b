//! DINOv2 in the names of its authors (facebookresearch/dinov2): queries, keys and values are one matrix there.

use std::collections::BTreeMap;

use swm_weights::Stored;

/// What marks such names: behind it comes nothing else.
const MARK: &str = "patch_embed.proj.weight";

/// Names of theirs, and ours.
const NAMES: &[(&str, &str)] = &[
    ("cls_token", "embeddings.cls_token"),
    ("pos_embed", "embeddings.position_embeddings"),
    ("patch_embed.proj.weight", "embeddings.patch_embeddings.projection.weight"),
    ("patch_embed.proj.bias", "embeddings.patch_embeddings.projection.bias"),
    ("norm.weight", "layernorm.weight"),
    ("norm.bias", "layernorm.bias"),
];

/// Parts of names within a block of theirs, and ours.
const IN_BLOCKS: &[(&str, &str)] = &[
    ("attn.proj.", "attention.o_proj."),
    ("ls1.gamma", "layer_scale1.lambda1"),
    ("ls2.gamma", "layer_scale2.lambda1"),
];

/// The tensors with such names renamed, and the others as they are.
pub(super) fn renamed(stored: BTreeMap<String, Stored>) -> BTreeMap<String, Stored> {
    let Some(prefix) = prefix(&stored) else { return stored };
    let mut found = BTreeMap::new();
    for (name, tensor) in stored {
        let Some(inner) = name.strip_prefix(&prefix) else {
            found.insert(name, tensor);
            continue;
        };
        if let Some((_, ours)) = NAMES.iter().find(|(theirs, _)| *theirs == inner) {
            found.insert(format!("{prefix}{ours}"), tensor);
            continue;
        }
        let Some((block, rest)) = inner.strip_prefix("blocks.").and_then(|rest| rest.split_once('.')) else {
            found.insert(name, tensor);
            continue;
        };
        let of_block = |name: &str| format!("{prefix}layers.{block}.{name}");
        if let Some(kind) = rest.strip_prefix("attn.qkv.") {
            for (part, tensor) in ["q", "k", "v"].into_iter().zip(thirds(tensor)) {
                found.insert(of_block(&format!("attention.{part}_proj.{kind}")), tensor);
            }
            continue;
        }
        let ours =
            IN_BLOCKS.iter().find_map(|(theirs, ours)| Some(format!("{ours}{}", rest.strip_prefix(theirs)?)));
        found.insert(of_block(ours.as_deref().unwrap_or(rest)), tensor);
    }
    found
}

/// What stands before such names; `None` where there are none.
fn prefix(stored: &BTreeMap<String, Stored>) -> Option<String> {
    let prefix = stored.keys().find_map(|name| name.strip_suffix(MARK))?;
    stored.contains_key(&format!("{prefix}blocks.0.attn.qkv.weight")).then(|| prefix.to_owned())
}

/// A tensor in three parts, along its first axis.
fn thirds(tensor: Stored) -> [Stored; 3] {
    let Stored { mut shape, mut values, is_whole } = tensor;
    if let Some(rows) = shape.first_mut() {
        *rows /= 3;
    }
    let size: usize = if values.is_empty() { 0 } else { shape.iter().product() };
    let last = values.split_off((2 * size).min(values.len()));
    let middle = values.split_off(size.min(values.len()));
    [values, middle, last].map(|values| Stored { shape: shape.clone(), values, is_whole })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_matrix_becomes_three() {
        let tensor = |shape: &[usize], values: &[f32]| Stored {
            shape: shape.to_vec(),
            values: values.to_vec(),
            is_whole: false,
        };
        let names = [
            ("patch_embed.proj.weight", tensor(&[1], &[0.0])),
            ("blocks.0.attn.qkv.weight", tensor(&[6, 1], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])),
            ("blocks.0.ls1.gamma", tensor(&[1], &[7.0])),
            ("blocks.0.mlp.fc1.bias", tensor(&[1], &[8.0])),
        ];
        let found = renamed(names.map(|(name, tensor)| (name.to_owned(), tensor)).into());
        assert_eq!(found["layers.0.attention.k_proj.weight"], tensor(&[2, 1], &[3.0, 4.0]));
        assert_eq!(found["layers.0.attention.v_proj.weight"], tensor(&[2, 1], &[5.0, 6.0]));
        assert_eq!(found["layers.0.layer_scale1.lambda1"].values, [7.0]);
        assert_eq!(found["layers.0.mlp.fc1.bias"].values, [8.0]);
        assert!(found.contains_key("embeddings.patch_embeddings.projection.weight") && found.len() == 6);
        // Shapes alone split as well.
        let [first, ..] = thirds(Stored { shape: vec![6, 4], ..Stored::default() });
        assert_eq!((first.shape, first.values.len()), (vec![2, 4], 0));
    }
}
