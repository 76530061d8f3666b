//! Derivatives of a control model: analytic where it has them, finite differences elsewhere.

use crate::control::{ControlModel, Stage};

/// Step of first differences, relative to values above 1: rounding errors and the neglected curvature balance at
/// the cube root of the machine's precision.
const FINE: f64 = 6e-6;
/// Step of second differences: they balance at the fourth root.
const COARSE: f64 = 1.2e-4;

/// Derivatives of a [`ControlModel`].
#[derive(Debug)]
pub(crate) struct Differentiator<'s> {
    /// `[4, W + A]`: the stage with one value decreased, and with it increased; results at these two points.
    scratch: &'s mut [f64],
}

impl<'s> Differentiator<'s> {
    /// Values of `scratch` that it needs for `size` = W + A.
    pub(crate) fn scratch_size(size: usize) -> usize {
        4 * size
    }

    /// With scratch.
    pub(crate) fn new(scratch: &'s mut [f64]) -> Self {
        Self { scratch }
    }

    /// As [`ControlModel::step_derivatives`], always.
    pub(crate) fn step(
        &mut self,
        model: &dyn ControlModel,
        at: &Stage<'_>,
        by_state: &mut [f64],
        by_action: &mut [f64],
    ) {
        if model.step_derivatives(at, by_state, by_action) {
            return;
        }
        let (w, a) = (at.state.len(), at.action.len());
        self.move_each(at, |index, distance, [back, ahead], [behind, before]| {
            model.step(&back, &mut behind[..w]);
            model.step(&ahead, &mut before[..w]);
            let (column, stride, out) =
                if index < w { (index, w, &mut *by_state) } else { (index - w, a, &mut *by_action) };
            for (row, (before, behind)) in before[..w].iter().zip(&behind[..w]).enumerate() {
                out[row * stride + column] = (before - behind) / distance;
            }
        });
    }

    /// As [`ControlModel::cost_derivatives`], always.
    pub(crate) fn cost(
        &mut self,
        model: &dyn ControlModel,
        at: &Stage<'_>,
        by_state: &mut [f64],
        by_action: &mut [f64],
    ) {
        if model.cost_derivatives(at, by_state, by_action) {
            return;
        }
        let w = at.state.len();
        self.move_each(at, |index, distance, [back, ahead], _| {
            let derivative = (model.cost(&ahead) - model.cost(&back)) / distance;
            if index < w {
                by_state[index] = derivative;
            } else {
                by_action[index - w] = derivative;
            }
        });
    }

    /// As [`ControlModel::add_constraint_derivatives`], always. `at` has the action of a step and the state that it leads to;
    /// `values`, `[2, C]`, is scratch.
    pub(crate) fn add_constraints(
        &mut self,
        model: &dyn ControlModel,
        at: &Stage<'_>,
        weights: &[f64],
        values: &mut [f64],
        (by_next, by_action): (&mut [f64], &mut [f64]),
    ) {
        let Stage { episode, state: next, action, .. } = *at;
        if model.add_constraint_derivatives(episode, action, next, weights, by_next, by_action) {
            return;
        }
        let w = next.len();
        let (behind, before) = values.split_at_mut(weights.len());
        self.move_each(at, |index, distance, [back, ahead], _| {
            model.constrain(episode, back.action, back.state, behind);
            model.constrain(episode, ahead.action, ahead.state, before);
            let values = weights.iter().zip(before.iter().zip(&*behind));
            let sum: f64 = values.map(|(weight, (before, behind))| weight * (before - behind)).sum();
            let out = if index < w { &mut by_next[index] } else { &mut by_action[index - w] };
            *out += sum / distance;
        });
    }

