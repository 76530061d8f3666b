//! What is PushT's own about starts and goals from recorded steps; `conformance.rs` has what all environments share.

use std::collections::BTreeMap;

use swm_core::{
    Batch, Env, EnvConfig, EnvState, Episode, EpisodeSeed, ImageSize, ResetOptions, Schema, Value,
};
use swm_envs_2d::ENVS;

fn config() -> EnvConfig {
    EnvConfig { image: Some(ImageSize { height: 48, width: 64 }), ..EnvConfig::default() }
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
