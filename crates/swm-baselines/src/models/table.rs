//! All baselines. A new one is a folder next to this file and one line here.

use burn::tensor::Device as TensorDevice;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value as Json;
use swm_core::error::nearest;

use super::bounds::check_bounds;
use super::settings::with_changes;
use super::{
    canonical, conv_jepa, dino_wm, gc_idm, gcbc, gciql, gcivl, gcsl, hilp, keypoint_wm, keypoints, lewm, pldm,
};
use crate::baseline::{Baseline, ModelConfig};
use crate::data::DataDims;
use crate::device::Device;
use crate::error::BaselineError;
use crate::learner::Learner;
use crate::network::{Network, Parts};

/// From the name of a preset, and changes to it, to all settings.
type SettingsOf = fn(&str, &Json) -> Result<Json, BaselineError>;
/// From all settings of a model, and changes to them, to all settings.
type ChangedOf = fn(&Json, &Json) -> Result<Json, BaselineError>;
/// From a model config to a model.
type Make = fn(ModelConfig, &TensorDevice) -> Result<Box<dyn Baseline>, BaselineError>;

/// A line of the table.
#[derive(Clone, Copy)]
pub struct BaselineEntry {
    /// Its name.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// Its presets, the default first: the paper's, if there is a paper.
    pub presets: &'static [&'static str],
    /// Settings of a preset.
    settings: SettingsOf,
    /// All settings of a model, changed.
    changed: ChangedOf,
    /// Makes it.
    make: Make,
}

/// A line for the folder `$folder`, whose settings are a `$config` and whose `make` gives network and training. Its presets are
/// functions of `$config`: the paper's, and one for two CPU cores, unless others are named.
macro_rules! entry {
    ($folder:ident, $config:ident, $about:literal) => {
        entry!($folder, $config, $about, paper, small)
    };
    ($folder:ident, $config:ident, $about:literal, $($preset:ident),+) => {
        BaselineEntry {
            name: $folder::NAME,
            about: $about,
            presets: &[$(stringify!($preset)),+],
            settings: |preset, changes| {
                $(if preset == stringify!($preset) {
                    return changed($folder::NAME, &$folder::$config::$preset(), changes);
                })+
                Err(BaselineError::UnknownPreset {
                    baseline: $folder::NAME,
                    preset: preset.to_owned(),
                    known: [$(stringify!($preset)),+].join(", "),
                })
            },
            changed: |settings, changes| {
                let config: $folder::$config = parse($folder::NAME, settings)?;
                changed($folder::NAME, &config, changes)
            },
            make: |model_config, device| {
                let config: $folder::$config = parse($folder::NAME, &model_config.settings)?;
                let parts = $folder::make(&config, &model_config.dims, device)?;
                learner($folder::NAME, model_config, parts, device)
            },
        }
    };
}

/// All baselines.
pub const BASELINES: &[BaselineEntry] = &[
    entry!(
        canonical,
        CanonicalConfig,
        "images of any look, drawn in one canonical look: goes in front of a model",
        small
    ),
    entry!(
        conv_jepa,
        ConvJepaConfig,
        "world model: joint embedding of feature maps, predicted by convolutions",
        small
    ),
    entry!(dino_wm, DinoWmConfig, "world model: predicts the patch tokens of a frozen DINOv2"),
    BaselineEntry {
        name: gc_idm::NAME,
        about: "policy: goal-conditioned inverse dynamics over latents of a frozen world model",
        presets: &["small"],
        settings: |preset, changes| match preset {
            "small" => changed(gc_idm::NAME, &gc_idm::GcIdmConfig::small(), changes),
            _ => Err(BaselineError::UnknownPreset {
                baseline: gc_idm::NAME,
                preset: preset.to_owned(),
                known: "small".to_owned(),
            }),
        },
        changed: |settings, changes| {
            let config: gc_idm::GcIdmConfig = parse(gc_idm::NAME, settings)?;
            changed(gc_idm::NAME, &config, changes)
        },
        make: |model_config, device| {
            let config: gc_idm::GcIdmConfig = parse(gc_idm::NAME, &model_config.settings)?;
            gc_idm::baseline(&config, model_config, device)
        },
    },
    entry!(gcbc, GcbcConfig, "policy: goal-conditioned behavioral cloning"),
    entry!(gciql, GciqlConfig, "policy: goal-conditioned implicit Q-learning"),
    entry!(gcivl, GcivlConfig, "policy: goal-conditioned implicit value learning"),
    entry!(
        gcsl,
        GcslConfig,
        "policy: goal-conditioned supervised learning, told how many decisions are left",
        small
    ),
    entry!(hilp, HilpConfig, "policy: goal-conditioned value that is a learned metric"),
    entry!(
        keypoint_wm,
        KeypointWmConfig,
        "world model: predicts the keypoints of a frozen encoder, such as gcsl's",
        small
    ),
    entry!(keypoints, KeypointsConfig, "encoder: places from which images are drawn, for keypoint-wm", small),
    entry!(lewm, LewmConfig, "world model: joint embedding, regularized by SIGReg"),
    entry!(pldm, PldmConfig, "world model: joint embedding, regularized by VICReg"),
];

