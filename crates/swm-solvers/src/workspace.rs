//! What a solve may use: buffers that solvers reuse, and time. Neither holds state: what a solver keeps from plan to plan is
//! in its problem.

use std::mem::MaybeUninit;
use std::time::Instant;

/// Buffers for any solver, and the time that it may take. The first solve of a size allocates, later ones do not.
#[derive(Debug, Default)]
pub struct Workspace {
    /// When a solver ends its search: after the iteration, of one or more, in which this time passes. It then returns what it
    /// would return with that many iterations. `None`: after all iterations.
    pub deadline: Option<Instant>,
    /// Candidates, gradients, moments of the optimizer.
    pub floats: Scratch<f32>,
    /// Costs, multipliers.
    pub doubles: Scratch<f64>,
    /// Orders of samples.
    pub indices: Scratch<u32>,
    /// Scratch for the factorization of matrices.
    pub stack: Scratch<f64>,
}

impl Workspace {
    /// Empty buffers, and all the time that a search takes.
    pub fn new() -> Self {
        Self::default()
    }
}

/// Whether the time of a search is over.
pub(crate) fn is_past(deadline: Option<Instant>) -> bool {
    deadline.is_some_and(|deadline| Instant::now() >= deadline)
}

/// One buffer, cut into slices. It grows and never shrinks.
#[derive(Debug, Default)]
pub struct Scratch<T> {
    buffer: Vec<T>,
}

impl<T: Copy + Default> Scratch<T> {
    /// Disjoint slices of the given lengths, all zero: nothing leaks from one solve into the next.
    pub fn cut<const N: usize>(&mut self, lengths: [usize; N]) -> [&mut [T]; N] {
        self.buffer.clear();
        self.buffer.resize(lengths.iter().sum(), T::default());
        let mut rest = self.buffer.as_mut_slice();
        lengths.map(|length| {
            let (slice, tail) = std::mem::take(&mut rest).split_at_mut(length);
            rest = tail;
            slice
        })
    }

    /// Room for `length` uninitialized values.
    pub fn spare(&mut self, length: usize) -> &mut [MaybeUninit<T>] {
        self.buffer.clear();
        self.buffer.reserve(length);
        &mut self.buffer.spare_capacity_mut()[..length]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_are_disjoint_and_zero_again() {
        let mut scratch = Scratch::<u32>::default();
        let [a, b] = scratch.cut([2, 3]);
        a.fill(1);
        b.fill(2);
        assert_eq!((&*a, &*b), (&[1, 1][..], &[2, 2, 2][..]));
        let [c] = scratch.cut([4]);
        assert_eq!(c, [0; 4]);
    }
}
