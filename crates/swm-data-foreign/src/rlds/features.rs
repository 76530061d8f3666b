//! What `features.json` says of the values of an episode: their types and shapes, which records do not hold.

use serde_json::Value as Json;
use swm_core::Dtype;

/// Features in features are never deeper.
const MAX_DEPTH: usize = 16;
/// The most values of a row.
const MAX_DIM: usize = 1 << 28;

/// A leaf: what the values of one key of the records are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Feature {
    /// Its key in the records, as `steps/observation/image`.
    pub(super) key: String,
    pub(super) kind: Kind,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Numbers {
        dtype: Dtype,
        shape: Vec<usize>,
    },
    Text,
    /// Encoded images; where the shape is not given, the first image has it.
    Image {
        shape: Option<[usize; 3]>,
    },
    /// What becomes no column, with the reason.
    Skipped(String),
}

/// All leaves, in the order of the file.
pub(super) fn leaves(features: &Json) -> Vec<Feature> {
    let mut found = Vec::new();
    below(features, String::new(), 0, &mut found);
    found
}

fn below(node: &Json, key: String, depth: usize, found: &mut Vec<Feature>) {
    let named = |name: &str| if key.is_empty() { name.to_owned() } else { format!("{key}/{name}") };
    if depth < MAX_DEPTH
        && let Some(features) = node["featuresDict"]["features"].as_object()
    {
        for (name, feature) in features {
            below(feature, named(name), depth + 1, found);
        }
        return;
    }
    // The steps of an episode are one sequence; sequences in it have as many values as they like.
    let inner = &node["sequence"]["feature"];
    if key == "steps" && inner.is_object() {
        return below(inner, key, depth + 1, found);
    }
    found.push(Feature { kind: kind(node), key });
}

fn kind(node: &Json) -> Kind {
    let skipped = |reason: String| Kind::Skipped(reason);
    if let Some(image) = node.get("image") {
        return match (image["dtype"].as_str().unwrap_or("uint8"), sizes(&image["shape"])) {
            ("uint8", Some(shape)) => match shape[..] {
                [height, width, colors @ (1 | 3)] => Kind::Image { shape: Some([height, width, colors]) },
                _ => skipped(format!("its images have the shape {shape:?}, and are read with 1 or 3 colors")),
            },
            ("uint8", None) => Kind::Image { shape: None },
            (dtype, _) => skipped(format!("its images hold {dtype}, and are read with uint8")),
        };
    }
    if node.get("text").is_some() {
        return Kind::Text;
    }
    if node.get("classLabel").is_some() {
        return Kind::Numbers { dtype: Dtype::I64, shape: Vec::new() };
    }
    let Some(tensor) = node.get("tensor") else {
        let class = node["pythonClassName"].as_str().unwrap_or("unknown");
        return skipped(format!("it is a {}, which is not read", class.rsplit('.').next().unwrap_or(class)));
    };
    let (name, encoding) =
        (tensor["dtype"].as_str().unwrap_or("?"), tensor["encoding"].as_str().unwrap_or("none"));
    if !encoding.eq_ignore_ascii_case("none") {
        return skipped(format!("its values are encoded as {encoding}, which is not read"));
    }
    let Some(shape) = sizes(&tensor["shape"]) else {
        return skipped("its shape is not the same in all rows".to_owned());
    };
    let dtype = match name {
        "bool" => Dtype::Bool,
        "uint8" => Dtype::U8,
        "int8" | "int16" | "uint16" | "int32" => Dtype::I32,
        "uint32" | "int64" | "uint64" => Dtype::I64,
        "float16" | "bfloat16" | "float32" => Dtype::F32,
        "float64" => Dtype::F64,
        "string" | "object" if shape.is_empty() => return Kind::Text,
        name => return skipped(format!("its values are of the type {name}, which is not read")),
    };
    Kind::Numbers { dtype, shape }
}

/// The sizes of a shape; `None`: one of them is not given, or impossible.
fn sizes(shape: &Json) -> Option<Vec<usize>> {
    let none = Vec::new();
    let sizes = shape["dimensions"].as_array().unwrap_or(&none);
    // Protobuf's JSON has numbers of 64 bits as texts.
    let size = |size: &Json| {
        size.as_u64().or_else(|| size.as_str()?.parse().ok()).and_then(|size| usize::try_from(size).ok())
    };
    let sizes: Vec<usize> = sizes.iter().map(size).collect::<Option<_>>()?;
    let dim = sizes.iter().try_fold(1usize, |dim, &size| dim.checked_mul(size));
    (sizes.iter().all(|&size| size > 0) && dim? <= MAX_DIM).then_some(sizes)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn leaves_have_their_paths() {
        let tensor = |dtype: &str, sizes: &[&str]| json!({"tensor": {"dtype": dtype, "encoding": "none", "shape": {"dimensions": sizes}}});
        let dict = |features: Json| json!({"featuresDict": {"features": features}});
        let step = dict(json!({
            "observation": dict(json!({
                "image": {"image": {"dtype": "uint8", "shape": {"dimensions": ["32", "48", "3"]}}},
                "depth": {"image": {"dtype": "uint16", "shape": {"dimensions": ["32", "48", "1"]}}},
            })),
            "action": tensor("float32", &["7"]),
            "text": {"text": {}},
            "cloud": tensor("float32", &["-1", "3"]),
            "huge": tensor("float32", &["99999999999", "99999999999"]),
            "boxes": {"sequence": {"feature": tensor("float32", &["4"])}, "pythonClassName": "a.b.Sequence"},
        }));
        let all =
            leaves(&dict(json!({"steps": {"sequence": {"feature": step}}, "id": tensor("int64", &[])})));
        let kind = |key: &str| {
            all.iter().find(|feature| feature.key == key).map(|feature| feature.kind.clone()).unwrap()
        };
        assert_eq!(kind("steps/observation/image"), Kind::Image { shape: Some([32, 48, 3]) });
        assert_eq!(kind("steps/action"), Kind::Numbers { dtype: Dtype::F32, shape: vec![7] });
        assert_eq!(kind("steps/text"), Kind::Text);
        assert_eq!(kind("id"), Kind::Numbers { dtype: Dtype::I64, shape: vec![] });
        for (key, reason) in [
            ("steps/observation/depth", "uint16"),
            ("steps/cloud", "not the same in all rows"),
            ("steps/huge", "not the same"),
            ("steps/boxes", "Sequence"),
        ] {
            let Kind::Skipped(found) = kind(key) else { panic!("{key}") };
            assert!(found.contains(reason), "{key}: {found}");
        }
    }
}