/// What a model is made from.
#[derive(Clone, Debug)]
pub struct MakeOptions<'a> {
    /// `paper`, `small`.
    pub preset: &'a str,
    /// Settings that differ from the preset's, as nested objects; `null` for none.
    pub changes: Json,
    /// Dimensions of the data that it is made for.
    pub dims: DataDims,
    /// The seed of its first weights.
    pub seed: u64,
    /// What it is computed on.
    pub device: Device,
}

impl<'a> MakeOptions<'a> {
    /// A preset for data of these dimensions, without changes, with seed 0, on the CPU.
    pub fn new(preset: &'a str, dims: DataDims) -> Self {
        Self { preset, changes: Json::Null, dims, seed: 0, device: Device::Cpu }
    }
}

/// A new model with fresh weights.
///
/// # Errors
///
/// No such baseline or preset, or an unknown or misfit setting.
pub fn make(name: &str, options: &MakeOptions<'_>) -> Result<Box<dyn Baseline>, BaselineError> {
    let entry = find(name)?;
    let model_config = ModelConfig {
        baseline: entry.name.to_owned(),
        preset: options.preset.to_owned(),
        settings: (entry.settings)(options.preset, &options.changes)?,
        dims: options.dims,
        seed: options.seed,
    };
    made(entry, model_config, options.device)
}

/// The model of a config, with its initial weights.
///
/// # Errors
///
/// No such baseline, or settings that it does not take.
pub fn restore(model_config: &ModelConfig, device: Device) -> Result<Box<dyn Baseline>, BaselineError> {
    made(find(&model_config.baseline)?, model_config.clone(), device)
}

/// All settings of a model, with changes laid over them, as over a preset.
pub(crate) fn changed_settings(model_config: &ModelConfig, changes: &Json) -> Result<Json, BaselineError> {
    (find(&model_config.baseline)?.changed)(&model_config.settings, changes)
}

/// All settings of a preset.
pub(crate) fn settings_of(name: &str, preset: &str) -> Result<Json, BaselineError> {
    (find(name)?.settings)(preset, &Json::Null)
}

/// As [`restore`], on a device that is there already.
pub(crate) fn made_on(
    model_config: &ModelConfig,
    device: &TensorDevice,
) -> Result<Box<dyn Baseline>, BaselineError> {
    (find(&model_config.baseline)?.make)(model_config.clone(), device)
}

fn made(
    entry: &BaselineEntry,
    model_config: ModelConfig,
    device: Device,
) -> Result<Box<dyn Baseline>, BaselineError> {
    let DataDims { action_dim, proprio_dim } = model_config.dims;
    let dims = [("action_dim", action_dim), ("proprio_dim", proprio_dim)];
    check_bounds(&model_config.settings, &dims)
        .map_err(|reason| BaselineError::Settings { baseline: entry.name, reason })?;
    (entry.make)(model_config, &device.device()?)
}

fn learner<N: Network>(
    name: &'static str,
    model_config: ModelConfig,
    parts: Parts<N>,
    device: &TensorDevice,
) -> Result<Box<dyn Baseline>, BaselineError> {
    Ok(Box::new(Learner::new(name, model_config, parts, device.clone())?))
}

fn parse<C: DeserializeOwned>(baseline: &'static str, settings: &Json) -> Result<C, BaselineError> {
    C::deserialize(settings).map_err(|error| BaselineError::Settings { baseline, reason: error.to_string() })
}

fn changed<C: Serialize + DeserializeOwned>(
    baseline: &'static str,
    preset: &C,
    changes: &Json,
) -> Result<Json, BaselineError> {
    let config = with_changes(baseline, preset, changes)?;
    serde_json::to_value(config)
        .map_err(|error| BaselineError::Settings { baseline, reason: error.to_string() })
}

