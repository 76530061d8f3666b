//! stable-worldmodel: environments, factors of variation, datasets, planning and evaluation for world-model
//! research.
//!
//! This crate joins the others: it re-exports them as modules, and the most used names of [`core`] at the top. It merges
//! their tables into one [`registry`] and has the command `swm` (feature `cli`). Depend on the single crates where that is enough.
//!
//! ```
//! use swm::{Rollout, World, WorldOptions, policies};
//!
//! let registry = swm::registry();
//! let mut world = World::new(registry.env("swm/PushT-v1")?, WorldOptions::new(2))?;
//! world.set_policy(policies::random())?;
//! let rollout = Rollout::new(0..4).seed(42);
//! let result = world.evaluate(&rollout)?;
//! assert_eq!(result.episodes, 4);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(clippy::print_stdout, clippy::print_stderr)] // They panic where the reader is gone or the disk full.

mod absent;
#[cfg(feature = "cli")]
pub mod cli;
pub mod data;
pub mod doctor;

#[cfg(feature = "baselines")]
pub use swm_baselines as baselines;
#[cfg(feature = "baselines")]
pub use swm_checkpoints as checkpoints;
pub use swm_core as core;
pub use swm_core::{
    Actions, BoxError, Env, EvalOptions, Evaluation, ImageSize, Policy, Recorder, Registry, ResetOptions,
    Rollout, View, World, WorldOptions, policies,
};
pub use swm_data_foreign as data_foreign;
#[cfg(feature = "lance")]
pub use swm_data_lance as data_lance;
#[cfg(feature = "lerobot")]
pub use swm_data_lerobot as data_lerobot;
pub use swm_envs_2d as envs_2d;
#[cfg(feature = "rapier")]
pub use swm_envs_3d as envs_3d;
#[cfg(feature = "mujoco")]
pub use swm_envs_mujoco as envs_mujoco;
pub use swm_files as files;
pub use swm_fov as fov;
#[cfg(feature = "cli")]
pub use swm_jobs as jobs;
pub use swm_media as media;
#[cfg(feature = "onnx")]
pub use swm_onnx as onnx;
pub use swm_render as render;
pub use swm_solvers as solvers;
pub use swm_tasks as tasks;
pub use swm_tasks::{board, bundle, distractors, evaluation, plan, replay, report, report_page, video};
#[cfg(feature = "ui")]
pub use swm_ui as ui;

#[cfg(feature = "cli")]
use swm_tasks::text_file;

/// Every environment, policy, solver, dataset format and layout of other programs' datasets of this workspace.
pub fn registry() -> Registry {
    let registry = Registry::new().with(swm_envs_2d::ENVS);
    #[cfg(feature = "rapier")]
    let registry = registry.with(swm_envs_3d::ENVS);
    #[cfg(feature = "mujoco")]
    let registry = registry.with(swm_envs_mujoco::ENVS);
    #[cfg(feature = "baselines")]
    let registry = registry
        .with(swm_checkpoints::POLICIES)
        .with(swm_checkpoints::MODELS)
        .with(swm_baselines::trainer::TRAINERS);
    #[cfg(feature = "onnx")]
    let registry = registry.with(swm_onnx::POLICIES);
    let registry = registry.with(swm_data::FORMATS).with(swm_data_foreign::LAYOUTS);
    #[cfg(feature = "lerobot")]
    let registry = registry.with(swm_data_lerobot::FORMATS);
    #[cfg(feature = "lance")]
    let registry = registry.with(swm_data_lance::FORMATS);
    let registry = registry.with(swm_solvers::SOLVERS).with(swm_solvers::PLANNERS);
    registry.with(&[swm_solvers::EXPERT]).with(absent::NAMES)
}

#[cfg(test)]
mod tests {
    use swm_core::evaluate::Tier;
    use swm_core::{EnvConfig, Schema, SuccessRule};
    use swm_tasks::evaluation::{ruled_envs, tier_rules};

    use super::*;

    #[test]
    fn every_rule_of_a_tier_fits_its_environment() {
        let registry = registry();
        for (id, settings) in ruled_envs() {
            let entry = match registry.env(id) {
                Ok(entry) => entry,
                Err(_) if cfg!(not(all(feature = "mujoco", feature = "rapier"))) => continue,
                Err(unknown) => panic!("{unknown}"),
            };
            let config = EnvConfig { image: None, settings: settings.clone() };
            // What cannot run here, for want of a library say, is tested elsewhere.
            let Ok(env) = entry.make(&config) else { continue };
            let schema = Schema::new(env.spec().fields.clone()).unwrap();
            for tier in [Tier::Moderate, Tier::Strict] {
                let rules = tier_rules(id, &settings, tier).unwrap();
                assert!(rules.success.judge(&schema).unwrap().is_some());
                let motion = SuccessRule { hold: 1, all: rules.motion.into_iter().collect() };
                assert!(motion.judge(&schema).unwrap().is_some());
                for (column, _) in rules.rest {
                    assert!(env.spec().start_columns.contains(&column.as_str()), "{id}: {column}");
                }
            }
        }
    }
}
