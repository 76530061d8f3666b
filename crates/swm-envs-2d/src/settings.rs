//! Settings that the environments of this crate have in common. Each has its own struct for them.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::{EnvError, Value};
use swm_fov::FovSpace;
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

/// The factor table of the environment `env` with other defaults, by name.
pub(crate) fn with_defaults(
    factors: FovSpace,
    env: &str,
    defaults: &Map<String, Json>,
) -> Result<FovSpace, EnvError> {
    let wrong = |reason: String| EnvError::Setting { env: env.to_owned(), reason };
    let mut values = BTreeMap::new();
    for (name, json) in defaults {
        values.insert(name.clone(), Value::from_json(name, json).map_err(|e| wrong(e.to_string()))?);
    }
    factors.with_defaults(&values).map_err(|error| wrong(format!("init_value: {error}")))
}
