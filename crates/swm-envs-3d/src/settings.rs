//! What the settings of the environments of this crate have in common. Each has its own struct for them.

use std::collections::BTreeMap;

use serde_json::{Map, Value as Json};
use swm_core::error::BatchError;
use swm_core::{EnvError, Value};
use swm_fov::FovSpace;

/// The factor table of the environment `env` with other defaults, by name.
pub(crate) fn with_defaults(
    factors: FovSpace,
    env: &str,
    defaults: &Map<String, Json>,
) -> Result<FovSpace, EnvError> {
    let wrong = |reason: String| EnvError::Setting { env: env.to_owned(), reason };
    let read = |(name, json): (&String, &Json)| Ok((name.clone(), Value::from_json(name, json)?));
    let values = defaults.iter().map(read).collect::<Result<BTreeMap<_, _>, BatchError>>();
    let values = values.map_err(|error| wrong(error.to_string()))?;
    factors.with_defaults(&values).map_err(|error| wrong(format!("init_value: {error}")))
}
