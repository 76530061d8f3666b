//! Outputs of candidates, divided among threads. Results do not depend on the division.

use crate::cost::Outputs;

/// Outputs of some candidates, and derivatives with respect to their predicted states, `[.., H, W]`, or nothing.
type Share<'a> = (Outputs<'a>, &'a mut [f32]);

/// The share of the first `first` of `total` candidates, and that of the rest.
fn split<'a>((outputs, by_state): Share<'a>, total: usize, first: usize) -> [Share<'a>; 2] {
    let at = |length: usize| length / total * first;
    let floats = |all: &'a mut [f32]| all.split_at_mut(at(all.len()));
    let (costs, other_costs) = outputs.costs.split_at_mut(first);
    let (gradient, other_gradient) = outputs.gradient.map(floats).unzip();
    let (constraints, other_constraints) =
        outputs.constraints.map(|all| all.split_at_mut(at(all.len()))).unzip();
    let (by_state, other_by_state) = floats(by_state);
    let weights = outputs.weights;
    let others =
        Outputs { costs: other_costs, gradient: other_gradient, constraints: other_constraints, weights };
    [(Outputs { costs, gradient, constraints, weights }, by_state), (others, other_by_state)]
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

/// Calls `work(scratch, index, share)` for every candidate of `share`, whose first has the index `first`; in parallel,
/// as far as there is `scratch` (at most one per candidate).
pub(super) fn for_each<T: Send>(
    scratch: &mut [T],
    first: usize,
    mut share: Share<'_>,
    work: &(impl Fn(&mut T, usize, Share<'_>) + Sync),
) {
    let count = share.0.costs.len();
    match scratch {
        [] => {}
        [scratch] => {
            for done in 0..count {
                let [one, others] = split(share, count - done, 1);
                work(scratch, first + done, one);
                share = others;
            }
        }
        scratch => {
            let half = scratch.len() / 2;
            let part = count * half / scratch.len();
            let (some, others) = scratch.split_at_mut(half);
            let [left, right] = split(share, count, part);
            rayon::join(|| for_each(some, first, left, work), || for_each(others, first + part, right, work));
        }
    }
}
