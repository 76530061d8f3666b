//! Linear-quadratic control: a linear system, a cost that is a sum of squares. The one problem whose best plan is known
//! in closed form.

use crate::control::{ControlModel, Stage};

/// x' = M x + B u at a cost of Σ q x² + r u² over the steps and Σ q_end x² at the end.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearQuadratic {
    /// M: `[W, W]`.
    pub transition: Vec<f64>,
    /// B: `[W, A]`.
    pub input: Vec<f64>,
    /// q: `[W]`: what the square of each state value costs at every step, the first included, the end not.
    pub state_weights: Vec<f64>,
    /// q_end: `[W]`: what it costs at the end.
    pub end_weights: Vec<f64>,
    /// r: `[A]`: what the square of each action value costs.
    pub action_weights: Vec<f64>,
    /// `[n][W]`: where episodes start; episode `b` of a problem starts at `b % n`.
    pub starts: Vec<Vec<f64>>,
}

impl LinearQuadratic {
    /// A point mass in the plane with friction: state x, y and their velocities, which the action pushes. To be driven
    /// to rest at the origin. The reference's test problem, with H = 10.
    pub fn point_mass() -> Self {
        #[rustfmt::skip]
        let transition = vec![
            1.0, 0.0, 0.1, 0.0,
            0.0, 1.0, 0.0, 0.1,
            0.0, 0.0, 0.95, 0.0,
            0.0, 0.0, 0.0, 0.95,
        ];
        let starts =
            [[1.0, 0.0, 0.0, 0.0], [-0.5, 0.8, 0.2, -0.1], [0.3, -1.2, 0.0, 0.5], [1.5, 1.5, -1.0, 0.0]];
        Self {
            transition,
            input: vec![0.05, 0.0, 0.0, 0.05, 1.0, 0.0, 0.0, 1.0],
            state_weights: vec![1.0, 1.0, 0.1, 0.1],
            end_weights: vec![10.0, 10.0, 1.0, 1.0],
            action_weights: vec![0.05; 2],
            starts: starts.map(|start| start.to_vec()).to_vec(),
        }
    }

    fn weights(&self, at: &Stage<'_>) -> &[f64] {
        if at.is_last() { &self.end_weights } else { &self.state_weights }
    }
}

fn weighted_square(values: &[f64], weights: &[f64]) -> f64 {
    values.iter().zip(weights).map(|(value, weight)| weight * value * value).sum()
}

impl ControlModel for LinearQuadratic {
    fn state_dim(&self) -> usize {
        self.state_weights.len()
    }

    fn action_dim(&self) -> usize {
        self.action_weights.len()
    }

    fn start(&self, episode: usize, state: &mut [f64]) {
        state.copy_from_slice(&self.starts[episode % self.starts.len()]);
    }

    fn step(&self, at: &Stage<'_>, next: &mut [f64]) {
        let rows = self.transition.chunks_exact(at.state.len()).zip(self.input.chunks_exact(at.action.len()));
        for (next, (by_state, by_action)) in next.iter_mut().zip(rows) {
            *next = dot(by_state, at.state) + dot(by_action, at.action);
        }
    }

    fn cost(&self, at: &Stage<'_>) -> f64 {
        weighted_square(at.state, self.weights(at)) + weighted_square(at.action, &self.action_weights)
    }

    fn step_derivatives(&self, _at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        by_state.copy_from_slice(&self.transition);
        by_action.copy_from_slice(&self.input);
        true
    }

    fn cost_derivatives(&self, at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        let parts = [(by_state, at.state, self.weights(at)), (by_action, at.action, &self.action_weights)];
        for (out, values, weights) in parts {
            for ((out, value), weight) in out.iter_mut().zip(values).zip(weights) {
                *out = 2.0 * weight * value;
            }
        }
        true
    }

    fn cost_hessian(&self, at: &Stage<'_>, hessian: &mut [f64]) -> bool {
        let size = at.state.len() + at.action.len();
        hessian.fill(0.0);
        let weights = self.weights(at).iter().chain(&self.action_weights).take(size);
        for (index, weight) in weights.enumerate() {
            hessian[index * (size + 1)] = 2.0 * weight;
        }
        true
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
