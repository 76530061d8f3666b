//! What may differ between episodes.

use swm_fov::{Constraint, Factor, FovSpace};

/// Success: the puck's center is at most this far from the mark, in rinks.
pub(crate) const REACH: f64 = 0.05;

/// The factor table. Places are in rinks: 0 to 1, x to the right and y down.
pub fn factors() -> FovSpace {
    let place = |name: &str, default: [f64; 2]| Factor::vector(name, 0.1, 0.9, &default).sampled_by_default();
    FovSpace::new(vec![
        Factor::rgb("ice.color", [214, 234, 248]).doc("color of the ice"),
        Factor::scalar("ice.friction", 0.0, 2.0, 0.5)
            .doc("share of its speed that the puck loses per second"),
        Factor::rgb("puck.color", [33, 47, 61]).doc("color of the puck"),
        Factor::scalar("puck.mass", 0.5, 2.0, 1.0).doc("how hard it is to push"),
        place("puck.start_position", [0.25, 0.25]).doc("where the puck lies at first, at rest"),
        Factor::rgb("mark.color", [203, 67, 53]).doc("color of the mark"),
        place("mark.position", [0.75, 0.75]).doc("where the puck shall come to lie"),
    ])
    .with_constraints(vec![Constraint {
        owner: "mark.position",
        reads: &["puck.start_position"],
        words: "out of reach of the puck's start",
        holds: |fov| {
            let [mark, puck] =
                ["mark.position", "puck.start_position"].map(|name| fov.vector::<f64, 2>(name));
            (mark[0] - puck[0]).hypot(mark[1] - puck[1]) > 2.0 * REACH
        },
    }])
}
