//! The rewarded goal of PushT: seven values, a success test, a reward, and a cost for planners.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::engine::Engine;
use super::physics::{BodyId, Shape};

/// Agent x, y; block x, y (its origin, not its center of gravity); block angle; agent velocity x, y. Pixels,
/// radians, pixels per second.
pub type PushTState = [f64; 7];

/// Agent and block together may be this far off, in pixels.
const POSITION_TOLERANCE: f64 = 20.0;
/// The block may be turned by this much, in radians.
const ANGLE_TOLERANCE: f64 = PI / 9.0;

/// The state of a simulation as it is observed: the angle in `[0, 2π)`.
pub fn observed_state(sim: &impl Engine) -> PushTState {
    let ([x, y], [bx, by]) = (sim.position(BodyId::Agent), sim.position(BodyId::Block));
    let [vx, vy] = sim.velocity(BodyId::Agent);
    [x, y, bx, by, sim.angle(BodyId::Block).rem_euclid(TAU), vx, vy]
}

/// The angle by which a shape looks the same.
fn symmetry(shape: Shape) -> f64 {
    match shape {
        Shape::Square | Shape::Plus => FRAC_PI_2,
        Shape::I | Shape::Z => PI,
        _ => TAU,
    }
}

/// The smallest turn that takes one angle to the other, up to the shape's symmetry, in radians.
pub fn angle_error(shape: Shape, goal_rad: f64, angle_rad: f64) -> f64 {
    let period = symmetry(shape);
    let difference = (goal_rad - angle_rad).abs().rem_euclid(period);
    difference.min(period - difference)
}

/// Whether the goal is reached: agent and block within 20 px together, and the block within 20 degrees.
pub fn is_success(shape: Shape, goal: &PushTState, state: &PushTState) -> bool {
    distance(&goal[..4], &state[..4]) < POSITION_TOLERANCE
        && angle_error(shape, goal[4], state[4]) < ANGLE_TOLERANCE
}

/// The reference's reward: minus the distance over all seven values, units mixed.
pub fn reward(goal: &PushTState, state: &PushTState) -> f64 {
    -distance(goal, state)
}

/// How far the task is from done, in pixels: the block's distance from its goal, where a radian counts 50 px, and, at
/// a lower weight, how far the agent is from where it is useful next: at the block while that is out of place, at its
/// own goal once it is not. The second part leads planners to contact, without which nothing they try has an effect.
pub fn task_cost(sim: &impl Engine, goal: &PushTState) -> f64 {
    /// Pixels that a radian counts.
    const ANGLE_WEIGHT: f64 = 50.0;
    const AGENT_WEIGHT: f64 = 0.3;
    /// Above this block error, in pixels, the agent belongs at the block.
    const OUT_OF_PLACE: f64 = 40.0;
    let state = observed_state(sim);
    let angle = angle_error(sim.shape(BodyId::Block), goal[4], state[4]);
    let block = distance(&goal[2..4], &state[2..4]) + ANGLE_WEIGHT * angle;
    let to_block = distance(&sim.center_of_gravity(BodyId::Block), &state[..2]);
    let to_goal = distance(&goal[..2], &state[..2]);
    let pushing = (block / OUT_OF_PLACE).min(1.0);
    block + AGENT_WEIGHT * (pushing * to_block + (1.0 - pushing) * to_goal)
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_wrap_by_the_symmetry_of_the_shape() {
        assert!(
            (angle_error(Shape::T, -3.0, 4.0) - 0.717).abs() < 1e-3,
            "the reference's test passes this pair"
        );
        assert!(angle_error(Shape::Square, 0.1, 0.1 + PI) < 1e-12);
        assert!((angle_error(Shape::I, 0.0, 3.0) - (PI - 3.0)).abs() < 1e-12);
        assert!(angle_error(Shape::T, 0.05, TAU - 0.05) < 0.1 + 1e-12);
    }

    #[test]
    fn success_counts_agent_and_block_together() {
        let goal = [100.0, 100.0, 200.0, 200.0, 0.0, 0.0, 0.0];
        let off = |agent: f64, block: f64, angle: f64| {
            [100.0 + agent, 100.0, 200.0, 200.0 + block, angle, 9.0, 9.0]
        };
        assert!(is_success(Shape::T, &goal, &off(14.0, 14.0, 0.3)));
        assert!(!is_success(Shape::T, &goal, &off(15.0, 14.0, 0.3)));
        assert!(!is_success(Shape::T, &goal, &off(0.0, 0.0, 0.35)));
    }
}
