//! World models for `swm quality`: `lewm:RUN`, or `model:RUN` for any.

use swm_baselines::acting::LatentModel;
use swm_baselines::train::TrainedModel;
use swm_core::evaluate::ModelEntry;
use swm_core::{PolicyArgs, PolicyError, Registry};

use super::arguments::RunArguments;
use super::table::{image_size, trained_in};

/// Trained models whose quality is measured: `lewm:RUN`, or `model:RUN` for any.
pub const MODELS: &[ModelEntry] = &[
    model(ANY, "any trained world model"),
    model("conv-jepa", "a trained Conv-JEPA"),
    model("lewm", "a trained LeWM"),
    model("pldm", "a trained PLDM"),
    model("dino-wm", "a trained DINO-WM"),
    model("keypoint-wm", "a trained Keypoint-WM"),
];

const fn model(name: &'static str, summary: &'static str) -> ModelEntry {
    ModelEntry::new(name, summary, |context, args| {
        Ok(Box::new(latent_model(args, context.env.id, context.registry)?))
    })
    .image(image_size)
    .trained(trained_in)
    .planned_by("mpc:RUN")
}

const ANY: &str = "model";

/// The model that arguments name, such as `lewm:RUN,checkpoint=best`, for the environment `env`; with a registry also a published
/// checkpoint, `lewm:FOLDER`.
///
/// # Errors
///
/// [`PolicyError::Argument`]: no run, one that cannot be read, trained something else or in another environment, a model
/// that predicts nothing, or an unknown setting.
pub fn latent_model(
    args: &PolicyArgs,
    env: &str,
    registry: Option<&Registry>,
) -> Result<LatentModel, PolicyError> {
    let given = RunArguments::of(args)?;
    let TrainedModel { baseline, config, .. } = given.model(args, env, registry)?;
    given.check_all_known(args, &[])?;
    let found = baseline.name();
    let Some(network) = baseline.planner() else {
        let reason = format!("{found} is no world model and predicts nothing; name a run of one");
        return Err(given.wrong(args, reason));
    };
    if args.name != ANY && args.name != found {
        return Err(given.wrong(args, format!("it trained {found}, not {}; use `{found}:RUN`", args.name)));
    }
    LatentModel::with_network(network, baseline.input_spec(), &config.data)
        .ok_or_else(|| args.wrong("the run has no scale of actions".to_owned()))
}
