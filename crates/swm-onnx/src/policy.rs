//! Exported models by name: `onnx:DIR,solver=icem`.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json};
use swm_core::{ImageSize, PolicyArgs, PolicyEntry, PolicyError, Setting};
use swm_solvers::{LearnedCost, SOLVER_SETTING, on_true_dynamics, plan_on};

use crate::cost::{ModelSettings, OnnxCost};

/// The policy that plans on an exported model.
pub const POLICIES: &[PolicyEntry] = &[PolicyEntry::new(
    "onnx",
    "plans on a world model exported to ONNX (`onnx:DIR,solver=cem`), with the settings of the solver and of the plan",
    |context, args| {
        let (folder, mut given) = split(args)?;
        let cost = OnnxCost::load(&folder).map_err(|error| args.wrong(error.to_string()))?;
        let ModelSettings { action_block, action_scale, history, .. } = cost.settings().clone();
        let frames = history.max(1);
        if *given.entry("history_len").or_insert_with(|| frames.into()) != frames {
            return Err(args.wrong(format!("the model sees {frames} frame(s); set history_len={frames}, or leave it out")));
        }
        let learned = LearnedCost::new(Box::new(cost), action_block).scaled(action_scale);
        Ok(Box::new(plan_on(context, learned, given).map_err(|error| args.wrong(error.to_string()))?))
    },
)
.settings(&[Setting::new("DIR", "Folder of the model", "required"), SOLVER_SETTING])
.image(|args| {
    let side = settings(args)?.image?;
    ImageSize::new(side, side).ok()
})
.oracle(|context, args| {
    let mut given = args.named.clone();
    given.insert("action_block".to_owned(), settings(args)?.action_block.into());
    on_true_dynamics(context, given)
})];

/// The description of the model that these arguments name, if it is there.
fn settings(args: &PolicyArgs) -> Option<ModelSettings> {
    ModelSettings::read(&split(args).ok()?.0).ok()
}

fn split(args: &PolicyArgs) -> Result<(PathBuf, Map<String, Json>), PolicyError> {
    let [folder] = &args.positional[..] else {
        return Err(args.wrong("name the folder of one model, as in `onnx:DIR`"));
    };
    let folder = folder.as_str().map_or_else(|| folder.to_string(), str::to_owned);
    Ok((Path::new(&folder).to_owned(), args.named.clone()))
}
