//! The environment keeps every rule, alone and in a world.

use ice_rink::{ICE_RINK, registry};
use swm_core::testing::{Exceptions, IMAGE, NoPart, assert_conforms_with};
use swm_core::{EnvConfig, Rollout, World, WorldOptions};

#[test]
fn it_conforms() {
    let no_part = &[NoPart { column: "goal_state", reason: "a puck on the mark is at rest" }];
    let config = EnvConfig { image: Some(IMAGE), ..EnvConfig::default() };
    assert_conforms_with(&ICE_RINK, &config, Exceptions { no_part, ..Exceptions::NONE });
}

#[test]
fn its_expert_brings_every_puck_to_its_mark() {
    let registry = registry();
    let env = registry.env("demo/IceRink-v0").unwrap();
    let options = WorldOptions::new(4).max_episode_steps(200);
    let mut world = World::new(env, options).unwrap();
    world.set_policy(registry.policy("expert", &world).unwrap()).unwrap();
    let rollout = Rollout::new(0..100).seed(7).vary(["all"]);
    let result = world.evaluate(&rollout).unwrap();
    assert_eq!((result.episodes, result.success_rate), (100, 100.0));
}