    /// As [`ControlModel::cost_hessian`], always: differences of the first derivatives if those are given, second
    /// differences of the cost otherwise.
    pub(crate) fn hessian(&mut self, model: &dyn ControlModel, at: &Stage<'_>, hessian: &mut [f64]) {
        if model.cost_hessian(at, hessian) {
            return;
        }
        let (w, size) = (at.state.len(), at.state.len() + at.action.len());
        let mut given = true;
        self.move_each(at, |index, distance, [back, ahead], [behind, before]| {
            for (stage, out) in [(&back, &mut *behind), (&ahead, &mut *before)] {
                let (by_state, by_action) = out.split_at_mut(w);
                given = given && model.cost_derivatives(stage, by_state, by_action);
            }
            for (column, (before, behind)) in before.iter().zip(&*behind).enumerate() {
                hessian[index * size + column] = (before - behind) / distance;
            }
        });
        if given {
            symmetrize(hessian, size);
        } else {
            self.second_differences(model, at, hessian);
        }
    }

    /// Calls `visit(index, distance, [back, ahead], results)` for every value of state and action, with stages where that
    /// value is decreased and increased, `distance` apart, and room for a result of each.
    fn move_each(
        &mut self,
        at: &Stage<'_>,
        mut visit: impl FnMut(usize, f64, [Stage<'_>; 2], [&mut [f64]; 2]),
    ) {
        let (w, size) = (at.state.len(), at.state.len() + at.action.len());
        let ([back, ahead], [behind, before]) = self.halves(size);
        for point in [&mut *back, &mut *ahead] {
            point[..w].copy_from_slice(at.state);
            point[w..].copy_from_slice(at.action);
        }
        for index in 0..size {
            let old = back[index];
            let step = FINE * old.abs().max(1.0);
            (back[index], ahead[index]) = (old - step, old + step);
            // The actual distance after rounding.
            let distance = ahead[index] - back[index];
            let stages = [stage_of(at, back, w), stage_of(at, ahead, w)];
            visit(index, distance, stages, [&mut *behind, &mut *before]);
            (back[index], ahead[index]) = (old, old);
        }
    }

    /// Mixed second differences of the cost.
    fn second_differences(&mut self, model: &dyn ControlModel, at: &Stage<'_>, hessian: &mut [f64]) {
        let (w, size) = (at.state.len(), at.state.len() + at.action.len());
        let ([point, _], _) = self.halves(size);
        point[..w].copy_from_slice(at.state);
        point[w..].copy_from_slice(at.action);
        for i in 0..size {
            for j in 0..=i {
                let (old_i, old_j) = (point[i], point[j]);
                let (step_i, step_j) = (COARSE * old_i.abs().max(1.0), COARSE * old_j.abs().max(1.0));
                let mut sum = 0.0;
                for (sign_i, sign_j) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                    point[i] += sign_i * step_i;
                    point[j] += sign_j * step_j;
                    sum += sign_i * sign_j * model.cost(&stage_of(at, point, w));
                    (point[i], point[j]) = (old_i, old_j);
                }
                let second = sum / (4.0 * step_i * step_j);
                hessian[i * size + j] = second;
                hessian[j * size + i] = second;
            }
        }
    }

    /// The two points and the two results, for `size` = W + A.
    fn halves(&mut self, size: usize) -> ([&mut [f64]; 2], [&mut [f64]; 2]) {
        let (points, results) = self.scratch[..4 * size].split_at_mut(2 * size);
        let (a, b) = points.split_at_mut(size);
        let (c, d) = results.split_at_mut(size);
        ([a, b], [c, d])
    }
}

fn stage_of<'p>(at: &Stage<'_>, point: &'p [f64], state_dim: usize) -> Stage<'p> {
    let (state, action) = point.split_at(state_dim);
    Stage { episode: at.episode, step: at.step, state, action }
}

/// Replaces a matrix `[n, n]` by the mean of itself and its transpose.
pub(crate) fn symmetrize(matrix: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..i {
            let mean = 0.5 * (matrix[i * n + j] + matrix[j * n + i]);
            matrix[i * n + j] = mean;
            matrix[j * n + i] = mean;
        }
    }
}
