//! Real numbers on their way into a batch: f64 as f32, and rewards summed over the actions between two rows.

use swm_core::SliceMut;

use super::plan::Window;
use crate::error::DataError;

/// Memory of one thread for the values of one column of a clip, as they are stored.
#[derive(Default)]
pub(super) struct Scratch {
    single: Vec<f32>,
    double: Vec<f64>,
}

/// Fills `out` with the f64 that `read` gives.
pub(super) fn narrow(
    scratch: &mut Scratch,
    out: &mut [f32],
    read: impl FnOnce(SliceMut<'_>) -> Result<(), DataError>,
) -> Result<(), DataError> {
    let stored = &mut scratch.double;
    stored.resize(out.len(), 0.0);
    read(SliceMut::F64(stored))?;
    out.iter_mut().zip(stored).for_each(|(out, &mut value)| *out = value as f32);
    Ok(())
}

/// Fills `out`, `[num_steps, …]`, with sums over `skip` rows each of the `count` rows that `read` gives; NaN where there are
/// fewer.
pub(super) fn add_up(
    scratch: &mut Scratch,
    window: &Window,
    count: usize,
    skip: usize,
    out: SliceMut<'_>,
    read: impl FnOnce(SliceMut<'_>) -> Result<(), DataError>,
) -> Result<(), DataError> {
    let Scratch { single, double } = scratch;
    let values = count * window.dim;
    double.clear();
    if window.stores_f64 {
        double.resize(values, 0.0);
        if values > 0 {
            read(SliceMut::F64(double))?;
        }
    } else {
        single.resize(values, 0.0);
        if values > 0 {
            read(SliceMut::F32(single))?;
        }
        double.extend(single.iter().map(|&value| f64::from(value)));
    }
    let sum = |at: usize| {
        let (step, element) = (at / window.dim, at % window.dim);
        let rows = step * skip..(step + 1) * skip;
        if rows.end > count {
            return f64::NAN;
        }
        rows.fold(-0.0, |sum, row| sum + double[row * window.dim + element])
    };
    match out {
        SliceMut::F32(out) => out.iter_mut().enumerate().for_each(|(at, out)| *out = sum(at) as f32),
        SliceMut::F64(out) => out.iter_mut().enumerate().for_each(|(at, out)| *out = sum(at)),
        _ => unreachable!("the plan has refused other types"),
    }
    Ok(())
}
