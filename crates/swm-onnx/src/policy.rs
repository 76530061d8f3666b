//! Exported models by name: `onnx:DIR,solver=icem`.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json};
use swm_core::registry::Setting;
use swm_core::{PolicyArgs, PolicyEntry, PolicyError};
use swm_solvers::{LearnedCost, MpcPolicy, SOLVER_SETTING, plan_on};

use crate::cost::{ModelSettings, OnnxCost};

/// The policy that plans on an exported model.
pub const POLICIES: &[PolicyEntry] = &[PolicyEntry {
    name: "onnx",
    summary: "plans on a world model exported to ONNX (`onnx:DIR,solver=cem`), with the settings of the solver and of the plan",
    settings: &[Setting { name: "DIR", doc: "folder of the model", default: "required" }, SOLVER_SETTING],
    make: |_, args| Ok(Box::new(onnx_policy(args)?)),
}];

/// The same policy as what it is, so that a trace can be given to it.
///
/// # Errors
///
/// [`PolicyError::Argument`]: no folder, a model that cannot be loaded, or an unknown or misfit setting.
pub fn onnx_policy(args: &PolicyArgs) -> Result<MpcPolicy, PolicyError> {
    let (folder, given) = split(args)?;
    let cost = OnnxCost::load(&folder).map_err(|error| args.wrong(error.to_string()))?;
    let ModelSettings { action_block, action_scale, .. } = cost.settings().clone();
    let learned = LearnedCost { cost: Box::new(cost), action_block, scale: action_scale, settings: &[] };
    plan_on(learned, given).map_err(|error| args.wrong(error.to_string()))
}

/// The side of the images that the model of these arguments wants; `None` for other policies.
pub fn image_side(args: &PolicyArgs) -> Option<usize> {
    let (folder, _) = split(args).ok().filter(|_| args.name == POLICIES[0].name)?;
    ModelSettings::read(&folder).ok()?.image
}

fn split(args: &PolicyArgs) -> Result<(PathBuf, Map<String, Json>), PolicyError> {
    let [folder] = &args.positional[..] else {
        return Err(args.wrong("name the folder of one model, as in `onnx:DIR`"));
    };
    let folder = folder.as_str().map_or_else(|| folder.to_string(), str::to_owned);
    Ok((Path::new(&folder).to_owned(), args.named.clone()))
}
