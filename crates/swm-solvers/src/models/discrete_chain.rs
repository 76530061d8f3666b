//! A walk by categories: every step is one of a few given moves. Small enough to try all plans.

use super::navigation::WAYS;
use crate::control::{ControlModel, Stage};

/// p' = p + Σ a_c × move_c, where a is one-hot, or a mixture of categories while a solver relaxes them.
#[derive(Clone, Debug, PartialEq)]
pub struct DiscreteChain {
    /// `[C][2]`: the moves.
    pub moves: Vec<[f64; 2]>,
    /// Weight of the squared distance to the goal after every step.
    pub distance: f64,
    /// What is added to that weight at the end.
    pub end_distance: f64,
    /// `[n][2]`: start and goal of episodes; episode `b` of a problem is `b % n`.
    pub ways: Vec<[[f64; 2]; 2]>,
}

impl DiscreteChain {
    /// The reference's test problem, with H = 6: stay, or a quarter right, left, up or down.
    pub fn quarter_steps() -> Self {
        Self {
            moves: vec![[0.0, 0.0], [0.25, 0.0], [-0.25, 0.0], [0.0, 0.25], [0.0, -0.25]],
            distance: 0.1,
            end_distance: 1.0,
            ways: WAYS.to_vec(),
        }
    }

    /// The best plan of `horizon` categories for `episode`, the first of equals, and its cost: found by trying all
    /// C^H plans.
    pub fn enumerate(&self, episode: usize, horizon: usize) -> (Vec<usize>, f64) {
        let mut plan = vec![0; horizon];
        let mut best = (plan.clone(), f64::INFINITY);
        if self.moves.is_empty() {
            return best;
        }
        loop {
            let cost = self.cost_of(episode, &plan);
            if cost < best.1 {
                best = (plan.clone(), cost);
            }
            // Counts up, the last category fastest.
            let Some(index) = plan.iter().rposition(|&category| category + 1 < self.moves.len()) else {
                return best;
            };
            plan[index] += 1;
            plan[index + 1..].fill(0);
        }
    }

    /// The cost of a plan of categories, `[H]`, in `episode`.
    pub fn cost_of(&self, episode: usize, plan: &[usize]) -> f64 {
        let [mut place, goal] = self.ways[episode % self.ways.len()];
        let mut cost = 0.0;
        for (step, &category) in plan.iter().enumerate() {
            place = [place[0] + self.moves[category][0], place[1] + self.moves[category][1]];
            let weight =
                if step + 1 == plan.len() { self.distance + self.end_distance } else { self.distance };
            cost += weight * square(place, goal);
        }
        cost
    }

    fn weight(&self, at: &Stage<'_>) -> f64 {
        match (at.step, at.is_last()) {
            (0, _) => 0.0,
            (_, false) => self.distance,
            (_, true) => self.distance + self.end_distance,
        }
    }
}

fn square(p: [f64; 2], q: [f64; 2]) -> f64 {
    (p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1])
}

impl ControlModel for DiscreteChain {
    fn state_dim(&self) -> usize {
        2
    }

    fn action_dim(&self) -> usize {
        self.moves.len()
    }

    fn start(&self, episode: usize, state: &mut [f64]) {
        state.copy_from_slice(&self.ways[episode % self.ways.len()][0]);
    }

    fn step(&self, at: &Stage<'_>, next: &mut [f64]) {
        next.copy_from_slice(at.state);
        for (part, step) in at.action.iter().zip(&self.moves) {
            next.iter_mut().zip(step).for_each(|(sum, value)| *sum += part * value);
        }
    }

    fn cost(&self, at: &Stage<'_>) -> f64 {
        let goal = self.ways[at.episode % self.ways.len()][1];
        self.weight(at) * square([at.state[0], at.state[1]], goal)
    }

    fn step_derivatives(&self, _at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        by_state.copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
        for (axis, values) in by_action.chunks_exact_mut(self.moves.len()).enumerate() {
            values.iter_mut().zip(&self.moves).for_each(|(out, step)| *out = step[axis]);
        }
        true
    }

    fn cost_derivatives(&self, at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        let goal = self.ways[at.episode % self.ways.len()][1];
        for ((out, place), goal) in by_state.iter_mut().zip(at.state).zip(goal) {
            *out = 2.0 * self.weight(at) * (place - goal);
        }
        by_action.fill(0.0);
        true
    }

    fn cost_hessian(&self, at: &Stage<'_>, hessian: &mut [f64]) -> bool {
        let size = at.state.len() + at.action.len();
        hessian.fill(0.0);
        for index in 0..2 {
            hessian[index * (size + 1)] = 2.0 * self.weight(at);
        }
        true
    }
}
