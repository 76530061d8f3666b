//! The agent follows the pointer: which action moves it where in the image is measured, not declared.

use serde::Serialize;
use swm_core::env::Episode;
use swm_core::{EnvConfig, EnvEntry, EnvState, EpisodeSeed, ResetOptions, Space, Value};
use swm_tasks::request::TaskError;

/// How actions of two values follow from the pointer.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Steer {
    /// Actions are positions: the pointer's own, in the bounds of the action.
    Position { low: [f64; 2], high: [f64; 2] },
    /// Actions are displacements or velocities of the first keypoint.
    Follow {
        /// The action per fraction of the image, `[action, image]`.
        action_from_image: [[f64; 2]; 2],
        low: [f64; 2],
        high: [f64; 2],
    },
}

/// An agent that keeps moving after the action would overshoot under the full action.
const GAIN_WITH_INERTIA: f64 = 0.35;
/// Starts that are tried: at a wall the agent does not move.
const STARTS: u64 = 4;

impl Steer {
    /// What moves the first keypoint; `None`: nothing does, or its actions are others.
    ///
    /// # Errors
    ///
    /// The environment cannot be made or stepped.
    pub(super) fn measure(entry: &EnvEntry, config: &EnvConfig) -> Result<Option<Self>, TaskError> {
        let config = EnvConfig { image: None, settings: config.settings.clone() };
        let mut env = entry.make(&config)?;
        let space = env.spec().action.clone();
        let Space::Box { dtype, shape, .. } = &space else { return Ok(None) };
        let (low, high) = space.bounds();
        let ([low0, low1], [high0, high1]) = (&low[..], &high[..]) else { return Ok(None) };
        let (low, high) = ([*low0, *low1], [*high0, *high1]);
        if low.iter().chain(&high).any(|bound| !bound.is_finite()) {
            return Ok(None);
        }
        let options = ResetOptions::default();
        for seed in 0..STARTS {
            env.reset(&Episode::new(EpisodeSeed::new(seed), &options))?;
            if env.keypoints().is_empty() {
                return Ok(None);
            }
            if low.iter().all(|&low| low >= 0.0) {
                return Ok(Some(Self::Position { low, high }));
            }
            let mut start = EnvState::new();
            env.snapshot(&mut start)?;
            // Two steps: the action, and none.
            let mut moved = |action: [f64; 2]| -> Result<[[f64; 2]; 2], TaskError> {
                env.restore(&start)?;
                let from = env.keypoints()[0].at;
                let mut moved = [[0.0; 2]; 2];
                for (moved, action) in moved.iter_mut().zip([action, [0.0; 2]]) {
                    let action = Value::vector(&action).cast("action", *dtype, shape)?;
                    env.step(action.data.as_slice())?;
                    let at = env.keypoints()[0].at;
                    *moved = [at[0] - from[0], at[1] - from[1]];
                }
                Ok(moved)
            };
            let size = [0.5 * high[0], 0.5 * high[1]];
            let still = moved([0.0; 2])?;
            let along = [moved([size[0], 0.0])?, moved([0.0, size[1]])?];
            // image_from_action, [image, action].
            let change = |step: usize, image: usize, action: usize| {
                (along[action][step][image] - still[step][image]) / size[action]
            };
            let [a, b, c, d] = [change(0, 0, 0), change(0, 0, 1), change(0, 1, 0), change(0, 1, 1)];
            let determinant = a * d - b * c;
            let scale = a.abs().max(b.abs()).max(c.abs()).max(d.abs());
            if determinant.is_nan() || determinant.abs() <= 0.05 * scale * scale {
                continue;
            }
            let later = (0..2).map(|action| change(1, 0, action).hypot(change(1, 1, action))).sum::<f64>();
            let first = (0..2).map(|action| change(0, 0, action).hypot(change(0, 1, action))).sum::<f64>();
            let gain = if later > 1.1 * first { GAIN_WITH_INERTIA } else { 1.0 };
            let inverse = [[d, -b], [-c, a]].map(|row| row.map(|value| gain * value / determinant));
            return Ok(Some(Self::Follow { action_from_image: inverse, low, high }));
        }
        Ok(None)
    }

    /// The action that moves the agent from `agent` to `pointer`, fractions of the image both.
    pub(super) fn action(&self, agent: [f64; 2], pointer: [f64; 2]) -> [f64; 2] {
        match self {
            Self::Position { low, high } => {
                [0, 1].map(|i| low[i] + (high[i] - low[i]) * pointer[i].clamp(0.0, 1.0))
            }
            Self::Follow { action_from_image, low, high } => {
                let way = [pointer[0] - agent[0], pointer[1] - agent[1]];
                let wanted = action_from_image.map(|row| row[0] * way[0] + row[1] * way[1]);
                // The direction stays where the length is cut.
                let excess =
                    [0, 1].map(|i| (wanted[i] / if wanted[i] < 0.0 { low[i] } else { high[i] }).abs());
                let cut = excess[0].max(excess[1]).max(1.0);
                wanted.map(|value| value / cut)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_way_keeps_its_direction() {
        let action_from_image = [[10.0, 0.0], [0.0, 10.0]];
        let steer = Steer::Follow { action_from_image, low: [-1.0; 2], high: [1.0; 2] };
        assert_eq!(steer.action([0.5, 0.5], [0.9, 0.3]), [1.0, -0.5]);
        assert_eq!(steer.action([0.5, 0.5], [0.55, 0.5]).map(|v| (v * 1e6).round() / 1e6), [0.5, 0.0]);
    }

    #[test]
    fn positions_are_the_pointer_in_the_bounds_of_the_action() {
        let steer = Steer::Position { low: [0.0, 100.0], high: [512.0, 300.0] };
        assert_eq!(steer.action([0.0; 2], [0.5, 1.5]), [256.0, 300.0]);
    }
}
