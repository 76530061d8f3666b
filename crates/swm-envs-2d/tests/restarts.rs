//! Episodes that start at recorded steps continue as the recorded ones did, and images of recorded goals are the recorded frames;
//! what is lost is listed here, with the reason, and told by the environment's page.

use std::collections::BTreeMap;

use swm_core::testing::{Inexact, goals_look_as_recorded, restarts_continue};
use swm_core::{
    Batch, Env, EnvConfig, EnvState, Episode, EpisodeSeed, ImageSize, ResetOptions, Schema, Value,
};
use swm_envs_2d::ENVS;

fn config() -> EnvConfig {
    EnvConfig { image: Some(ImageSize { height: 48, width: 64 }), ..EnvConfig::default() }
}

/// What differs, by environment.
const INEXACT: &[(&str, &[Inexact<'_>])] = &[
    ("swm/PushTRapier-v0", &[rounding("state"), rounding("block_pose")]),
    (
        "swm/PendulumControl-v1",
        &[Inexact {
            column: "pixels",
            first: 255.0,
            later: 0.0,
            reason: "the arrow of the last torque is missing",
        }],
    ),
];

/// The engine moves centers of gravity, rows have origins: of the way between the two the last bits differ.
const fn rounding(column: &str) -> Inexact<'_> {
    Inexact {
        column,
        first: 0.0,
        later: 1e-12,
        reason: "rounding between a body's origin and its center of gravity",
    }
}

/// Pixels of a goal that differ from the recorded frame, and by how much, by environment and reason.
const OTHER_GOALS: &[(&str, [usize; 2], &str)] = &[];

#[test]
fn restarts_of_all_environments_continue_as_recorded() {
    let of = |id: &str| INEXACT.iter().find(|(env, _)| *env == id).map_or(&[][..], |(_, columns)| columns);
    let failures = ENVS.iter().filter_map(|entry| restarts_continue(entry, &config(), of(entry.id)).err());
    let failures: Vec<String> = failures.collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn goals_of_all_environments_look_as_recorded() {
    let of = |id: &str| OTHER_GOALS.iter().find(|(env, ..)| *env == id).map_or([0, 0], |(_, most, _)| *most);
    let failures =
        ENVS.iter().filter_map(|entry| goals_look_as_recorded(entry, &config(), of(entry.id)).err());
    let failures: Vec<String> = failures.collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// Goals of manifests from before `block_pose` was one of their columns keep their images: results on them can be repeated.
#[test]
fn a_goal_without_a_pose_is_rendered_as_the_reference_does() {
    let make = || ENVS.iter().find(|entry| entry.id == "swm/PushT-v1").unwrap().make(&config()).unwrap();
    let goal_image = |env: &mut dyn Env| {
        let mut row = Batch::new(Schema::new(env.spec().fields.clone()).unwrap(), 1);
        env.write_episode(&mut row.rows_mut());
        row.get::<u8>("goal").unwrap().to_vec()
    };
    // The agent moves by 4 px in a physics step.
    let state = Value::vector(&[120.0, 300.0, 300.0, 200.0, 1.0, 400.0, 0.0]);
    let pose = Value::vector(&[300.0, 200.0, 1.0]);
    let images = [None, Some(pose)].map(|pose| {
        let columns = [("state", Some(state.clone())), ("block_pose", pose)];
        let goal: BTreeMap<_, _> =
            columns.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect();
        let options = ResetOptions { goal: Some(goal), ..ResetOptions::default() };
        let (mut env, mut other, mut saved) = (make(), make(), EnvState::new());
        env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap();
        env.snapshot(&mut saved).unwrap();
        other.restore(&saved).unwrap();
        let image = goal_image(env.as_mut());
        assert_eq!(goal_image(other.as_mut()), image, "after a snapshot");
        image
    });
    assert_ne!(images[0], images[1]);
}
