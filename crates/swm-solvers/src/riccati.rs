//! One step of iterative LQR on one plan: expansion of the problem around it, Riccati recursion backward, line search
//! forward.

use std::mem::MaybeUninit;

use faer::dyn_stack::MemStack;
use faer::linalg::cholesky::llt::{factor, solve};
use faer::linalg::matmul::matmul;
use faer::{Accum, Conj, MatMut, MatRef, Par};

use crate::control::{ControlModel, Stage};
use crate::models::{Differentiator, symmetrize};

/// Constants of the regularization.
pub(crate) struct Regularization;

impl Regularization {
    /// It is multiplied by this when a step fails, and divided when one succeeds.
    pub(crate) const FACTOR: f64 = 10.0;
    /// With more of it, steps are negligible.
    pub(crate) const LARGEST: f64 = 1e10;
}

/// One plan of T actions of A values through states of W values, its derivatives, and scratch.
pub(crate) struct Trajectory<'s> {
    model: &'s dyn ControlModel,
    episode: usize,
    steps: usize,
    w: usize,
    a: usize,
    /// `[T, A]`: bounds.
    low: &'s [f32],
    high: &'s [f32],
    /// `[T + 1, W]`: where the plan leads, and where a changed one does.
    states: &'s mut [f64],
    other_states: &'s mut [f64],
    /// `[T, A]`: the changed plan.
    other_actions: &'s mut [f64],
    /// `[T, W, W + A]`: derivatives of each step.
    jacobians: &'s mut [f64],
    /// `[T + 1, W + A]`: derivatives of the cost of each stage.
    gradients: &'s mut [f64],
    /// `[T + 1, W + A, W + A]`: second ones; the last holds `[W, W]`.
    hessians: &'s mut [f64],
    /// `[T, A, W + 1]`: feedback gains, and in the last column the feedforward step.
    gains: &'s mut [f64],
    /// `[W, W]` and `[W]`: value of a state, by its second and first derivatives.
    value: &'s mut [f64],
    value_gradient: &'s mut [f64],
    /// `[W, W + A]`.
    product: &'s mut [f64],
    /// `[W + A, W + A]` and `[W + A]`: the same of state and action together.
    q: &'s mut [f64],
    q_gradient: &'s mut [f64],
    /// `[A, A]`: curvature of the actions, to be factorized.
    factor: &'s mut [f64],
    /// `[A, W + 1]`: curvature times gains.
    curved: &'s mut [f64],
    differences: &'s mut [f64],
}

/// Bytes of stack that a factorization may take.
const STACK: usize = 8192;

impl<'s> Trajectory<'s> {
    /// The widest action whose factorization fits into its stack.
    pub(crate) const MOST_ACTIONS: usize = 512;

    fn lengths(steps: usize, w: usize, a: usize) -> [usize; 15] {
        let n = w + a;
        [
            (steps + 1) * w,
            (steps + 1) * w,
            steps * a,
            steps * w * n,
            (steps + 1) * n,
            (steps + 1) * n * n,
            steps * a * (w + 1),
            w * w,
            w,
            w * n,
            n * n,
            n,
            a * a,
            a * (w + 1),
            Differentiator::scratch_size(n),
        ]
    }

    /// Values of scratch that it needs.
    pub(crate) fn scratch_size(steps: usize, w: usize, a: usize) -> usize {
        Self::lengths(steps, w, a).iter().sum()
    }

