//! The images that a request asks for: of a size, or none.

use serde::{Deserialize, Serialize};
use swm_core::ImageSize;

/// Images of a size, or none; JSON is `{"height": 64, "width": 64}` or `"none"`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Written", into = "Written")]
pub struct ImageChoice(pub Option<ImageSize>);

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Written {
    Size(ImageSize),
    No(No),
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum No {
    None,
}

impl From<Written> for ImageChoice {
    fn from(written: Written) -> Self {
        match written {
            Written::Size(size) => Self(Some(size)),
            Written::No(No::None) => Self(None),
        }
    }
}

impl From<ImageChoice> for Written {
    fn from(ImageChoice(size): ImageChoice) -> Self {
        size.map_or(Self::No(No::None), Self::Size)
    }
}
