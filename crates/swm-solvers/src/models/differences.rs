//! Derivatives of a control model: its own where it has them, finite differences where not.

use super::control::{ControlModel, Stage};

/// Step of first differences, relative to numbers above 1: rounding errors and the neglected curvature balance at
/// the cube root of the machine's precision.
const FINE: f64 = 6e-6;
/// Step of second differences: they balance at the fourth root.
const COARSE: f64 = 1.2e-4;

/// Derivatives of a [`ControlModel`].
#[derive(Debug)]
pub(crate) struct Differentiator<'s> {
    /// `[4, W + A]`: the stage with one number moved back, and with it moved ahead; results at those two points.
    scratch: &'s mut [f64],
}

impl<'s> Differentiator<'s> {
    /// How many numbers of `scratch` it needs for `numbers` = W + A.
    pub(crate) fn scratch_size(numbers: usize) -> usize {
        4 * numbers
    }

    /// With room to work in.
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
        self.move_each(at, |index, width, [back, ahead], [behind, before]| {
            model.step(&back, &mut behind[..w]);
            model.step(&ahead, &mut before[..w]);
            let (column, stride, out) =
                if index < w { (index, w, &mut *by_state) } else { (index - w, a, &mut *by_action) };
            for (row, (before, behind)) in before[..w].iter().zip(&behind[..w]).enumerate() {
                out[row * stride + column] = (before - behind) / width;
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
        self.move_each(at, |index, width, [back, ahead], _| {
            let slope = (model.cost(&ahead) - model.cost(&back)) / width;
            if index < w {
                by_state[index] = slope;
            } else {
                by_action[index - w] = slope;
            }
        });
    }

    /// As [`ControlModel::cost_hessian`], always: differences of the first derivatives if those are given, second
    /// differences of the cost otherwise.
    pub(crate) fn hessian(&mut self, model: &dyn ControlModel, at: &Stage<'_>, hessian: &mut [f64]) {
        if model.cost_hessian(at, hessian) {
            return;
        }
        let (w, numbers) = (at.state.len(), at.state.len() + at.action.len());
        let mut given = true;
        self.move_each(at, |index, width, [back, ahead], [behind, before]| {
            for (stage, out) in [(&back, &mut *behind), (&ahead, &mut *before)] {
                let (by_state, by_action) = out.split_at_mut(w);
                given = given && model.cost_derivatives(stage, by_state, by_action);
            }
            for (column, (before, behind)) in before.iter().zip(&*behind).enumerate() {
                hessian[index * numbers + column] = (before - behind) / width;
            }
        });
        if given {
            symmetrize(hessian, numbers);
        } else {
            self.second_differences(model, at, hessian);
        }
    }

    /// Calls `visit(index, width, [back, ahead], results)` for every number of state and action, with stages where that
    /// number is moved back and ahead, `width` apart, and room for a result of each.
    fn move_each(
        &mut self,
        at: &Stage<'_>,
        mut visit: impl FnMut(usize, f64, [Stage<'_>; 2], [&mut [f64]; 2]),
    ) {
        let (w, numbers) = (at.state.len(), at.state.len() + at.action.len());
        let ([back, ahead], [behind, before]) = self.halves(numbers);
        for point in [&mut *back, &mut *ahead] {
            point[..w].copy_from_slice(at.state);
            point[w..].copy_from_slice(at.action);
        }
        for index in 0..numbers {
            let old = back[index];
            let step = FINE * old.abs().max(1.0);
            (back[index], ahead[index]) = (old - step, old + step);
            // What rounding has made of two steps.
            let width = ahead[index] - back[index];
            let stages = [stage_of(at, back, w), stage_of(at, ahead, w)];
            visit(index, width, stages, [&mut *behind, &mut *before]);
            (back[index], ahead[index]) = (old, old);
        }
    }

    /// Mixed second differences of the cost.
    fn second_differences(&mut self, model: &dyn ControlModel, at: &Stage<'_>, hessian: &mut [f64]) {
        let (w, numbers) = (at.state.len(), at.state.len() + at.action.len());
        let ([point, _], _) = self.halves(numbers);
        point[..w].copy_from_slice(at.state);
        point[w..].copy_from_slice(at.action);
        for i in 0..numbers {
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
                hessian[i * numbers + j] = second;
                hessian[j * numbers + i] = second;
            }
        }
    }

    /// The two points and the two results, for `numbers` = W + A.
    fn halves(&mut self, numbers: usize) -> ([&mut [f64]; 2], [&mut [f64]; 2]) {
        let (points, results) = self.scratch[..4 * numbers].split_at_mut(2 * numbers);
        let (a, b) = points.split_at_mut(numbers);
        let (c, d) = results.split_at_mut(numbers);
        ([a, b], [c, d])
    }
}

fn stage_of<'p>(at: &Stage<'_>, point: &'p [f64], state_width: usize) -> Stage<'p> {
    let (state, action) = point.split_at(state_width);
    Stage { row: at.row, step: at.step, state, action }
}

fn symmetrize(matrix: &mut [f64], width: usize) {
    for i in 0..width {
        for j in 0..i {
            let mean = 0.5 * (matrix[i * width + j] + matrix[j * width + i]);
            matrix[i * width + j] = mean;
            matrix[j * width + i] = mean;
        }
    }
}
