//! What PushT on rapier2d promises: exact states, solid walls, friction, a block that rests when nothing pushes it.

use super::super::*;
use crate::pusht::Engine;

/// The default bodies at a place: agent x, y; block x, y, angle.
fn sim(friction: f64, at: [f64; 5]) -> RapierSim {
    let mut sim = RapierSim::new(&Setup { friction, ..Setup::default() }).unwrap();
    sim.place_exactly(&Placement::from(at)).unwrap();
    sim
}

#[test]
fn a_restored_state_continues_to_the_bit() {
    for agent in [Shape::Disc, Shape::L] {
        let mut setup = Setup { friction: 0.5, ..Setup::default() };
        (setup.agent.shape, setup.agent.scale) = (agent, 30.0);
        let mut sim = RapierSim::new(&setup).unwrap();
        sim.place_exactly(&Placement::from([200.0, 230.0, 250.0, 250.0, 0.3])).unwrap();
        let mut touched = 0;
        for step in 0..60 {
            let action = [(f64::from(step) * 0.37).cos() as f32, (f64::from(step) * 0.23).sin() as f32];
            let mut other = RapierSim::new(&setup).unwrap();
            other.restore(sim.state()).unwrap();
            let mut copy = sim.clone();
            let points = sim.control_step(action, ActionMode::Relative);
            assert_eq!(other.control_step(action, ActionMode::Relative), points);
            assert_eq!(copy.control_step(action, ActionMode::Relative), points);
            assert_eq!((sim.state(), sim.state()), (other.state(), copy.state()), "{agent:?}, step {step}");
            touched += points;
        }
        assert!(touched > 20, "{agent:?}: {touched} contact points test little");
    }
}

#[test]
fn the_block_moves_only_while_it_is_pushed() {
    let mut sim = sim(0.5, [170.0, 265.0, 250.0, 250.0, 0.0]);
    for _ in 0..5 {
        sim.control_step([1.0_f32, 0.0], ActionMode::Relative);
    }
    assert!(sim.position(BodyId::Block)[0] > 300.0);
    for _ in 0..3 {
        sim.control_step([-1.0_f32, 0.0], ActionMode::Relative);
    }
    let rest = (sim.position(BodyId::Block), sim.angle(BodyId::Block));
    sim.control_step([-1.0_f32, 0.0], ActionMode::Relative);
    assert_eq!((sim.position(BodyId::Block), sim.angle(BodyId::Block)), rest);
}

#[test]
fn walls_stop_agent_and_block_also_between_each_other() {
    let mut alone = sim(0.5, [100.0, 256.0, 400.0, 100.0, 0.0]);
    let mut jammed = sim(0.5, [150.0, 256.0, 60.0, 211.0, -std::f64::consts::FRAC_PI_2]);
    for step in 0..40 {
        alone.control_step([-1.0_f32, 0.0], ActionMode::Relative);
        jammed.control_step([-1.0_f32, 0.0], ActionMode::Relative);
        assert!(alone.position(BodyId::Agent)[0] > 7.0 + 15.0 - 1.0, "the agent is in the wall");
        for corner in jammed.corners(BodyId::Block).flatten() {
            assert!(corner[0] > 7.0 - 2.0, "step {step}: the block is in the wall, to {corner:?}");
        }
    }
    assert!((alone.position(BodyId::Agent)[0] - 22.0).abs() < 1.0);
    assert!(jammed.position(BodyId::Agent)[0] > 22.0, "the block is in between");
}

/// How far the block went along while the agent slid along its upper side, pixels.
fn way_along(friction: f64) -> f64 {
    // The bar of the T has its upper side at y = 250; the agent presses on it a little and goes along it.
    let mut sim = sim(friction, [230.0, 234.0, 250.0, 250.0, 0.0]);
    let start = sim.position(BodyId::Block)[0];
    for _ in 0..3 {
        sim.control_step([0.6_f32, 0.15], ActionMode::Relative);
    }
    sim.position(BodyId::Block)[0] - start
}

#[test]
fn friction_takes_the_block_along() {
    let (smooth, rough) = (way_along(0.0), way_along(0.8));
    assert!(rough > smooth + 2.0, "{smooth} px without friction, {rough} px with it");
}

#[test]
fn contacts_are_where_the_bodies_touch() {
    let mut sim = sim(0.5, [250.0, 236.0, 250.0, 250.0, 0.0]);
    assert_eq!(sim.settle(), 1);
    let contact = sim.contacts().next().unwrap();
    for [x, y] in [contact.on_first, contact.on_second] {
        assert!((x - 250.0).abs() < 1.0 && (y - 250.0).abs() < 2.0, "{contact:?}");
    }
    let [nx, ny] = contact.normal;
    assert!(nx.abs() < 1e-9 && (ny.abs() - 1.0).abs() < 1e-9);
    sim.place_exactly(&Placement::from([250.0, 230.0, 250.0, 250.0, 0.0])).unwrap();
    assert_eq!((sim.settle(), sim.contacts().count()), (0, 0));
}

#[test]
fn wrong_friction_is_refused_by_both_engines() {
    let with = |friction| Setup { friction, ..Setup::default() };
    assert!(RapierSim::new(&with(-0.1)).unwrap_err().to_string().contains("friction -0.1"));
    assert!(RapierSim::new(&with(f64::NAN)).is_err());
    let message = Sim::new(&with(0.5)).unwrap_err().to_string();
    assert!(message.contains("no friction") && message.contains("PushTRapier"), "{message}");
}

#[test]
fn states_that_are_not_finite_are_refused() {
    let mut spoiled = sim(0.5, [100.0, 100.0, 250.0, 250.0, 0.0]);
    spoiled.control_step([f32::NAN, 0.0], ActionMode::Relative);
    let mut sim = sim(0.5, [100.0, 100.0, 250.0, 250.0, 0.0]);
    if !spoiled.position(BodyId::Agent)[0].is_finite() {
        assert_eq!(sim.restore(spoiled.state()), Err(PhysicsError::ForeignState));
    }
    assert!(sim.place(&Placement::from([f64::NAN, 0.0, 0.0, 0.0, 0.0])).is_err());
    sim.control_step([0.5_f32, 0.0], ActionMode::Relative);
    assert!(sim.position(BodyId::Agent)[0] > 100.0);
}
