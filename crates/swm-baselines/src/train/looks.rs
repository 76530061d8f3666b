//! Looks of the images of a training: what is rendered otherwise than it was recorded.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::{ImageSize, Value};
use swm_data::{Looks, RenderOptions};

use crate::error::BaselineError;

/// How the images of a recording are rendered where it was recorded by this program: part of the run's `config.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct ImageLooks {
    /// Factors to set in all images.
    #[serde(skip_serializing_if = "Map::is_empty")]
    pub set: Map<String, Json>,
    /// Factors that are sampled for every clip, in every epoch anew.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vary: Option<Looks>,
    /// Factors of the canonical look, for models that learn to draw it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub canonical: Option<Map<String, Json>>,
}

impl ImageLooks {
    /// Images as they were recorded.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// With these factors in all images.
    #[must_use]
    pub fn set(mut self, set: &BTreeMap<String, Value>) -> Self {
        self.set = json(set);
        self
    }

    /// With looks that are sampled.
    #[must_use]
    pub fn vary(mut self, looks: Option<Looks>) -> Self {
        self.vary = looks;
        self
    }

    /// With pairs in the canonical look that has these factors.
    #[must_use]
    pub fn canonical(mut self, canonical: Option<&BTreeMap<String, Value>>) -> Self {
        self.canonical = canonical.map(json);
        self
    }

    /// Whether images are as they were recorded, and alone.
    #[must_use]
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// How images of this side are rendered.
    pub(super) fn options(&self, image: usize) -> Result<RenderOptions, BaselineError> {
        let size = ImageSize { height: image, width: image };
        let canonical = self.canonical.as_ref().map(|look| values("canonical", look)).transpose()?;
        let options = RenderOptions::default().image(size).factors(values("look", &self.set)?);
        Ok(options.looks(self.vary.clone()).canonical(canonical))
    }
}

fn json(values: &BTreeMap<String, Value>) -> Map<String, Json> {
    values.iter().map(|(name, value)| (name.clone(), value.to_json())).collect()
}

fn values(setting: &str, look: &Map<String, Json>) -> Result<BTreeMap<String, Value>, BaselineError> {
    let value = |(name, json): (&String, &Json)| match Value::from_json(name, json) {
        Ok(value) => Ok((name.clone(), value)),
        Err(error) => Err(BaselineError::Training { setting: setting.to_owned(), reason: error.to_string() }),
    };
    look.iter().map(value).collect()
}
