//! TD-MPC2's settings: networks, losses, presets; the plan's are next to this file.

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use super::NAME;
use super::images::LEAST_SIDE;
use super::plan::{Tdmpc2Plan, at_least, not_negative};
use crate::error::BaselineError;
use crate::models::settings::with_changes;
use crate::online::agent::Task;
use crate::online::settings::CollectConfig;

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tdmpc2Config {
    /// Values of a latent, a multiple of `simnorm_dim`: so many for vectors, and so many for images.
    pub latent_dim: usize,
    /// Hidden dim of the encoder of vectors.
    pub encoder_dim: usize,
    /// The encoder of images.
    #[serde(default)]
    pub image: Tdmpc2Image,
    /// Hidden dim of all other networks.
    pub mlp_dim: usize,
    /// Values of a simplex in a latent.
    pub simnorm_dim: usize,
    /// Qs of the ensemble, 2 or more.
    pub num_q: usize,
    /// Dropout in the first layer of each Q.
    pub dropout: f64,
    /// Bins of rewards and values.
    pub num_bins: usize,
    /// The first bin, in units of symlog.
    pub vmin: f64,
    /// The last one.
    pub vmax: f64,
    /// H: steps that are predicted in an update.
    pub horizon: usize,
    /// Discount per step; `null`: by the length T of episodes, (T/5 − 1) / (T/5) within [0.95, 0.995].
    pub discount: Option<f64>,
    /// Weight of a predicted step relative to the one before it.
    pub rho: f64,
    /// Weight of the error of predicted latents.
    pub consistency_coef: f64,
    /// Weight of the cross-entropy of rewards.
    pub reward_coef: f64,
    /// Weight of the cross-entropy of values.
    pub value_coef: f64,
    /// Weight of the policy's entropy.
    pub entropy_coef: f64,
    /// Share of the Qs that their target networks take over per update, and of new percentiles in the scale of values.
    pub tau: f64,
    /// The learning rate of Adam.
    pub lr: f64,
    /// Decoupled weight decay, as in AdamW.
    #[serde(default)]
    pub weight_decay: f64,
    /// Factor of the encoder's.
    pub encoder_lr_scale: f64,
    /// Factor of the policy's.
    pub policy_lr_scale: f64,
    /// The greatest norm of all gradients together; `null`: any.
    pub clip: Option<f64>,
    /// Clips of an update.
    pub batch: usize,
    /// How it acts.
    pub plan: Tdmpc2Plan,
    /// How it collects.
    pub collect: CollectConfig,
}

/// The encoder of images, where they are observed: four convolutions and a linear layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tdmpc2Image {
    /// S: the side of the images, in pixels, 39 or more.
    pub size: usize,
    /// Channels of each convolution.
    pub channels: usize,
    /// Values of the latent of images; `null`: as many as of that of vectors.
    pub latent_dim: Option<usize>,
}

impl Default for Tdmpc2Image {
    /// The reference's.
    fn default() -> Self {
        Self { size: 64, channels: 32, latent_dim: None }
    }
}

impl Tdmpc2Config {
    /// The reference's, of `scripts/expert/tdmpc2_online.py` (August 2026).
    pub fn paper() -> Self {
        Self {
            latent_dim: 128,
            encoder_dim: 256,
            image: Tdmpc2Image::default(),
            mlp_dim: 256,
            simnorm_dim: 8,
            num_q: 5,
            dropout: 0.01,
            num_bins: 101,
            vmin: -10.0,
            vmax: 10.0,
            horizon: 3,
            discount: None,
            rho: 0.5,
            consistency_coef: 20.0,
            reward_coef: 0.1,
            value_coef: 0.1,
            entropy_coef: 1e-4,
            tau: 0.01,
            lr: 3e-4,
            weight_decay: 0.0,
            encoder_lr_scale: 0.3,
            policy_lr_scale: 1.0,
            clip: Some(20.0),
            batch: 256,
            plan: Tdmpc2Plan {
                mpc: true,
                horizon: 3,
                samples: 512,
                iterations: 6,
                collect_samples: 256,
                collect_iterations: 4,
                elites: 64,
                policy_samples: 0,
                sigma: 2.0,
                sigma_min: 0.0,
                temperature: None,
                exploration: 0.0,
                uncertainty_penalty: 0.0,
            },
            collect: CollectConfig { random_steps: 5_000, ..CollectConfig::default() },
        }
    }

