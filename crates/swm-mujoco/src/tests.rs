//! The owners at work together, small enough for `cargo xtask memcheck`, which runs these under valgrind.

use std::sync::Arc;

use super::*;
use crate::assets;
use crate::error::MujocoError;

const MODELS: &[&str] = &["cheetah.xml", "acrobot.xml", "quadruped.xml"];

fn spec(name: &str) -> Spec {
    let mut spec = Spec::read(&assets::suite_model(name).unwrap()).unwrap();
    spec.shrink_textures();
    spec
}

fn model(name: &str) -> Arc<Model> {
    Arc::new(spec(name).compile().unwrap())
}

fn simulation(name: &str) -> Simulation {
    let mut sim = Simulation::new(model(name)).unwrap();
    sim.reset();
    sim.forward().unwrap();
    sim
}

#[test]
fn a_saved_state_goes_on_with_the_same_bits() {
    for name in MODELS {
        let mut sim = simulation(name);
        sim.ctrl_mut().fill(0.3);
        sim.control_step(3).unwrap();
        let mut saved = Vec::new();
        sim.save(&mut saved);
        let mut other = Simulation::new(Arc::clone(sim.model())).unwrap();
        other.load(&saved).unwrap();
        for sim in [&mut sim, &mut other] {
            sim.control_step(2).unwrap();
        }
        assert_eq!(sim.qpos(), other.qpos(), "{name}");
        assert_eq!(sim.sensordata(), other.sensordata(), "{name}");
        assert!(matches!(other.load(&saved[1..]), Err(MujocoError::StateSize { .. })), "{name}");
    }
}

#[test]
fn a_simulation_outlives_every_other_holder_of_its_model() {
    let model = model("cheetah.xml");
    let mut sim = Simulation::new(Arc::clone(&model)).unwrap();
    drop(model);
    sim.forward().unwrap();
    sim.model_mut().body_mass_mut()[1] *= 2.0;
    sim.model_mut().set_constants().unwrap();
    sim.control_step(2).unwrap();
}

#[test]
fn an_edit_of_a_shared_model_is_a_copys() {
    let shared = model("cheetah.xml");
    let mut sim = Simulation::new(Arc::clone(&shared)).unwrap();
    sim.model_mut().geom_rgba_mut().fill(0.25);
    assert!(shared.geom_rgba().iter().any(|value| *value != 0.25));
    assert!(sim.model().geom_rgba().iter().all(|value| *value == 0.25));
}

#[test]
fn another_models_structure_makes_a_new_state() {
    let mut sim = simulation("cheetah.xml");
    sim.set_model(model("cheetah.xml")).unwrap();
    sim.forward().unwrap();
    sim.set_model(model("quadruped.xml")).unwrap();
    sim.forward().unwrap();
    assert_eq!(sim.qpos().len(), sim.model().nq());
}

#[test]
fn a_state_that_is_not_finite_is_an_error_and_a_reset_fixes_it() {
    let mut sim = simulation("cheetah.xml");
    sim.qpos_mut()[0] = f64::NAN;
    let error = sim.control_step(2).unwrap_err();
    assert!(error.to_string().contains("position"), "{error}");
    sim.reset();
    sim.forward().unwrap();
    sim.control_step(2).unwrap();
    assert!(sim.qpos().iter().all(|value| value.is_finite()));
}

#[test]
fn a_description_is_edited_and_compiled_again() {
    let mut spec = spec("quadruped.xml");
    let before = spec.compile().unwrap();
    spec.delete(Object::Body, "ball").unwrap();
    spec.delete_rangefinders().unwrap();
    spec.geom("floor").unwrap().set_size([10.0, 10.0, 0.5]);
    let after = spec.compile().unwrap();
    assert!(after.nq() < before.nq());
    let floor = after.id(Object::Geom, "floor").unwrap();
    assert_eq!(after.geom_size()[3 * floor], 10.0);
    assert!(matches!(spec.delete(Object::Body, "ball"), Err(MujocoError::NoObject { .. })));
}

#[test]
fn what_cannot_be_read_or_compiled_is_an_error_with_mujocos_reason() {
    let file = tempfile::NamedTempFile::with_suffix(".xml").unwrap();
    std::fs::write(file.path(), "<mujoco><worldbody><geom size=\"1\"></worldbody></mujoco>").unwrap();
    assert!(matches!(Spec::read(file.path()), Err(MujocoError::Model { .. })));
    std::fs::write(file.path(), "<mujoco><worldbody><geom name=\"a\" size=\"1\"/></worldbody></mujoco>")
        .unwrap();
    let mut spec = Spec::read(file.path()).unwrap();
    spec.compile().unwrap();
    spec.geom("a").unwrap().set_size([-1.0, 0.0, 0.0]);
    let error = spec.compile().unwrap_err();
    assert!(error.to_string().contains("size"), "{error}");
    spec.geom("a").unwrap().set_size([2.0, 0.0, 0.0]);
    spec.compile().unwrap();
}

#[test]
fn every_camera_sees_a_scene() {
    for name in MODELS {
        let mut sim = simulation(name);
        for camera in 0..sim.model().ncam() {
            let mut scene = Scene::new(Arc::clone(sim.model()), camera).unwrap();
            scene.update(&mut sim).unwrap();
            sim.control_step(1).unwrap();
            scene.update(&mut sim).unwrap();
            assert!(scene.geom_count() > 0, "{name}, camera {camera}");
        }
    }
    let mut scene = Scene::new(model("cheetah.xml"), 0).unwrap();
    assert!(matches!(scene.update(&mut simulation("quadruped.xml")), Err(MujocoError::Scene)));
    assert!(matches!(Scene::new(model("cheetah.xml"), 99), Err(MujocoError::NoCamera { count: 2, .. })));
}

#[test]
fn simulations_of_one_model_run_on_many_threads() {
    let model = model("cheetah.xml");
    let run = || {
        let mut sim = Simulation::new(Arc::clone(&model)).unwrap();
        sim.forward().unwrap();
        sim.ctrl_mut().fill(-0.5);
        sim.control_step(5).unwrap();
        sim.qpos().to_vec()
    };
    let expected = run();
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..3).map(|_| scope.spawn(run)).collect();
        for thread in threads {
            assert_eq!(thread.join().unwrap(), expected);
        }
    });
}
