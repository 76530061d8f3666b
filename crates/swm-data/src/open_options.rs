//! Options of opening a dataset of another program: what its files do not hold, or hold in several forms.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::ImageSize;

use crate::adapt::Fit;
use crate::dataset::DatasetInfo;
use crate::error::DataError;

/// How a dataset is opened. Everything has a default, and what a file holds for certain needs no option.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct OpenOptions {
    /// Names of columns: for a new name, the name in the file or the one that the reader gives it.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub map: BTreeMap<String, String>,
    /// The camera whose images become `pixels`, where there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<String>,
    /// How images are turned over. Default: not at all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flip: Option<Flip>,
    /// The order of channels in which a program gave images to OpenCV to encode them, where files do not tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channels: Option<Channels>,
    /// Rows per second. Default: as the file says, if it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fps: Option<f64>,
    /// The id of the environment that the episodes are of. Default: as the file says, if it is one of ours for certain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub env: Option<String>,
    /// Settings of that environment.
    #[serde(skip_serializing_if = "serde_json::Map::is_empty")]
    pub env_options: Map<String, Json>,
    /// A part of the dataset, such as `train` or `val`, where it has such parts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub split: Option<String>,
    /// Rows of an episode that ran into its time limit, where a file of D4RL does not mark these ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_steps: Option<usize>,
    /// Whether observations of a row are those after its action (1) or before it (0), where a file of LIBERO's layout does not show it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shift: Option<u8>,
    /// The size to which images are resized when they are read, by area.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_size: Option<ImageSize>,
    /// How they are resized. Needed where `image_size` has another shape than they have.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit: Option<Fit>,
    /// A folder for decoded values of compressed archives that are too large for memory. They are removed when the dataset is closed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub storage: Option<PathBuf>,
}

setters!(OpenOptions {
    map: BTreeMap<String, String>,
    camera: Option<String>,
    flip: Option<Flip>,
    channels: Option<Channels>,
    fps: Option<f64>,
    env: Option<String>,
    env_options: Map<String, Json>,
    split: Option<String>,
    max_steps: Option<usize>,
    shift: Option<u8>,
    image_size: Option<ImageSize>,
    fit: Option<Fit>,
    storage: Option<PathBuf>,
});

/// How images are turned over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Flip {
    /// Rows of pixels from the bottom up.
    #[serde(rename = "vertical")]
    Vertical,
    /// By half a turn.
    #[serde(rename = "180")]
    HalfTurn,
}

impl Flip {
    /// All of them, by name.
    pub const ALL: [(&'static str, Self); 2] = [("vertical", Self::Vertical), ("180", Self::HalfTurn)];
}

by_name!(Flip, "unknown flip", "vertical or 180");

/// The order of channels of images. OpenCV takes what it encodes for BGR: of images in RGB it exchanges red and blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Channels {
    /// Red, green, blue.
    Rgb,
    /// Blue, green, red.
    Bgr,
}

impl Channels {
    /// All of them, by name.
    pub const ALL: [(&'static str, Self); 2] = [("rgb", Self::Rgb), ("bgr", Self::Bgr)];
}

by_name!(Channels, "unknown channels", "rgb or bgr");

impl OpenOptions {
    /// Those that a dataset was opened with.
    #[must_use]
    pub fn of(info: &DatasetInfo) -> Self {
        serde_json::from_value(Json::Object((*info.opening).clone())).unwrap_or_default()
    }

    /// The options that are given, by name, for whoever opens the same again on this machine.
    #[must_use]
    pub fn record(&self) -> Map<String, Json> {
        let absolute = |path: &PathBuf| std::path::absolute(path).unwrap_or_else(|_| path.clone());
        let storage = self.storage.as_ref().map(absolute);
        match serde_json::to_value(Self { storage, ..self.clone() }) {
            Ok(Json::Object(given)) => given,
            _ => Map::new(),
        }
    }

    /// Whether nothing is asked for.
    #[must_use]
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// The names of the options that are given.
    #[must_use]
    pub fn given(&self) -> Vec<&'static str> {
        self.others(&[])
    }

    /// Refuses values that no dataset can have.
    ///
    /// # Errors
    ///
    /// [`DataError::Option`], with what is allowed.
    pub fn check(&self) -> Result<(), DataError> {
        let refuse = |option, reason: &str| Err(DataError::Option { option, reason: reason.to_owned() });
        if self.fps.is_some_and(|fps| !(fps.is_finite() && fps > 0.0 && fps <= 1e6)) {
            return refuse("fps", "a rate is a number above 0 and at most 1e6, as 10");
        }
        if self.env.is_none() && !self.env_options.is_empty() {
            return refuse("env_options", "these are settings of an environment; give `env`, its id, too");
        }
        if self.max_steps == Some(0) {
            return refuse("max_steps", "an episode has at least one step");
        }
        if let Some(ImageSize { height, width }) = self.image_size
            && let Err(reason) = ImageSize::new(height, width)
        {
            return refuse("image_size", &reason);
        }
        if self.fit.is_some() && self.image_size.is_none() {
            return refuse("fit", "no image is resized; give `image_size`, too, or leave it out");
        }
        match self.shift {
            Some(2..) => refuse("shift", "it is 0 or 1"),
            _ => Ok(()),
        }
    }

    /// The names of the options that are given, but for those in `known`.
    #[must_use]
    pub fn others(&self, known: &[&str]) -> Vec<&'static str> {
        let given = [
            ("map", !self.map.is_empty()),
            ("camera", self.camera.is_some()),
            ("flip", self.flip.is_some()),
            ("channels", self.channels.is_some()),
            ("fps", self.fps.is_some()),
            ("env", self.env.is_some()),
            ("split", self.split.is_some()),
            ("max_steps", self.max_steps.is_some()),
            ("shift", self.shift.is_some()),
            ("image_size", self.image_size.is_some()),
            ("fit", self.fit.is_some()),
            ("storage", self.storage.is_some()),
        ];
        given
            .into_iter()
            .filter(|(name, is_given)| *is_given && !known.contains(name))
            .map(|(name, _)| name)
            .collect()
    }

    /// Those of a dataset whose images stay as they are.
    pub(crate) fn of_stored(&self) -> Self {
        Self { image_size: None, fit: None, ..self.clone() }
    }

    /// Refuses options that would not act: all but those in `known`. `what` is what has no use for them.
    ///
    /// # Errors
    ///
    /// [`DataError::Option`], with the first of them.
    pub fn only(&self, what: &str, known: &[&str]) -> Result<(), DataError> {
        match self.others(known).first() {
            Some(&option) => {
                Err(DataError::Option { option, reason: format!("{what} has no use for it; leave it out") })
            }
            None => Ok(()),
        }
    }
}