    /// For a plan of `episode`, with bounds `[T, A]`.
    pub(crate) fn new(
        scratch: &'s mut [f64],
        (model, episode): (&'s dyn ControlModel, usize),
        (steps, w, a): (usize, usize, usize),
        [low, high]: [&'s [f32]; 2],
    ) -> Self {
        let mut rest = scratch;
        let [
            states,
            other_states,
            other_actions,
            jacobians,
            gradients,
            hessians,
            gains,
            value,
            value_gradient,
            product,
            q,
            q_gradient,
            factor,
            curved,
            differences,
        ] = Self::lengths(steps, w, a).map(|length| {
            let (slice, tail) = std::mem::take(&mut rest).split_at_mut(length);
            rest = tail;
            slice
        });
        Self {
            model,
            episode,
            steps,
            w,
            a,
            low,
            high,
            states,
            other_states,
            other_actions,
            jacobians,
            gradients,
            hessians,
            gains,
            value,
            value_gradient,
            product,
            q,
            q_gradient,
            factor,
            curved,
            differences,
        }
    }

    /// The cost of `actions`, `[T, A]`; stores its states.
    pub(crate) fn roll_out(&mut self, actions: &[f64]) -> f64 {
        let Self { model, episode, steps, w, a, states, .. } = self;
        model.start(*episode, &mut states[..*w]);
        let mut sum = 0.0;
        for step in 0..=*steps {
            let (past, future) = states.split_at_mut((step + 1) * *w);
            let action = actions.get(step * *a..(step + 1) * *a).unwrap_or(&[]);
            let at = Stage { episode: *episode, step, state: &past[step * *w..], action };
            sum += model.cost(&at);
            if step < *steps {
                model.step(&at, &mut future[..*w]);
            }
        }
        sum
    }

    /// Derivatives of everything along the last rollout, which was that of `actions`.
    pub(crate) fn expand(&mut self, actions: &[f64]) {
        let (steps, w, a) = (self.steps, self.w, self.a);
        let n = w + a;
        let mut differentiator = Differentiator::new(self.differences);
        for step in 0..=steps {
            let action = actions.get(step * a..(step + 1) * a).unwrap_or(&[]);
            let at = Stage { episode: self.episode, step, state: &self.states[step * w..][..w], action };
            let size = w + action.len();
            let gradient = &mut self.gradients[step * n..][..size];
            let (by_state, by_action) = gradient.split_at_mut(w);
            differentiator.cost(self.model, &at, by_state, by_action);
            differentiator.hessian(self.model, &at, &mut self.hessians[step * n * n..][..size * size]);
            if step == steps {
                break;
            }
            // Two matrices become one, row by row.
            let (by_state, by_action) = self.product.split_at_mut(w * w);
            differentiator.step(self.model, &at, by_state, by_action);
            let rows = self.jacobians[step * w * n..][..w * n].chunks_exact_mut(n);
            let parts = by_state.chunks_exact(w).zip(by_action.chunks_exact(a));
            for (row, (by_state, by_action)) in rows.zip(parts) {
                row[..w].copy_from_slice(by_state);
                row[w..].copy_from_slice(by_action);
            }
        }
    }

    /// Gains for all steps, with `weight` added to the curvature of the actions; false if that curvature is not positive
    /// somewhere.
    pub(crate) fn solve_backward(&mut self, actions: &[f64], weight: f64) -> bool {
        let (steps, w, a) = (self.steps, self.w, self.a);
        let n = w + a;
        self.value.copy_from_slice(&self.hessians[steps * n * n..][..w * w]);
        self.value_gradient.copy_from_slice(&self.gradients[steps * n..][..w]);
        for step in (0..steps).rev() {
            self.expand_value(step);
            let gains = &mut self.gains[step * a * (w + 1)..][..a * (w + 1)];
            let limits = |index: usize| (self.low[step * a + index], self.high[step * a + index]);
            for i in 0..a {
                for j in 0..a {
                    self.factor[i * a + j] = self.q[(w + i) * n + w + j];
                }
                self.factor[i * a + i] += weight;
                gains[i * (w + 1)..][..w].iter_mut().zip(&self.q[(w + i) * n..]).for_each(|(g, q)| *g = -q);
                gains[i * (w + 1) + w] = -self.q_gradient[w + i];
            }
            for i in 0..a {
                // An action that is at its bound and pushes beyond stays there, whatever the others do.
                let (action, push) = (actions[step * a + i], -self.q_gradient[w + i]);
                let (low, high) = limits(i);
                if (action <= low.into() && push < 0.0) || (action >= high.into() && push > 0.0) {
                    for j in 0..a {
                        self.factor[i * a + j] = 0.0;
                        self.factor[j * a + i] = 0.0;
                    }
                    self.factor[i * a + i] = 1.0;
                    gains[i * (w + 1)..][..w + 1].fill(0.0);
                }
            }
            if !solve_positive(self.factor, gains, a, w + 1) {
                return false;
            }
            self.update_value(step);
        }
        true
    }

    /// Value of state and action at `step`, from the value of the state after it.
    fn expand_value(&mut self, step: usize) {
        let (w, n) = (self.w, self.w + self.a);
        let jacobian = MatRef::from_row_major_slice(&self.jacobians[step * w * n..][..w * n], w, n);
        self.q.copy_from_slice(&self.hessians[step * n * n..][..n * n]);
        self.q_gradient.copy_from_slice(&self.gradients[step * n..][..n]);
        multiply(
            matrix(self.product, w, n),
            Accum::Replace,
            MatRef::from_row_major_slice(self.value, w, w),
            jacobian,
        );
        let product = MatRef::from_row_major_slice(self.product, w, n);
        multiply(matrix(self.q, n, n), Accum::Add, jacobian.transpose(), product);
        let gradient = MatRef::from_row_major_slice(self.value_gradient, w, 1);
        multiply(matrix(self.q_gradient, n, 1), Accum::Add, jacobian.transpose(), gradient);
    }

    /// The value of the state at `step` under the gains: with G = [K k],
    /// V = Qxx + Kᵀ Quu K + Kᵀ Qux + Quxᵀ K, and the same with k for the gradient.
    fn update_value(&mut self, step: usize) {
        let (w, a) = (self.w, self.a);
        let (n, g) = (w + a, w + 1);
        let gains = MatRef::from_row_major_slice(&self.gains[step * a * g..][..a * g], a, g);
        let q = MatRef::from_row_major_slice(&*self.q, n, n);
        let (q_ux, q_uu) = (q.submatrix(w, 0, a, w), q.submatrix(w, w, a, a));
        multiply(matrix(self.curved, a, g), Accum::Replace, q_uu, gains);
        let curved = MatRef::from_row_major_slice(&*self.curved, a, g);
        let by_state = gains.submatrix(0, 0, a, w);
        for i in 0..w {
            self.value[i * w..][..w].copy_from_slice(&self.q[i * n..][..w]);
        }
        self.value_gradient.copy_from_slice(&self.q_gradient[..w]);
        multiply(matrix(self.value, w, w), Accum::Add, by_state.transpose(), curved.submatrix(0, 0, a, w));
        multiply(matrix(self.value, w, w), Accum::Add, by_state.transpose(), q_ux);
        multiply(matrix(self.value, w, w), Accum::Add, q_ux.transpose(), by_state);
        let q_u = MatRef::from_row_major_slice(&self.q_gradient[w..], a, 1);
        multiply(
            matrix(self.value_gradient, w, 1),
            Accum::Add,
            by_state.transpose(),
            curved.submatrix(0, w, a, 1),
        );
        multiply(matrix(self.value_gradient, w, 1), Accum::Add, by_state.transpose(), q_u);
        multiply(
            matrix(self.value_gradient, w, 1),
            Accum::Add,
            q_ux.transpose(),
            gains.submatrix(0, w, a, 1),
        );
        symmetrize(self.value, w);
    }

    /// The cheapest of shorter and shorter steps that is cheaper than `cost`, if any is: replaces `actions` and returns
    /// its cost.
    pub(crate) fn search(&mut self, actions: &mut [f64], cost: f64) -> Option<f64> {
        let mut length = 1.0;
        for _ in 0..HALVINGS {
            let found = self.line_step(actions, length);
            if found < cost {
                actions.copy_from_slice(self.other_actions);
                return Some(found);
            }
            length *= 0.5;
        }
        None
    }

    /// The cost of `actions` changed by the gains, with a step of `length`.
    fn line_step(&mut self, actions: &[f64], length: f64) -> f64 {
        let Self {
            model, episode, steps, w, a, low, high, states, other_states, other_actions, gains, ..
        } = self;
        let (w, a, episode) = (*w, *a, *episode);
        other_states[..w].copy_from_slice(&states[..w]);
        let mut sum = 0.0;
        for step in 0..*steps {
            let (past, future) = other_states.split_at_mut((step + 1) * w);
            let state = &past[step * w..];
            let changed = &mut other_actions[step * a..][..a];
            let gains = gains[step * a * (w + 1)..].chunks_exact(w + 1);
            for (index, (changed, gains)) in changed.iter_mut().zip(gains).enumerate() {
                let differences = state.iter().zip(&states[step * w..]).map(|(new, old)| new - old);
                let feedback: f64 = gains.iter().zip(differences).map(|(gain, x)| gain * x).sum();
                let at = step * a + index;
                let value = actions[at] + length * gains[w] + feedback;
                *changed = value.max(low[at].into()).min(high[at].into());
            }
            let at = Stage { episode, step, state, action: changed };
            sum += model.cost(&at);
            model.step(&at, &mut future[..w]);
        }
        sum + model.cost(&Stage { episode, step: *steps, state: &other_states[*steps * w..], action: &[] })
    }
}

/// How often a step is halved before it is given up.
const HALVINGS: usize = 12;

fn matrix(values: &mut [f64], rows: usize, columns: usize) -> MatMut<'_, f64> {
    MatMut::from_row_major_slice_mut(values, rows, columns)
}

fn multiply(out: MatMut<'_, f64>, accumulate: Accum, left: MatRef<'_, f64>, right: MatRef<'_, f64>) {
    matmul(out, accumulate, left, right, 1.0, Par::Seq);
}

/// Replaces `right`, `[n, columns]`, by the solution of `left` × solution = right; false if `left`, `[n, n]`, which is
/// overwritten, is not positive definite.
fn solve_positive(left: &mut [f64], right: &mut [f64], n: usize, columns: usize) -> bool {
    let mut room = [MaybeUninit::uninit(); STACK];
    let stack = MemStack::new(&mut room);
    if left.iter().chain(&*right).any(|value| !value.is_finite()) {
        return false;
    }
    let factored = factor::cholesky_in_place(
        matrix(left, n, n),
        factor::LltRegularization::default(),
        Par::Seq,
        stack,
        Default::default(),
    );
    if factored.is_err() {
        return false;
    }
    let factor = MatRef::from_row_major_slice(&*left, n, n);
    solve::solve_in_place_with_conj(factor, Conj::No, matrix(right, n, columns), Par::Seq, stack);
    true
}
