//! What a checkpoint is, in this program's words: a model, its settings, and what no file of weights says.

use std::path::Path;

use serde_json::{Map, Value as Json, json};
use swm_tasks::request::TaskError;

use super::config::Node;
use super::shapes::Shapes;

/// What is known of a checkpoint before its weights are read.
pub(super) struct Given<'a> {
    /// Its `config.json`, or what stands for it.
    pub(super) config: Option<Node<'a>>,
    /// Shapes of its tensors, by our names.
    pub(super) shapes: Shapes,
    /// Whether its tensors are named as those of an archive of modules.
    pub(super) is_archive: bool,
    /// Shapes of the tensors of an encoder in another file.
    pub(super) encoder: Shapes,
    /// The checkpoint's folder.
    pub(super) folder: Option<&'a Path>,
    /// Settings of the model that were given.
    pub(super) set: &'a Json,
    /// The side of images that was given.
    pub(super) image: Option<usize>,
}

/// A model of ours.
#[derive(Clone, Debug)]
pub(super) struct Recipe {
    /// Its name: a baseline, or an agent.
    pub(super) name: &'static str,
    /// Settings that differ from the paper's.
    pub(super) settings: Json,
    /// Where `frameskip` is among them; `None`: it acts at every step.
    pub(super) frameskip_at: Option<&'static str>,
    /// D: values of a block of actions.
    pub(super) block: usize,
    /// F, where a file says it.
    pub(super) frameskip: Option<usize>,
    /// Values of `proprio`, or of the vector that an agent observes; 0: none.
    pub(super) vector: usize,
    /// The column that it is.
    pub(super) column: String,
    /// The side of images.
    pub(super) image: usize,
    /// How many observations it sees.
    pub(super) history: usize,
    /// Whether the encoder's weights are not in the file.
    pub(super) without_encoder: bool,
    /// Mean and std of actions, and where they are from, where a file says so.
    pub(super) action_scale: Option<(Vec<f64>, Vec<f64>, &'static str)>,
}

/// A size: that of a part of a config that may be missing, as [`Node::size`] has it, or that of the weights; else the paper's.
pub(super) fn size(
    node: Option<&Node<'_>>,
    name: &str,
    weights: Option<usize>,
    paper: usize,
) -> Result<usize, TaskError> {
    Ok(said(node, name, weights)?.unwrap_or(paper))
}

/// The same, where there is no paper's.
pub(super) fn said(
    node: Option<&Node<'_>>,
    name: &str,
    weights: Option<usize>,
) -> Result<Option<usize>, TaskError> {
    node.map_or(Ok(weights), |node| node.size(name, weights))
}

/// The number in a field of a part of a config that may be missing.
pub(super) fn of(node: Option<&Node<'_>>, name: &str) -> Result<Option<usize>, TaskError> {
    node.map_or(Ok(None), |node| node.number(name))
}

impl Given<'_> {
    /// The whole number that a setting of the model was given, by its place.
    pub(super) fn set_number(&self, place: &str) -> Option<usize> {
        self.set.pointer(&format!("/{}", place.replace('.', "/")))?.as_u64().map(|number| number as usize)
    }
}

/// Lays settings over others, object by object.
pub(super) fn lay_over(under: &mut Json, over: &Json) {
    match (under, over) {
        (Json::Object(under), Json::Object(over)) => {
            for (name, value) in over {
                lay_over(under.entry(name.clone()).or_insert(Json::Null), value);
            }
        }
        (_, Json::Null) => {}
        (under, over) => *under = over.clone(),
    }
}

/// `model.frameskip` = 5 as nested objects.
pub(super) fn nested(place: &str, value: Json) -> Json {
    place.rsplit('.').fold(value, |value, name| {
        let mut map = Map::new();
        map.insert(name.to_owned(), value);
        json!(map)
    })
}
