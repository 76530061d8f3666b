//! The factors of TablePush3D and their constraints.

use swm_fov::{Constraint, Factor, Fov, FovSpace};

use super::body::Object;

/// Room between pusher and object at the start, m.
const CLEARANCE: f64 = 0.01;
/// A goal is at least so far from the start of the object, m.
const LEAST_WAY: f64 = 0.1;

/// The factor table, in sampling order. Recorded starts and goals need not meet the constraints.
pub(super) fn factors() -> FovSpace {
    let position = |name: &str, reach: f64, default: [f64; 2]| {
        Factor::vector(name, -reach, reach, &default).sampled_by_default()
    };
    let space = FovSpace::new(vec![
        Factor::integer("object.shape", 0, 2, 0)
            .choices(&["box", "cylinder", "cross"])
            .doc("0 a box, 1 a cylinder, 2 a cross"),
        Factor::scalar("object.size", 0.03, 0.06, 0.04).doc("half the width of the object, m"),
        Factor::scalar("object.mass", 0.05, 0.4, 0.2).doc("mass of the object, kg"),
        Factor::scalar("object.friction", 0.2, 1.0, 0.5)
            .doc("coefficient of friction of the object; contacts take the mean of two bodies"),
        Factor::scalar("object.restitution", 0.0, 0.8, 0.1)
            .doc("share of the speed with which the object bounces off the pusher"),
        position("object.position", 0.25, [0.0, 0.0]).doc("start x, y of the object, m"),
        Factor::scalar("object.angle", -std::f64::consts::PI, std::f64::consts::PI, 0.0)
            .doc("start angle of the object about the vertical, rad")
            .sampled_by_default(),
        Factor::rgb("object.color", [214, 84, 48]).doc("color of the object"),
        position("goal.position", 0.25, [0.2, 0.1]).doc("x, y of the goal, m"),
        Factor::scalar("goal.radius", 0.02, 0.06, 0.04)
            .doc("the object is at the goal if its middle is within this distance, m"),
        Factor::rgb("goal.color", [74, 170, 96]).doc("color of the goal"),
        Factor::scalar("pusher.radius", 0.015, 0.03, 0.02).doc("radius of the pusher, m"),
        Factor::scalar("pusher.speed", 0.2, 0.6, 0.4).doc("speed of the pusher at full action, m/s"),
        Factor::scalar("pusher.force", 4.0, 12.0, 6.0).doc("greatest force of the pusher's motor, N"),
        position("pusher.position", 0.4, [-0.4, 0.0]).doc("start x, y of the pusher, m"),
        Factor::rgb("pusher.color", [65, 105, 225]).doc("color of the pusher"),
        Factor::scalar("table.friction", 0.2, 1.0, 0.5).doc("coefficient of friction of the table"),
        Factor::rgb("table.color", [222, 205, 180]).doc("color of the table"),
        Factor::scalar("world.gravity", 5.0, 15.0, 9.81).doc("gravity, m/s²"),
        Factor::scalar("camera.azimuth", -30.0, 30.0, 0.0)
            .doc("direction of the camera about the vertical, degrees"),
        Factor::scalar("camera.elevation", 35.0, 80.0, 55.0)
            .doc("angle of the camera above the table, degrees"),
        Factor::scalar("camera.distance", 1.0, 1.6, 1.2)
            .doc("distance of the camera from the middle of the table, m"),
        Factor::scalar("light.intensity", 0.3, 1.0, 0.6).doc("brightness of the lamp"),
        Factor::scalar("light.azimuth", -180.0, 180.0, 40.0)
            .doc("where the lamp's light comes from, degrees"),
        Factor::rgb("background.color", [196, 216, 236]).doc("color of what is around the table"),
    ]);
    space.with_constraints(vec![
        Constraint {
            owner: "goal.position",
            reads: &["object.position"],
            words: "at least 0.1 m from object.position",
            holds: |fov| way(fov, "object.position", "goal.position") >= LEAST_WAY,
        },
        Constraint {
            owner: "pusher.position",
            reads: &["object.shape", "object.size", "object.mass", "object.position", "pusher.radius"],
            words: "clear of the object",
            holds: |fov| {
                let room = way(fov, "object.position", "pusher.position");
                room >= Object::new(fov).reach() + fov.f64("pusher.radius") + CLEARANCE
            },
        },
    ])
}

/// The distance between two positions.
fn way(fov: &Fov, from: &str, to: &str) -> f64 {
    let [from, to]: [[f64; 2]; 2] = [from, to].map(|name| fov.vector(name));
    let [x, y] = [from[0] - to[0], from[1] - to[1]];
    (x * x + y * y).sqrt()
}
