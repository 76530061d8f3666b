//! Sizes of networks, from the shapes of their tensors.

use std::collections::BTreeMap;

use serde_json::{Value as Json, json};
use swm_tasks::request::{Fix, Message, TaskError};

use swm_weights::Stored;

use super::config::Node;
use super::recipe::{Given, of};

/// Shapes of the tensors of a file, by our names; empty where there is no file.
#[derive(Clone, Debug, Default)]
pub(super) struct Shapes(BTreeMap<String, Vec<usize>>);

/// A vision transformer, as far as tensors tell.
#[derive(Clone, Copy, Debug)]
pub(super) struct VitShape {
    pub(super) dim: usize,
    pub(super) depth: usize,
    pub(super) hidden: usize,
    pub(super) patch: usize,
    pub(super) positions_for: usize,
    pub(super) dinov2: bool,
}

/// A transformer of the reference's, as far as tensors tell.
#[derive(Clone, Copy, Debug)]
pub(super) struct PredictorShape {
    pub(super) depth: usize,
    /// Heads times the dim of each.
    pub(super) inner: usize,
    pub(super) hidden: usize,
}

impl Shapes {
    pub(super) fn of(tensors: BTreeMap<String, Stored>) -> Self {
        Self(tensors.into_iter().map(|(name, tensor)| (name, tensor.shape)).collect())
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn has_below(&self, prefix: &str) -> bool {
        self.0.keys().any(|name| name.starts_with(prefix))
    }

    /// The size of a tensor along an axis.
    pub(super) fn dim(&self, name: &str, axis: usize) -> Option<usize> {
        self.0.get(name)?.get(axis).copied()
    }

    /// How many parts `prefix.0`, `prefix.1` … there are.
    pub(super) fn count(&self, prefix: &str) -> usize {
        let index =
            |name: &String| -> Option<usize> { name.strip_prefix(prefix)?.split('.').next()?.parse().ok() };
        self.0.keys().filter_map(index).max().map_or(0, |last| last + 1)
    }

    /// The vision transformer below `prefix`, such as `encoder.`.
    pub(super) fn vit(&self, prefix: &str) -> Result<Option<VitShape>, TaskError> {
        let of = |name: &str, axis| self.dim(&format!("{prefix}{name}"), axis);
        let Some(dim) = of("embeddings.cls_token", 2) else { return Ok(None) };
        // Older and newer names end differently.
        for (part, what) in [
            ("register_tokens", "has registers, which this program's DINOv2 does not have"),
            (".weights_in.", "has SwiGLU, as giant DINOv2s; this program has small, base and large ones"),
        ] {
            if self.0.keys().any(|name| name.starts_with(prefix) && name.contains(part)) {
                return Err(Message::new(format!("the encoder {what}")).into());
            }
        }
        let (Some(patch), Some(positions), Some(hidden)) = (
            of("embeddings.patch_embeddings.projection.weight", 2),
            of("embeddings.position_embeddings", 1),
            of("layers.0.mlp.fc1.weight", 0),
        ) else {
            return Ok(None);
        };
        let side = root(positions.saturating_sub(1)).ok_or_else(|| {
            Message::new(format!("the encoder's {positions} positions are not those of a square image"))
        })?;
        Ok(Some(VitShape {
            dim,
            depth: self.count(&format!("{prefix}layers.")),
            hidden,
            patch,
            positions_for: side * patch,
            dinov2: of("layers.0.layer_scale1.lambda1", 0).is_some(),
        }))
    }

    /// The transformer below `prefix`, such as `predictor.transformer.`; `names` are those of its layers' parts: what queries are
    /// made by, how many times as wide as they that is, and the hidden layer.
    pub(super) fn predictor(
        &self,
        prefix: &str,
        [queries, hidden]: [&str; 2],
        times: usize,
    ) -> Option<PredictorShape> {
        let layer = format!("{prefix}layers.0.");
        Some(PredictorShape {
            depth: self.count(&format!("{prefix}layers.")),
            inner: self.dim(&format!("{layer}{queries}"), 0)? / times,
            hidden: self.dim(&format!("{layer}{hidden}"), 0)?,
        })
    }
}

impl VitShape {
    /// Settings of the encoder with so many heads, which `from` names in errors.
    pub(super) fn settings(&self, heads: usize, from: &dyn Fn(&str) -> TaskError) -> Result<Json, TaskError> {
        let &Self { dim, depth, hidden, patch, positions_for, dinov2 } = self;
        if heads == 0 || !dim.is_multiple_of(heads) {
            return Err(from(&format!("is {heads}, which does not divide the encoder's dim of {dim}")));
        }
        Ok(
            json!({ "kind": "vit", "dim": dim, "depth": depth, "heads": heads, "hidden": hidden, "patch": patch,
            "positions_for": positions_for, "dinov2": dinov2 }),
        )
    }

    /// The heads of published transformers of this dim.
    pub(super) fn usual_heads(&self) -> Option<usize> {
        [(192, 3), (384, 6), (768, 12), (1024, 16)]
            .into_iter()
            .find(|(dim, _)| *dim == self.dim)
            .map(|(_, heads)| heads)
    }
}

/// The square root of a square number.
pub(super) fn root(number: usize) -> Option<usize> {
    let root = number.isqrt();
    (root > 0 && root * root == number).then_some(root)
}

/// Heads, and the dim of each, where a file says their product alone: what was set, what the part `node` of a config says, or the published
/// ones where they fit.
pub(super) fn heads(
    given: &Given<'_>,
    node: Option<&Node<'_>>,
    usual_dim: Option<usize>,
    inner: Option<usize>,
    place: &str,
) -> Result<[usize; 2], TaskError> {
    let set = |name: &str| given.set_number(&format!("{place}.{name}"));
    let (heads, head_dim) = (of(node, "heads")?, of(node, "dim_head")?.or(usual_dim));
    let (heads, head_dim) = (set("heads").or(heads), set("head_dim").or(head_dim));
    let wrong = |text: String| match node {
        Some(node) => node.wrong(&text),
        None => Message::new(format!("{place} {text}")).fix(Fix::Change("set")).into(),
    };
    match (heads, head_dim, inner) {
        (Some(heads), Some(dim), Some(inner)) if heads.checked_mul(dim) != Some(inner) => Err(wrong(
            format!("has {heads} heads of {dim} values, and the weights have {inner} values in all"),
        )),
        (Some(heads), Some(dim), _) => Ok([heads, dim]),
        (Some(heads), None, Some(inner)) if heads > 0 && inner.is_multiple_of(heads) => {
            Ok([heads, inner / heads])
        }
        (Some(heads), None, Some(inner)) => {
            Err(wrong(format!("has {heads} heads, which do not divide the {inner} values of the weights")))
        }
        (None, Some(dim), Some(inner)) if dim > 0 && inner.is_multiple_of(dim) => Ok([inner / dim, dim]),
        (None, None, None | Some(1024)) => Ok([16, 64]),
        (Some(_), None, None) => {
            let text = format!("no file says how many values each head of attention of `{place}` has");
            Err(Message::new(text).fix(Fix::set("set", format!("{place}.head_dim=N"))).into())
        }
        _ => Err(unsaid_heads(place, "the predictor")),
    }
}

/// No file says into how many heads a network is cut.
pub(super) fn unsaid_heads(place: &str, what: &str) -> TaskError {
    let message = Message::new(format!("no file says how many heads of attention {what} has"));
    message.fix(Fix::set("set", format!("{place}.heads=N"))).into()
}