    /// For few steps on a CPU: smaller networks, a larger learning rate, and MPPI with plans of the policy prior, as in the paper, of
    /// fewer candidates.
    pub fn small() -> Self {
        let plan = Tdmpc2Plan {
            samples: 96,
            iterations: 4,
            collect_samples: 64,
            collect_iterations: 3,
            elites: 16,
            policy_samples: 12,
            sigma_min: 0.05,
            temperature: Some(2.0),
            exploration: 1.0,
            ..Self::paper().plan
        };
        Self {
            latent_dim: 64,
            encoder_dim: 128,
            image: Tdmpc2Image { size: 48, ..Tdmpc2Image::default() },
            mlp_dim: 128,
            num_q: 3,
            lr: 1e-3,
            batch: 128,
            plan,
            collect: CollectConfig::default(),
            ..Self::paper()
        }
    }

    /// The same for a dataset: the reference's of `scripts/train/config/tdmpc2.yaml` (August 2026) where its network is the reference's.
    fn on_a_dataset(self) -> Self {
        let is_small = self.mlp_dim < Self::paper().mlp_dim;
        let uncertainty_penalty = 0.5;
        let reference = Self {
            vmin: -6.0,
            vmax: 2.0,
            discount: Some(0.99),
            weight_decay: 0.01,
            policy_lr_scale: 0.1,
            plan: Tdmpc2Plan { uncertainty_penalty, ..self.plan.clone() },
            ..self
        };
        if is_small {
            return reference;
        }
        let plan = Tdmpc2Plan {
            horizon: 5,
            samples: 1024,
            iterations: 12,
            policy_samples: 256,
            sigma: 0.1,
            sigma_min: 0.01,
            temperature: Some(0.5),
            // Nothing is collected.
            collect_samples: 1024,
            ..reference.plan
        };
        Self { mlp_dim: 384, horizon: 5, plan, ..reference }
    }

    /// The settings of a stored run, checked.
    pub(super) fn parse(settings: &Json) -> Result<Self, BaselineError> {
        let config = Self::deserialize(settings).map_err(|error| wrong(error.to_string()))?;
        config.check().map_err(wrong)?;
        Ok(config)
    }

    fn check(&self) -> Result<(), String> {
        let Self { latent_dim, encoder_dim, mlp_dim, simnorm_dim, num_q, num_bins, horizon, batch, .. } =
            *self;
        let sizes = [
            ("latent_dim", latent_dim, 1),
            ("encoder_dim", encoder_dim, 1),
            ("image.size", self.image.size, LEAST_SIDE),
            ("image.channels", self.image.channels, 1),
            ("mlp_dim", mlp_dim, 1),
            ("simnorm_dim", simnorm_dim, 1),
            ("num_q", num_q, 2),
            ("num_bins", num_bins, 2),
            ("horizon", horizon, 1),
            ("batch", batch, 1),
        ];
        at_least(&sizes)?;
        let of_images = ("image.latent_dim", self.image.latent_dim.unwrap_or(latent_dim));
        for (name, dim) in [("latent_dim", latent_dim), of_images] {
            if dim == 0 || !dim.is_multiple_of(simnorm_dim) {
                return Err(format!(
                    "`{name}` is {dim}; it must be a multiple of `simnorm_dim`, {simnorm_dim}"
                ));
            }
        }
        let &Self { vmin, vmax, lr, encoder_lr_scale, policy_lr_scale, clip, .. } = self;
        if !(vmin < vmax && (vmax - vmin).is_finite()) {
            return Err(format!("`vmin` is {vmin} and `vmax` {vmax}; the first must be below the second"));
        }
        let rates =
            [("lr", lr), ("encoder_lr_scale", encoder_lr_scale), ("policy_lr_scale", policy_lr_scale)];
        let clip = clip.map(|clip| ("clip", clip));
        if let Some((name, value)) =
            rates.into_iter().chain(clip).find(|(_, value)| !(*value > 0.0 && value.is_finite()))
        {
            return Err(format!("`{name}` is {value}; it must be above 0"));
        }
        let shares = [("discount", self.discount.unwrap_or(1.0)), ("rho", self.rho), ("tau", self.tau)];
        if let Some((name, value)) = shares.iter().find(|(_, value)| !(0.0..=1.0).contains(value)) {
            return Err(format!("`{name}` is {value}; it must be in [0, 1]"));
        }
        if !(0.0..1.0).contains(&self.dropout) {
            return Err(format!("`dropout` is {}; it must be in [0, 1)", self.dropout));
        }
        let &Self { consistency_coef, reward_coef, value_coef, entropy_coef, .. } = self;
        not_negative(&[
            ("consistency_coef", consistency_coef),
            ("reward_coef", reward_coef),
            ("value_coef", value_coef),
            ("entropy_coef", entropy_coef),
            ("weight_decay", self.weight_decay),
        ])?;
        self.plan.check()?;
        self.collect.check()
    }
}

fn wrong(reason: String) -> BaselineError {
    BaselineError::Settings { baseline: NAME, reason }
}

