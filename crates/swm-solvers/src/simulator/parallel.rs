//! Work divided among workers, one per thread. Results do not depend on the division.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use crate::error::PlanError;

/// Calls `work(worker, index)` for all of `0..count`. Workers take `take` at a time, whenever they are free. Of several
/// failures that of the lowest index is returned, whichever thread was faster.
pub(super) fn for_each<W: Send>(
    workers: &mut [W],
    count: usize,
    take: usize,
    work: impl Fn(&mut W, usize) -> Result<(), PlanError> + Sync,
) -> Result<(), PlanError> {
    let next = AtomicUsize::new(0);
    let failure: Mutex<Option<(usize, PlanError)>> = Mutex::new(None);
    let busy = workers.len().min(count.div_ceil(take));
    workers[..busy].par_iter_mut().with_max_len(1).for_each(|worker| {
        loop {
            let first = next.fetch_add(take, Ordering::Relaxed);
            if first >= count {
                break;
            }
            for index in first..count.min(first + take) {
                if let Err(error) = work(worker, index) {
                    keep_first(&failure, index, error);
                }
            }
        }
    });
    let failure = failure.into_inner().unwrap_or_else(PoisonError::into_inner);
    failure.map_or(Ok(()), |(_, error)| Err(error))
}

fn keep_first(failure: &Mutex<Option<(usize, PlanError)>>, index: usize, error: PlanError) {
    let mut kept = failure.lock().unwrap_or_else(PoisonError::into_inner);
    if kept.as_ref().is_none_or(|(first, _)| index < *first) {
        *kept = Some((index, error));
    }
}
