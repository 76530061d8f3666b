//! Results of candidates, divided among threads. Results do not depend on the division.

/// Results of some candidates: their costs and, unless empty, constraints `[.., C]`, gradients `[.., H, D]` and
/// derivatives with respect to predicted states `[.., H, W]`.
#[derive(Default)]
pub(super) struct Outputs<'a> {
    pub(super) costs: &'a mut [f64],
    pub(super) values: &'a mut [f64],
    pub(super) gradient: &'a mut [f32],
    pub(super) by_state: &'a mut [f32],
}

impl<'a> Outputs<'a> {
    /// Those of the first `first` candidates, and those of the rest.
    fn split(self, first: usize) -> [Self; 2] {
        let total = self.costs.len();
        let at = |length: usize| length / total * first;
        let (costs, other_costs) = self.costs.split_at_mut(first);
        let (values, other_values) = self.values.split_at_mut(at(self.values.len()));
        let (gradient, other_gradient) = self.gradient.split_at_mut(at(self.gradient.len()));
        let (by_state, other_by_state) = self.by_state.split_at_mut(at(self.by_state.len()));
        [
            Self { costs, values, gradient, by_state },
            Self {
                costs: other_costs,
                values: other_values,
                gradient: other_gradient,
                by_state: other_by_state,
            },
        ]
    }

    /// Those of each candidate.
    pub(super) fn each(self) -> impl Iterator<Item = Self> {
        let total = self.costs.len();
        let mut rest = Some(self);
        (0..total).map(move |index| {
            let outputs = rest.take().unwrap_or_default();
            if index + 1 == total {
                return outputs;
            }
            let [one, others] = outputs.split(1);
            rest = Some(others);
            one
        })
    }
}

/// As many of `scratch` as are worth using for `candidates`, made if need be.
pub(super) fn scratch_for<T: Default>(scratch: &mut Vec<T>, candidates: usize) -> &mut [T] {
    // A few per thread, so that threads end together.
    let count = candidates.min(4 * rayon::current_num_threads());
    if scratch.len() < count {
        scratch.resize_with(count, T::default);
    }
    &mut scratch[..count]
}

/// Calls `work(scratch, index, outputs)` for every candidate of `outputs`, whose first has the index `first`; in parallel,
/// as far as there is `scratch` (at most one per candidate).
pub(super) fn for_each<T: Send>(
    scratch: &mut [T],
    first: usize,
    outputs: Outputs<'_>,
    work: &(impl Fn(&mut T, usize, Outputs<'_>) + Sync),
) {
    match scratch {
        [] => {}
        [scratch] => {
            outputs.each().enumerate().for_each(|(offset, outputs)| work(scratch, first + offset, outputs));
        }
        scratch => {
            let half = scratch.len() / 2;
            let part = outputs.costs.len() * half / scratch.len();
            let (some, others) = scratch.split_at_mut(half);
            let [left, right] = outputs.split(part);
            rayon::join(|| for_each(some, first, left, work), || for_each(others, first + part, right, work));
        }
    }
}
