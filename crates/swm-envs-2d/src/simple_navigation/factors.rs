//! The factors of SimpleNavigation and their constraints.

use swm_fov::{Constraint, Factor, Fov, FovSpace};

use super::maze::{Cell, Maze, SIDE};

/// The factor table, in sampling order. Cells are column and row, directions 0 right, 1 down, 2 left, 3 up.
pub(super) fn factors() -> FovSpace {
    let cell =
        |name: &str, default: Cell| Factor::integers(name, 1, SIDE as i64 - 2, &default).sampled_by_default();
    let direction = |name: &str| Factor::integer(name, 0, 3, 0).sampled_by_default();
    let probability = |name: &str| Factor::scalar(name, 0.0, 1.0, 0.5).sampled_by_default();
    let space = FovSpace::new(vec![
        Factor::integer("maze.seed", 0, i64::from(i32::MAX), 0)
            .doc("which of the mazes of these probabilities")
            .sampled_by_default(),
        probability("maze.p_horizontal")
            .doc("probability of a passage between neighbors in a row that are not connected yet"),
        probability("maze.p_vertical").doc("probability of a further passage to the next row"),
        cell("agent.position", [1, 1]).doc("column and row where the agent starts"),
        direction("agent.direction").doc("where the agent looks at the start: 0 right, 1 down, 2 left, 3 up"),
        cell("goal.position", [SIDE as i64 - 2; 2]).doc("column and row of the goal"),
        direction("goal.agent.direction").doc("where the agent of the goal image and of `goal_state` looks"),
    ]);
    const MAZE: &[&str] = &["maze.seed", "maze.p_horizontal", "maze.p_vertical"];
    const FREE: &str = "no wall (cells of odd column and row never are)";
    let agent_is_free = Constraint {
        owner: "agent.position",
        reads: MAZE,
        words: FREE,
        holds: |fov| maze(fov).is_free(fov.vector("agent.position")),
    };
    let goal_is_free = Constraint {
        owner: "goal.position",
        reads: MAZE,
        words: FREE,
        holds: |fov| maze(fov).is_free(fov.vector("goal.position")),
    };
    let they_differ = Constraint {
        owner: "goal.position",
        reads: &["agent.position"],
        words: "another cell than agent.position",
        holds: |fov| fov.vector::<i64, 2>("goal.position") != fov.vector::<i64, 2>("agent.position"),
    };
    space.with_constraints(vec![agent_is_free, goal_is_free, they_differ])
}

/// The maze of an assignment.
pub(super) fn maze(fov: &Fov) -> Maze {
    Maze::new(fov.i64("maze.seed"), fov.f64("maze.p_horizontal"), fov.f64("maze.p_vertical"))
}
