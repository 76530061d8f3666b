//! A point that walks in the plane to a goal, past round obstacles. Ways left and right of an obstacle are local minima.

use crate::control::{ControlModel, Stage};

/// p' = p + stride × tanh(u).
///
/// A walk costs the squared distance to the goal after every step, more at the end, a little for every action, and
/// its obstacles.
#[derive(Clone, Debug, PartialEq)]
pub struct Navigation {
    /// The longest step along each axis.
    pub stride: f64,
    /// Weight of the squared action.
    pub effort: f64,
    /// Weight of the squared distance to the goal after every step.
    pub distance: f64,
    /// What is added to that weight at the end.
    pub end_distance: f64,
    /// What stands in the way.
    pub obstacles: Vec<Obstacle>,
    /// How obstacles count.
    pub obstacles_are: Obstacles,
    /// `[n][2]`: start and goal of episodes; episode `b` of a problem is `b % n`.
    pub ways: Vec<[[f64; 2]; 2]>,
}

/// A round obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// Its center.
    pub center: [f64; 2],
    /// Its radius.
    pub radius: f64,
}

/// How obstacles count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Obstacles {
    /// Every step costs weight × exp(-d² / (2 radius²)) at distance d of the center: a hill that can be crossed.
    Penalties {
        /// Height of the hill.
        weight: f64,
    },
    /// A step must not end inside: radius² - d² is a constraint of every step and obstacle, in that order.
    Constraints,
}

impl Navigation {
    /// The reference's test problem, with H = 10: one soft obstacle, four ways.
    pub fn past_one_obstacle() -> Self {
        Self {
            stride: 0.2,
            effort: 0.01,
            distance: 1.0,
            end_distance: 5.0,
            obstacles: vec![Obstacle { center: [0.55, 0.45], radius: 0.05_f64.sqrt() }],
            obstacles_are: Obstacles::Penalties { weight: 5.0 },
            ways: WAYS.to_vec(),
        }
    }

    fn goal(&self, episode: usize) -> [f64; 2] {
        self.ways[episode % self.ways.len()][1]
    }

    /// Weight of the squared distance to the goal at a stage; the start is free.
    fn distance_at(&self, at: &Stage<'_>) -> f64 {
        match (at.step, at.is_last()) {
            (0, false) => 0.0,
            (_, false) => self.distance,
            (0, true) => self.end_distance,
            (_, true) => self.distance + self.end_distance,
        }
    }

    /// Weight of the hills at a stage.
    fn hill_at(&self, at: &Stage<'_>) -> Option<f64> {
        match self.obstacles_are {
            Obstacles::Penalties { weight } if at.step > 0 => Some(weight),
            _ => None,
        }
    }
}

/// Start and goal of the reference's four walks.
pub(super) const WAYS: [[[f64; 2]; 2]; 4] = [
    [[0.0, 0.0], [1.2, 1.0]],
    [[0.0, 0.3], [1.0, -0.8]],
    [[-0.5, -0.2], [1.0, 0.4]],
    [[0.2, 0.6], [-1.0, -0.6]],
];

/// From `q` to `p`.
fn away(p: &[f64], q: &[f64]) -> [f64; 2] {
    [p[0] - q[0], p[1] - q[1]]
}

fn square([x, y]: [f64; 2]) -> f64 {
    x * x + y * y
}

impl Obstacle {
    /// Height, gradient and curvature of a hill of height 1.
    fn hill(&self, place: &[f64]) -> (f64, [f64; 2], [[f64; 2]; 2]) {
        let [x, y] = away(place, &self.center);
        let scale = 1.0 / (self.radius * self.radius);
        let height = (-0.5 * scale * square([x, y])).exp();
        let curvature = |a: f64, b: f64, same: f64| height * scale * (scale * a * b - same);
        let gradient = [-scale * x * height, -scale * y * height];
        (
            height,
            gradient,
            [[curvature(x, x, 1.0), curvature(x, y, 0.0)], [curvature(y, x, 0.0), curvature(y, y, 1.0)]],
        )
    }
}

impl ControlModel for Navigation {
    fn state_dim(&self) -> usize {
        2
    }

    fn action_dim(&self) -> usize {
        2
    }

    fn start(&self, episode: usize, state: &mut [f64]) {
        state.copy_from_slice(&self.ways[episode % self.ways.len()][0]);
    }

    fn step(&self, at: &Stage<'_>, next: &mut [f64]) {
        for ((next, place), action) in next.iter_mut().zip(at.state).zip(at.action) {
            *next = place + self.stride * action.tanh();
        }
    }

    fn cost(&self, at: &Stage<'_>) -> f64 {
        let mut cost = self.distance_at(at) * square(away(at.state, &self.goal(at.episode)));
        if let Some(weight) = self.hill_at(at) {
            cost += self.obstacles.iter().map(|o| weight * o.hill(at.state).0).sum::<f64>();
        }
        cost + at.action.iter().map(|u| self.effort * u * u).sum::<f64>()
    }

    fn step_derivatives(&self, at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        by_state.copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
        by_action.fill(0.0);
        for (axis, action) in at.action.iter().enumerate() {
            let tanh = action.tanh();
            by_action[3 * axis] = self.stride * (1.0 - tanh * tanh);
        }
        true
    }

    fn cost_derivatives(&self, at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        let distance = away(at.state, &self.goal(at.episode));
        by_state.copy_from_slice(&distance.map(|d| 2.0 * self.distance_at(at) * d));
        if let Some(weight) = self.hill_at(at) {
            for obstacle in &self.obstacles {
                let (_, gradient, _) = obstacle.hill(at.state);
                by_state.iter_mut().zip(gradient).for_each(|(sum, gradient)| *sum += weight * gradient);
            }
        }
        by_action.iter_mut().zip(at.action).for_each(|(out, u)| *out = 2.0 * self.effort * u);
        true
    }

    fn cost_hessian(&self, at: &Stage<'_>, hessian: &mut [f64]) -> bool {
        let size = at.state.len() + at.action.len();
        hessian.fill(0.0);
        for index in 0..size {
            let weight = if index < 2 { self.distance_at(at) } else { self.effort };
            hessian[index * (size + 1)] = 2.0 * weight;
        }
        if let Some(weight) = self.hill_at(at) {
            for obstacle in &self.obstacles {
                let (_, _, curvature) = obstacle.hill(at.state);
                for (out, curvature) in hessian.chunks_exact_mut(size).zip(curvature) {
                    out.iter_mut().zip(curvature).for_each(|(sum, value)| *sum += weight * value);
                }
            }
        }
        true
    }

    fn constraints(&self) -> usize {
        if self.obstacles_are == Obstacles::Constraints { self.obstacles.len() } else { 0 }
    }

    fn constrain(&self, _episode: usize, _action: &[f64], next: &[f64], values: &mut [f64]) {
        for (value, obstacle) in values.iter_mut().zip(&self.obstacles) {
            *value = obstacle.radius * obstacle.radius - square(away(next, &obstacle.center));
        }
    }

    fn add_constraint_derivatives(
        &self,
        _episode: usize,
        _action: &[f64],
        next: &[f64],
        weights: &[f64],
        by_next: &mut [f64],
        _by_action: &mut [f64],
    ) -> bool {
        for (weight, obstacle) in weights.iter().zip(&self.obstacles) {
            let away = away(next, &obstacle.center);
            by_next.iter_mut().zip(away).for_each(|(sum, away)| *sum -= 2.0 * weight * away);
        }
        true
    }
}
