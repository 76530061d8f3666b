//! Settings that the environments of this crate have in common. Each has its own struct for them.

use serde::{Deserialize, Serialize};
use swm_render::Style;

/// [`Style`], as it is written in settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Render {
    #[default]
    Exact,
    Fast,
}

impl From<Render> for Style {
    fn from(render: Render) -> Self {
        match render {
            Render::Exact => Style::Exact,
            Render::Fast => Style::Fast,
        }
    }
}
