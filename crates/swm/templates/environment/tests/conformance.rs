//! The rules that every environment keeps, and what its expert reaches.

use swm_core::{Registry, Rollout, World, WorldOptions};
use {{crate_name}}::POINT;

#[test]
fn it_conforms() {
    swm_core::testing::assert_conforms(&POINT);
}

#[test]
fn the_expert_reaches_every_goal() {
    let mut world = World::new(&POINT, WorldOptions::new(4).max_episode_steps(100)).unwrap();
    let expert = Registry::new().with(&[POINT]).policy("expert", &world).unwrap();
    world.set_policy(expert).unwrap();
    assert_eq!(world.evaluate(&Rollout::new(0..20)).unwrap().success_rate, 100.0);
}
