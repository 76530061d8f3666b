//! The model of a table, composed from OGBench's files: arm, gripper, objects, cameras. Equal to the reference's compiled
//! model in every array but names and paths of files; the order of attachments is what makes indices equal.

use super::layout::{Kind, PURPLE, SPACING};
use swm_mujoco::MujocoError;
use swm_mujoco::assets::manipulation_model;
use swm_mujoco::{Model, Object, Spec};

/// The description, with everything that images need.
pub(super) fn description(kind: Kind) -> Result<Spec, MujocoError> {
    let mut root = read("floor_wall.xml")?;
    root.set_extent([0.3, 0.0, 0.15], 0.7, 0.04, [0.1, 10.0]);
    root.set_implicit_and_elliptic(10.0);
    // Bodies stand in the order in which they are added; meshes and materials in the order in which they are attached,
    // and the reference has those of the objects before those of the arm.
    root.add_body("world", "ur5e/", [0.0; 3], UPRIGHT)?;
    add_objects(&mut root, kind)?;
    root.attach("ur5e/", arm()?, "ur5e/")?;
    for (name, position, xy_axes) in kind.cameras() {
        root.add_camera(name, position, xy_axes)?;
    }
    let bounds = kind.bounds();
    let [low, high] = bounds.object.map(|[x, y]| [x, y, 0.02]);
    root.add_box_site("object_bounds", [low, high], [0.6, 0.3, 0.3, 0.2], NEVER_DRAWN)?;
    root.add_box_site("arm_bounds", bounds.arm, [0.3, 0.6, 0.3, 0.2], NEVER_DRAWN)?;
    Ok(root)
}

const UPRIGHT: [f64; 4] = [1.0, 0.0, 0.0, 0.0];
const NEVER_DRAWN: i32 = 4;

fn read(file: &str) -> Result<Spec, MujocoError> {
    Spec::read(&manipulation_model(file)?)
}

/// The arm with the gripper at its flange.
fn arm() -> Result<Spec, MujocoError> {
    let mut arm = read("universal_robots_ur5e/ur5e.xml")?;
    arm.delete_all(Object::Light)?;
    arm.delete_all(Object::Key)?;
    let mut gripper = read("robotiq_2f85/2f85.xml")?;
    gripper.delete_all(Object::Key)?;
    // The pose of the arm's site `attachment_site`.
    arm.add_body("wrist_3_link", "robotiq/", [0.0, 0.1, 0.0], [-1.0, 1.0, 0.0, 0.0])?;
    arm.attach("robotiq/", gripper, "robotiq/")?;
    Ok(arm)
}

fn add_objects(root: &mut Spec, kind: Kind) -> Result<(), MujocoError> {
    match kind {
        Kind::Cubes(count) => {
            for (index, y) in row_of_cubes(count).enumerate() {
                root.attach("world", cube(index, y)?, "")?;
            }
        }
        Kind::Scene => {
            for file in ["cube.xml", "buttons.xml", "drawer.xml", "window.xml"] {
                root.attach("world", read(file)?, "")?;
            }
        }
    }
    Ok(())
}

/// Where the cubes of a row stand: y, m.
pub(super) fn row_of_cubes(count: usize) -> impl Iterator<Item = f64> {
    (0..count).map(move |index| SPACING * index as f64 - SPACING / 2.0 * (count as f64 - 1.0))
}

/// A cube and the marker of its goal, numbered.
fn cube(index: usize, y: f64) -> Result<Spec, MujocoError> {
    let mut cube = read("cube.xml")?;
    cube.body("object_0")?.set_position([0.3, y, 0.02]);
    cube.body("object_target_0")?.set_position([0.45, y, 0.02]);
    let names = [
        (Object::Body, "object_0"),
        (Object::Body, "object_target_0"),
        (Object::Joint, "object_joint_0"),
        (Object::Geom, "object_0"),
        (Object::Geom, "target_object_0"),
        (Object::Site, "com_0"),
    ];
    for (kind, name) in names {
        let stem = name.trim_end_matches('0');
        cube.rename(kind, name, &format!("{stem}{index}"))?;
    }
    Ok(cube)
}

/// What the reference edits after compiling: the arm's gains, and the arm's looks, which hide the cube less where it is
/// `transparent`.
pub(super) fn finish(model: &mut Model, transparent: bool) -> Result<(), MujocoError> {
    const STIFFNESS: [f64; 6] = [4500.0, 4500.0, 4500.0, 2000.0, 2000.0, 500.0];
    const ARM: [&str; 6] = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"];
    for (name, stiffness) in ARM.iter().zip(STIFFNESS) {
        let actuator = 10 * model.id(Object::Actuator, &format!("ur5e/{name}"))?;
        model.actuator_gainprm_mut()[actuator] = stiffness;
        // The third gain has no effect on actuators of this kind; it is set because the reference sets it.
        model.actuator_gainprm_mut()[actuator + 2] = -stiffness / 10.0;
        model.actuator_biasprm_mut()[actuator + 1] = -stiffness;
    }
    let mut paint = |name: &str, rgb: Option<[f64; 3]>, alpha: f32| {
        let material = 4 * model.id(Object::Material, name)?;
        let rgba = &mut model.mat_rgba_mut()[material..material + 4];
        for (channel, value) in rgba.iter_mut().zip(rgb.into_iter().flatten()) {
            *channel = value as f32;
        }
        if transparent {
            rgba[3] = alpha;
        }
        Ok::<(), MujocoError>(())
    };
    for name in GRIPPER_MATERIALS {
        paint(name, Some(PURPLE), if name.ends_with("pad_gray") { 0.5 } else { 0.1 })?;
    }
    for name in
        ["robotiq/metal", "robotiq/silicone", "robotiq/gray", "black", "jointgray", "linkgray", "lightblue"]
    {
        paint(&format!("ur5e/{name}"), None, 0.1)?;
    }
    Ok(())
}

/// The materials that have the agent's color.
pub(super) const GRIPPER_MATERIALS: [&str; 2] = ["ur5e/robotiq/black", "ur5e/robotiq/pad_gray"];
