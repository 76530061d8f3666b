//! `mpc:NAME`: world models of a registry by the policy that plans on trained models.

use std::borrow::Cow;
use std::path::Path;

use serde_json::Map;
use swm_core::{PolicyArgs, PolicyError, Registry};

use crate::world_model::WorldModelEntry;

/// The policy that plans on trained models, `mpc:RUN`. It plans on world models of a registry, too.
const MPC: &str = "mpc";

/// The policy `mpc:NAME` or `mpc:NAME:ARGS`, where the registry has the [world model](WorldModelEntry) NAME, is the policy of that model,
/// `NAME` or `NAME:ARGS`. Settings may follow a comma, as those of `mpc:RUN` do. Any other text is returned as it is.
///
/// # Errors
///
/// [`PolicyError::Argument`]: NAME is also a file or folder here, so that it could be the folder of a training run.
pub fn registered_model<'a>(registry: &Registry, text: &'a str) -> Result<Cow<'a, str>, PolicyError> {
    let of_mpc = text.split_once(':').filter(|(policy, _)| policy.trim() == MPC);
    let Some(rest) = of_mpc.map(|(_, rest)| rest.trim()) else { return Ok(text.into()) };
    let (name, args) = rest.split_once([':', ',']).unwrap_or((rest, ""));
    if registry.find::<WorldModelEntry>(name).is_err() {
        return Ok(text.into());
    }
    if !rest[name.len()..].starts_with(':') && Path::new(name).exists() {
        let reason = format!(
            "`{name}` is a world model of this program, and a file or folder here; write `{name}:…` for the model, `mpc:./{name}` for the \
             training run"
        );
        return Err(PolicyArgs::new(MPC, Map::new()).wrong(reason));
    }
    Ok(format!("{name}:{args}").into())
}
