//! Cases that can be checked by hand.

use super::super::*;

const OVERLAP_REMOVED: f64 = 0.061_259_621_561_307_376;
const ALLOWED_OVERLAP: f64 = 0.1_f32 as f64;

fn body(shape: Shape, scale: f32) -> BodySetup {
    BodySetup { shape, scale, ..Setup::default().block }
}

/// A disc of radius 15 and a square of half side 30, inertia 600, center of gravity in its middle.
fn disc_and_square(placement: &Placement) -> Sim {
    let mut sim = Sim::new(&Setup { block: body(Shape::Square, 30.0), ..Setup::default() }).unwrap();
    sim.place_exactly(placement).unwrap();
    sim
}

fn assert_near(a: [f64; 2], b: [f64; 2], tolerance: f64) {
    assert!((a[0] - b[0]).abs() <= tolerance && (a[1] - b[1]).abs() <= tolerance, "{a:?} is not near {b:?}");
}

#[test]
fn overlap_is_removed_by_a_fixed_share_per_substep() {
    let depth = 4.0;
    let mut sim = disc_and_square(&Placement::from([255.0 + depth, 300.0, 300.0, 300.0, 0.0]));
    assert_eq!(sim.substep(), 1);
    assert_eq!(sim.position(BodyId::Block), [300.0, 300.0]);
    sim.substep();
    let moved = OVERLAP_REMOVED * (depth - ALLOWED_OVERLAP);
    assert_near(sim.position(BodyId::Block), [300.0 + moved, 300.0], 1e-12);
    assert_eq!((sim.angle(BodyId::Block), sim.velocity(BodyId::Block)), (0.0, [0.0, 0.0]));
}

#[test]
fn a_push_through_the_center_takes_the_block_along() {
    let start =
        Placement { agent_velocity: [30.0, 20.0], ..Placement::from([254.9, 299.8, 300.0, 300.0, 0.0]) };
    let mut sim = disc_and_square(&start);
    sim.substep();
    assert_near(sim.velocity(BodyId::Block), [30.0, 0.0], 1e-12);
    assert!(sim.angular_velocity(BodyId::Block).abs() < 1e-12);
}

#[test]
fn a_push_off_the_center_turns_the_block() {
    let (lever, inertia) = (10.0, 600.0);
    let start =
        Placement { agent_velocity: [30.0, 0.0], ..Placement::from([254.9, 290.0, 300.0, 300.0, 0.0]) };
    let mut sim = disc_and_square(&start);
    sim.substep();
    assert_near(sim.velocity(BodyId::Block), [30.0 / (1.0 + lever * lever / inertia), 0.0], 1e-12);
    let turn = 30.0 * lever / (inertia + lever * lever);
    assert!((sim.angular_velocity(BodyId::Block) - turn).abs() < 1e-12);
    let [contact] = sim.contacts().collect::<Vec<_>>()[..] else { panic!("one contact") };
    assert_near(contact.normal, [1.0, 0.0], 0.0);
    assert_near(contact.on_first, [270.2, 290.0], 1e-12);
    assert_near(contact.on_second, [270.0, 290.0], 1e-12);
}

#[test]
fn a_full_action_moves_the_resting_disc_by_one_pixel_first() {
    let mut sim = Sim::new(&Setup::default()).unwrap();
    sim.place_exactly(&Placement::from([200.0, 200.0, 400.0, 400.0, 0.0])).unwrap();
    let mut first = None;
    sim.control_step_with([1.0_f32, 0.0], ActionMode::Relative, |sim, _| {
        first.get_or_insert((sim.position(BodyId::Agent), sim.velocity(BodyId::Agent)));
    });
    assert_eq!(first, Some(([201.0, 200.0], [100.0, 0.0])));
}

#[test]
fn a_free_polygon_agent_covers_one_percent_of_its_way_per_substep() {
    let mut sim = Sim::new(&Setup { agent: body(Shape::L, 30.0), ..Setup::default() }).unwrap();
    sim.place_exactly(&Placement::from([100.0, 300.0, 400.0, 400.0, 0.0])).unwrap();
    sim.control_step([1.0_f64, 0.0], ActionMode::Relative);
    assert_near(sim.position(BodyId::Agent), [100.0 + 100.0 * (1.0 - 0.99_f64.powi(10)), 300.0], 1e-11);
    assert_eq!(sim.velocity(BodyId::Agent), [0.0, 0.0]);
}

#[test]
fn an_absolute_action_is_a_place() {
    let mut sim = Sim::new(&Setup::default()).unwrap();
    sim.place_exactly(&Placement::from([200.0, 200.0, 400.0, 400.0, 0.0])).unwrap();
    for _ in 0..60 {
        sim.control_step([120.0_f64, 90.0], ActionMode::Absolute);
    }
    assert_near(sim.position(BodyId::Agent), [120.0, 90.0], 1e-9);
}

#[test]
fn placing_puts_the_origin_and_not_the_center_of_gravity() {
    let mut sim = Sim::new(&Setup::default()).unwrap();
    sim.place(&Placement::from([100.0, 100.0, 300.0, 200.0, std::f64::consts::FRAC_PI_2])).unwrap();
    assert_near(sim.position(BodyId::Block), [300.0, 200.0], 1e-12);
    assert_near(sim.center_of_gravity(BodyId::Block), [255.0, 200.0], 1e-12);
    let corners: Vec<_> = sim.corners(BodyId::Block).collect();
    assert_eq!(corners.len(), 2);
    assert_near(corners[0][0], [300.0, 140.0], 1e-12);
    assert_near(corners[1][2], [180.0, 215.0], 1e-12);
}