/// The discount for episodes of this length: (T/5 − 1) / (T/5) within [0.95, 0.995], the heuristic of the published code.
fn discount(max_episode_steps: u64) -> f64 {
    let fifth = max_episode_steps as f64 / 5.0;
    ((fifth - 1.0) / fifth).clamp(0.95, 0.995)
}

/// All settings: the preset's, changes, and the discount of the task where none is set.
pub(in crate::online) fn settings(
    preset: &str,
    task: &Task<'_>,
    changes: &Json,
) -> Result<Json, BaselineError> {
    let preset = match preset {
        "small" => Tdmpc2Config::small(),
        _ => Tdmpc2Config::paper(),
    };
    let preset = if task.from_dataset { preset.on_a_dataset() } else { preset };
    let mut config = with_changes(NAME, &preset, changes)?;
    config.discount.get_or_insert(discount(task.max_episode_steps));
    config.check().map_err(wrong)?;
    serde_json::to_value(config).map_err(|error| wrong(error.to_string()))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn of(preset: &str, changes: &Json, max_episode_steps: u64) -> Result<Tdmpc2Config, BaselineError> {
        let task = Task::online("x", max_episode_steps);
        Tdmpc2Config::parse(&settings(preset, &task, changes)?)
    }

    #[test]
    fn the_discount_follows_the_length_of_episodes() {
        let discount = |steps, changes: Json| of("paper", &changes, steps).unwrap().discount.unwrap();
        assert!((discount(500, Json::Null) - 0.99).abs() < 1e-12);
        assert!((discount(20, Json::Null) - 0.95).abs() < 1e-12);
        assert!((discount(1, Json::Null) - 0.95).abs() < 1e-12);
        assert!((discount(100_000, Json::Null) - 0.995).abs() < 1e-12);
        assert!((discount(500, json!({ "discount": 0.5 })) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn on_datasets_it_has_the_settings_of_the_references_file() {
        let task = Task { from_dataset: true, ..Task::online("x", 500) };
        let of = |preset, changes| Tdmpc2Config::parse(&settings(preset, &task, &changes).unwrap()).unwrap();
        let Tdmpc2Config { horizon, mlp_dim, vmin, vmax, batch, clip, discount, .. } =
            of("paper", Json::Null);
        assert_eq!((horizon, mlp_dim, vmin, vmax, batch, clip), (5, 384, -6.0, 2.0, 256, Some(20.0)));
        assert_eq!(discount, Some(0.99));
        let Tdmpc2Config { lr, encoder_lr_scale, policy_lr_scale, weight_decay, plan, .. } =
            of("paper", Json::Null);
        assert_eq!((lr, encoder_lr_scale, policy_lr_scale, weight_decay), (3e-4, 0.3, 0.1, 0.01));
        let Tdmpc2Plan { samples, iterations, elites, policy_samples, uncertainty_penalty, .. } = plan;
        assert_eq!(
            (samples, iterations, elites, policy_samples, uncertainty_penalty),
            (1024, 12, 64, 256, 0.5)
        );
        let small = of("small", json!({ "discount": 0.9 }));
        assert_eq!((small.mlp_dim, small.vmin, small.discount), (128, -6.0, Some(0.9)));
    }

    #[test]
    fn wrong_settings_are_refused_by_name() {
        for (changes, reason) in [
            (json!({ "lr": 0.0 }), "`lr` is 0"),
            (json!({ "num_q": 1 }), "`num_q` is 1; it must be at least 2"),
            (json!({ "image": { "size": 32 } }), "`image.size` is 32; it must be at least 39"),
            (json!({ "image": { "sice": 48 } }), "did you mean `image.size`?"),
            (json!({ "latent_dim": 12 }), "must be a multiple of `simnorm_dim`, 8"),
            (json!({ "vmin": 11.0 }), "`vmin` is 11"),
            (json!({ "rho": 2.0 }), "`rho` is 2"),
            (json!({ "dropout": 1.0 }), "`dropout` is 1"),
            (json!({ "clip": -1.0 }), "`clip` is -1"),
            (json!({ "plan": { "samples": 8 } }), "`plan.samples` is 8; it must be at least 16"),
            (json!({ "plan": { "collect_samples": 20, "policy_samples": 20 } }), "must be at least 21"),
            (json!({ "plan": { "temperature": 0.0 } }), "`plan.temperature` is 0"),
            (json!({ "plan": { "sigma_min": 3.0 } }), "at most `plan.sigma`, 2"),
            (json!({ "plan": { "sample": 3 } }), "did you mean `plan.samples`?"),
            (json!({ "collect": { "num_envs": 0 } }), "`collect.num_envs`"),
        ] {
            let message = of("small", &changes, 500).unwrap_err().to_string();
            assert!(message.starts_with("settings of `tdmpc2`: ") && message.contains(reason), "{message}");
        }
    }
}
