//! What holds for any setup and any actions.

use super::super::*;
use proptest::prelude::*;

prop_compose! {
    fn setups()(
        shapes in (0..8_usize, 1..8_usize),
        scales in (20.0..=60.0_f32, 20.0..=60.0_f32),
        agent in [50.0..450.0_f64, 50.0..450.0_f64],
        block in [100.0..400.0_f64, 100.0..400.0_f64],
        angles in (-6.3..6.3_f64, -6.3..6.3_f64),
    ) -> Setup {
        let shape = |index| Shape::from_index(index).expect("an index below 8");
        Setup {
            agent: BodySetup { shape: shape(shapes.0), scale: scales.0, position: agent, angle: angles.0 },
            block: BodySetup { shape: shape(shapes.1), scale: scales.1, position: block, angle: angles.1 },
            ..Setup::default()
        }
    }
}

fn actions(count: usize) -> impl Strategy<Value = Vec<[f32; 2]>> {
    prop::collection::vec([-1.0..=1.0_f32, -1.0..=1.0_f32], count)
}

/// An action that mostly heads for the block, so that contacts happen.
fn toward_block(sim: &Sim, noise: [f32; 2]) -> [f32; 2] {
    let (agent, block) = (sim.position(BodyId::Agent), sim.center_of_gravity(BodyId::Block));
    [0, 1].map(|axis| ((block[axis] - agent[axis]) as f32 / 100.0 + noise[axis]).clamp(-1.0, 1.0))
}

fn start(setup: &Setup) -> Sim {
    let mut sim = Sim::new(setup).unwrap();
    let ([x, y], [bx, by]) = (setup.agent.position, setup.block.position);
    sim.place(&Placement::from([x, y, bx, by, setup.block.angle])).unwrap();
    sim.substep();
    sim
}

fn is_finite(sim: &Sim) -> bool {
    [BodyId::Agent, BodyId::Block].into_iter().all(|body| {
        let ([x, y], [vx, vy]) = (sim.position(body), sim.velocity(body));
        [x, y, vx, vy, sim.angle(body), sim.angular_velocity(body)].into_iter().all(f64::is_finite)
    })
}

/// The bits of a state: tells -0 from 0, which `==` does not.
fn bits(sim: &Sim) -> String {
    serde_json::to_string(sim.state()).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn two_thousand_steps_stay_finite(setup in setups(), noise in actions(2000)) {
        let mut sim = start(&setup);
        for noise in noise {
            sim.control_step(toward_block(&sim, noise), ActionMode::Relative);
            prop_assert!(is_finite(&sim));
            prop_assert_eq!(sim.contacts().count() as u32, sim.contact_points());
        }
    }

    #[test]
    fn copies_and_restored_states_continue_alike(setup in setups(), before in actions(30), after in actions(30)) {
        let mut sim = start(&setup);
        for noise in before {
            sim.control_step(toward_block(&sim, noise), ActionMode::Relative);
        }
        let mut copy = sim.clone();
        let text = serde_json::to_string(sim.state()).unwrap();
        let mut restored = Sim::new(&setup).unwrap();
        restored.restore(&serde_json::from_str(&text).unwrap()).unwrap();
        for noise in after {
            let action = toward_block(&sim, noise);
            for sim in [&mut sim, &mut copy, &mut restored] {
                sim.control_step(action, ActionMode::Relative);
            }
            prop_assert_eq!(bits(&sim), bits(&copy));
            prop_assert_eq!(bits(&sim), bits(&restored));
        }
    }

    #[test]
    fn substeps_alone_or_in_a_control_step_are_the_same(setup in setups(), velocity in [-90.0..90.0_f64, -90.0..90.0_f64]) {
        let mut sim = start(&setup);
        let mut moving = Placement::from([200.0, 200.0, 230.0, 240.0, 0.3]);
        moving.agent_velocity = velocity;
        sim.place_exactly(&moving).unwrap();
        let mut once_more = sim.clone();
        once_more.place_exactly(&moving).unwrap();
        prop_assert_eq!(&sim, &once_more);
        for _ in 0..30 {
            prop_assert_eq!(sim.substep(), once_more.substep());
        }
        prop_assert_eq!(sim, once_more);
    }

    #[test]
    fn a_kinematic_disc_goes_where_the_controller_wants(mut setup in setups(), noise in actions(40)) {
        setup.agent.shape = Shape::Disc;
        let mut sim = start(&setup);
        let mut alone = start(&setup);
        for noise in noise {
            let action = toward_block(&sim, noise);
            let place = Placement::from([
                alone.position(BodyId::Agent)[0], alone.position(BodyId::Agent)[1], 1000.0, 1000.0, 0.0,
                alone.velocity(BodyId::Agent)[0], alone.velocity(BodyId::Agent)[1],
            ]);
            alone.place_exactly(&place).unwrap();
            sim.control_step(action, ActionMode::Relative);
            alone.control_step(action, ActionMode::Relative);
            prop_assert_eq!(sim.position(BodyId::Agent), alone.position(BodyId::Agent));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_states_are_refused_or_harmless(setup in setups(), which in 0..1000_usize, value in 0..260_u64) {
        let mut sim = start(&setup);
        for _ in 0..3 {
            sim.control_step(toward_block(&sim, [0.0; 2]), ActionMode::Relative);
        }
        let mut damaged = serde_json::to_value(sim.state()).unwrap();
        let count = integers(&mut damaged).len();
        *integers(&mut damaged)[which % count] = value.into();
        let Ok(state) = serde_json::from_value::<State>(damaged) else { return Ok(()) };
        if sim.restore(&state).is_ok() {
            for _ in 0..5 {
                sim.control_step(toward_block(&sim, [0.1, -0.1]), ActionMode::Relative);
                prop_assert_eq!(sim.contacts().count() as u32, sim.contact_points());
            }
        }
    }
}

/// All integers of a JSON value: indices, lengths and counters, but no coordinates.
fn integers(value: &mut serde_json::Value) -> Vec<&mut serde_json::Value> {
    use serde_json::Value;
    match value {
        Value::Array(items) => items.iter_mut().flat_map(integers).collect(),
        Value::Object(fields) => fields.values_mut().flat_map(integers).collect(),
        Value::Number(number) if number.is_u64() => vec![value],
        _ => Vec::new(),
    }
}

#[test]
fn actions_that_are_not_finite_do_not_panic() {
    for shape in Shape::ALL {
        for bad in [f32::NAN, f32::INFINITY, f32::MAX] {
            let agent = BodySetup { shape, scale: 40.0, position: [300.0, 200.0], angle: 0.4 };
            let mut sim = start(&Setup { agent, ..Setup::default() });
            for action in [[bad, 0.0], [0.0, bad], [0.5, -0.5]] {
                for _ in 0..5 {
                    sim.control_step(action, ActionMode::Relative);
                }
            }
        }
    }
}

#[test]
fn a_state_of_other_bodies_is_refused() {
    let mut sim = Sim::new(&Setup::default()).unwrap();
    let agent = BodySetup { shape: Shape::Plus, ..Setup::default().agent };
    let other = Sim::new(&Setup { agent, ..Setup::default() }).unwrap();
    let error = sim.restore(other.state()).unwrap_err();
    assert_eq!(error, PhysicsError::ForeignState);
    assert!(error.to_string().contains("world of the same shapes"));
}
