//! What the family of a model decides about its form in the reference.

use serde_json::Value as Json;

use super::names::Encoder;
use swm_weights::Saved;

/// A model in the reference's words, as far as its family decides.
#[derive(Default)]
pub(super) struct Layout {
    /// `config.json`.
    pub(super) config: Json,
    /// The vision transformer.
    pub(super) encoder: Option<Encoder>,
    /// The folder of a frozen encoder, of which the tensors are still to be taken.
    pub(super) backbone: Option<Json>,
    /// What the names of tensors begin with that the reference's model does not have.
    pub(super) left_out: &'static [&'static str],
    /// Beginnings of names here, and in the reference.
    pub(super) renamed: Vec<(String, String)>,
    /// Tensors that are computed: masks and counters.
    pub(super) added: Vec<Saved>,
    /// Rows of the card.
    pub(super) facts: Vec<(&'static str, String)>,
    /// What a user has to know.
    pub(super) notes: Vec<String>,
}

/// Why a run has no form in the reference.
pub(super) struct Unfit(pub(super) String);

impl From<String> for Unfit {
    fn from(reason: String) -> Self {
        Self(reason)
    }
}

impl From<&str> for Unfit {
    fn from(reason: &str) -> Self {
        Self(reason.to_owned())
    }
}