fn find(name: &str) -> Result<&'static BaselineEntry, BaselineError> {
    BASELINES.iter().find(|entry| entry.name == name).ok_or_else(|| {
        let names: Vec<&str> = BASELINES.iter().map(|entry| entry.name).collect();
        BaselineError::UnknownBaseline {
            name: name.to_owned(),
            nearest: nearest(name, names.iter().copied()),
            known: names.join(", "),
        }
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// What the reference's files of settings say (`scripts/train/config`, August 2026), and where they are silent its trainer:
    /// AdamW's decay of 0.01 is PyTorch's, the cosine that of stable-pretraining 0.1.8.
    #[test]
    fn presets_of_the_paper_are_the_references() {
        let warm = json!({ "warm_up_cosine": { "warm_up": 0.01 } });
        let cosine = json!({ "warm_up_cosine": { "warm_up": 0.0 } });
        let clip = json!(1.0);
        let frozen = json!([384, 12, 6, 1536, 14, 518, true]);
        let tiny = json!([192, 12, 3, 768, 14, 224, false]);
        for (name, lr, decay, clip, schedule, batch, frameskip, dropout, encoder) in [
            ("dino-wm", 5e-4, 0.0, &clip, &cosine, 32, 5, 0.1, &frozen),
            ("gcbc", 1e-4, 0.01, &Json::Null, &warm, 128, 1, 0.0, &frozen),
            ("gciql", 3e-4, 0.01, &clip, &cosine, 32, 1, 0.0, &frozen),
            ("gcivl", 3e-4, 0.01, &clip, &cosine, 128, 1, 0.0, &frozen),
            ("hilp", 3e-4, 0.01, &clip, &cosine, 128, 1, 0.0, &frozen),
            ("lewm", 5e-5, 1e-3, &clip, &warm, 128, 5, 0.1, &tiny),
            ("pldm", 5e-5, 1e-3, &clip, &warm, 128, 5, 0.1, &tiny),
        ] {
            let settings = (find(name).unwrap().settings)("paper", &Json::Null).unwrap();
            let optim = json!({ "lr": lr, "weight_decay": decay, "betas": [0.9, 0.999], "epsilon": 1e-8, "clip": clip,
                "schedule": schedule, "ema": 0.0 });
            assert_eq!(settings["optim"], optim, "{name}");
            let model = settings.get("model").unwrap_or(&settings);
            let sizes = ["image", "history", "frameskip", "batch"].map(|size| model[size].clone());
            assert_eq!(json!(sizes), json!([224, 3, frameskip, batch]), "{name}");
            let predictor = ["depth", "heads", "head_dim", "hidden", "dropout"];
            let predictor = predictor.map(|size| model["predictor"][size].clone());
            assert_eq!(json!(predictor), json!([6, 16, 64, 2048, dropout]), "{name}");
            let parts = ["dim", "depth", "heads", "hidden", "patch", "positions_for", "dinov2"];
            let parts = parts.map(|part| model["encoder"][part].clone());
            assert_eq!(&json!(parts), encoder, "{name}");
        }
        let of = |name: &str, part: &str| {
            (find(name).unwrap().settings)("paper", &Json::Null).unwrap()[part].clone()
        };
        assert_eq!(of("lewm", "sigreg"), json!({ "weight": 0.09, "knots": 17, "projections": 1024 }));
        assert_eq!(of("gcbc", "goals"), json!("uniform"));
        let value = |alpha| {
            json!({ "discount": 0.99, "expectile": 0.9, "momentum": 0.995, "alpha": alpha,
            "policy_goals": "mixed" })
        };
        assert_eq!((of("gcivl", "value"), of("gciql", "value")), (value(3.0), value(10.0)));
        assert_eq!((of("hilp", "value"), of("hilp", "embed_dim")), (value(3.0), json!(64)));
        let weights = json!({ "std": 18.0, "std_t": 0.7, "cov": 12.0, "cov_t": 0.0, "alignment": 0.2, "inverse": 0.0,
            "straightening": 0.0, "rollout": 0.0, "drawing": 0.0 });
        assert_eq!(of("pldm", "weights"), weights);
        assert_eq!((of("dino-wm", "proprio"), of("dino-wm", "action")), (json!(10), json!(10)));
    }
}