#[test]
fn the_agents_velocity_acts_for_the_substep_of_the_reset() {
    let mut sim = Sim::new(&Setup::default()).unwrap();
    let start = Placement::from([200.0, 200.0, 400.0, 400.0, 0.0, 100.0, 0.0]);
    sim.place(&start).unwrap();
    sim.substep();
    assert_near(sim.position(BodyId::Agent), [201.0, 200.0], 1e-12);
}

#[test]
fn only_the_exact_placement_forgets_what_the_last_pose_caused() {
    let overlapping = Placement::from([262.0, 300.0, 300.0, 300.0, 0.0]);
    let apart = Placement::from([100.0, 100.0, 300.0, 300.0, 0.0]);
    let mut sim = disc_and_square(&overlapping);
    sim.substep();
    let mut exact = sim.clone();
    sim.place(&apart).unwrap();
    sim.substep();
    assert!(sim.position(BodyId::Block)[0] > 300.0);
    exact.place_exactly(&apart).unwrap();
    assert_eq!(exact.contact_points(), 0);
    exact.substep();
    assert_eq!(exact.position(BodyId::Block), [300.0, 300.0]);
}

#[test]
fn settling_finds_contacts_without_moving() {
    let overlapping = Placement::from([259.0, 300.0, 300.0, 300.0, 0.0]);
    let mut settled = disc_and_square(&overlapping);
    assert_eq!(settled.settle(), 1);
    assert_eq!((settled.contact_points(), settled.position(BodyId::Block)), (1, [300.0, 300.0]));
    settled.substep();
    assert_near(
        settled.position(BodyId::Block),
        [300.0 + OVERLAP_REMOVED * (4.0 - ALLOWED_OVERLAP), 300.0],
        1e-12,
    );
}

#[test]
fn walls_hold_the_block_but_not_the_disc() {
    let mut sim = disc_and_square(&Placement::from([400.0, 250.0, 460.0, 250.0, 0.0]));
    for _ in 0..40 {
        sim.control_step([1.0_f32, 0.0], ActionMode::Relative);
    }
    assert!(sim.position(BodyId::Agent)[0] > 600.0);
    let right = sim.corners(BodyId::Block).flatten().map(|[x, _]| x).fold(0.0, f64::max);
    assert!(right < 506.0, "the block reaches {right}");
}

#[test]
fn the_center_of_gravity_can_be_moved() {
    let setup = Setup { block_cog: Some([0.0, 0.0]), ..Setup::default() };
    let mut sim = Sim::new(&setup).unwrap();
    sim.place_exactly(&Placement::from([100.0, 100.0, 300.0, 200.0, 1.0])).unwrap();
    assert_eq!(sim.center_of_gravity(BodyId::Block), [300.0, 200.0]);
    let mut default = Sim::new(&Setup::default()).unwrap();
    default.place_exactly(&Placement::from([100.0, 100.0, 300.0, 200.0, 1.0])).unwrap();
    for (a, b) in sim.corners(BodyId::Block).flatten().zip(default.corners(BodyId::Block).flatten()) {
        assert_near(a, b, 1e-12);
    }
}

#[test]
fn damping_lets_the_block_slide_on() {
    let slide = |damping: f64| {
        let block = body(Shape::Square, 30.0);
        let mut sim = Sim::new(&Setup { block, damping, ..Setup::default() }).unwrap();
        sim.place_exactly(&Placement::from([200.0, 300.0, 270.0, 300.0, 0.0])).unwrap();
        for _ in 0..4 {
            sim.control_step([0.5_f32, 0.0], ActionMode::Relative);
        }
        for _ in 0..3 {
            sim.control_step([-1.0_f32, 0.0], ActionMode::Relative);
        }
        (sim.position(BodyId::Block)[0], sim.velocity(BodyId::Block)[0])
    };
    let (stopped, sliding) = (slide(0.0), slide(0.5));
    assert_eq!(stopped.1, 0.0);
    assert!(sliding.1 > 0.0 && sliding.0 > stopped.0, "{stopped:?} {sliding:?}");
}

#[test]
fn placements_that_are_not_finite_change_nothing() {
    let mut sim = Sim::new(&Setup::default()).unwrap();
    let before = sim.clone();
    let error = sim.place(&Placement::from([f64::NAN, 0.0, 300.0, 200.0, 1.0])).unwrap_err();
    assert_eq!(error.to_string(), "the agent's position is not finite; give a number in pixels or radians");
    let error = sim.place_exactly(&Placement::from([0.0, 0.0, 300.0, 200.0, f64::INFINITY])).unwrap_err();
    assert!(error.to_string().starts_with("the block's angle"));
    assert_eq!(sim, before);
}

#[test]
fn contacts_are_counted_as_a_mean_rounded_up() {
    assert_eq!([0, 1, 10, 11, 25].map(contact_count), [0, 1, 1, 2, 3]);
}
