//! One pass over the rows of a column: running means, stds and extremes, and what is kept
//! for quantiles: a uniform sample of rows, or the counts of all 256 levels of an image's channels.

use rand::RngExt as _;
use swm_core::Slice;
use swm_core::moments::Moments;
use swm_core::seed::{Stream, keyed};

use super::ColumnStatistics;

/// Takes rows, gives statistics.
pub(super) trait Accumulate {
    /// Some whole rows.
    fn add(&mut self, rows: Slice<'_>);
    /// After the last row.
    fn finish(&mut self, quantiles: &[f64]) -> ColumnStatistics;
}

/// Of rows of numbers.
pub(super) struct Rows {
    not_finite: u64,
    /// By value of a row.
    columns: Vec<Moments>,
    rows: u64,
    /// Rows end to end: a uniform sample of those so far (Vitter's algorithm R).
    sample: Vec<f64>,
    capacity: usize,
    stream: Stream,
    row: Vec<f64>,
}

impl Rows {
    /// Of rows of `width` values; quantiles from at most `capacity` of them, which `stream` chooses.
    pub(super) fn new(width: usize, capacity: usize, stream: u64) -> Self {
        Self {
            not_finite: 0,
            columns: vec![Moments::default(); width],
            rows: 0,
            sample: Vec::new(),
            capacity,
            stream: keyed(0, "statistics", [stream, 0]),
            row: vec![0.0; width],
        }
    }

    fn add_row(&mut self) {
        self.rows += 1;
        self.columns.iter_mut().zip(&self.row).for_each(|(moments, &value)| moments.add(value));
        if self.rows <= self.capacity as u64 {
            self.sample.extend_from_slice(&self.row);
        } else if self.capacity > 0 {
            let place = self.stream.random_range(0..self.rows);
            if place < self.capacity as u64 {
                let (width, at) = (self.row.len(), place as usize * self.row.len());
                self.sample[at..at + width].copy_from_slice(&self.row);
            }
        }
    }
}

impl Accumulate for Rows {
    fn add(&mut self, rows: Slice<'_>) {
        let width = self.row.len();
        if width == 0 {
            return;
        }
        for first in (0..rows.len()).step_by(width) {
            for (at, value) in self.row.iter_mut().enumerate() {
                *value = rows.as_f64(first + at).unwrap_or(f64::NAN);
            }
            if self.row.iter().all(|value| value.is_finite()) {
                self.add_row();
            } else {
                self.not_finite += 1;
            }
        }
    }

    fn finish(&mut self, quantiles: &[f64]) -> ColumnStatistics {
        let not_finite = self.not_finite;
        if self.rows == 0 {
            return ColumnStatistics { not_finite, quantiles_exact: true, ..ColumnStatistics::default() };
        }
        let width = self.row.len();
        let mut sorted: Vec<Vec<f64>> = Vec::with_capacity(width);
        for at in 0..width {
            let mut values: Vec<f64> = self.sample.iter().skip(at).step_by(width).copied().collect();
            values.sort_unstable_by(f64::total_cmp);
            sorted.push(values);
        }
        let at = |&level: &f64| {
            let of =
                |values: &Vec<f64>| interpolate(level, values.len() as u64, |rank| values[rank as usize]);
            (level, sorted.iter().map(of).collect())
        };
        let each = |value: fn(&Moments) -> f64| self.columns.iter().map(value).collect();
        let (mean, std) = self.columns.iter().zip(&sorted).map(|(all, sample)| center(all, sample)).unzip();
        ColumnStatistics {
            rows: self.rows,
            not_finite,
            mean,
            std,
            min: each(Moments::min),
            max: each(Moments::max),
            quantiles: quantiles.iter().map(at).collect(),
            quantiles_exact: self.rows <= self.capacity as u64,
        }
    }
}

/// Mean and std of one value of a row. Where their sums are beyond f64, as of marks such as 1e308, those of the sample.
fn center(all: &Moments, sample: &[f64]) -> (f64, f64) {
    let (mean, std) = (all.mean(), all.std());
    if mean.is_finite() && std.is_finite() {
        return (mean, std);
    }
    let scale = sample.iter().fold(0.0_f64, |scale, value| scale.max(value.abs()));
    let mut scaled = Moments::default();
    sample.iter().for_each(|value| scaled.add(value / scale));
    (scaled.mean() * scale, scaled.std() * scale)
}

/// Of images, by channel.
pub(super) struct Histograms {
    rows: u64,
    counts: Vec<[u64; 256]>,
    /// Pixels of one row and channel.
    pixels: usize,
}

impl Histograms {
    pub(super) fn new(channels: usize) -> Self {
        Self { rows: 0, counts: vec![[0; 256]; channels], pixels: 0 }
    }
}

impl Accumulate for Histograms {
    fn add(&mut self, rows: Slice<'_>) {
        let Slice::U8(values) = rows else { return };
        let channels = self.counts.len().max(1);
        self.pixels += values.len() / channels;
        for pixel in values.chunks_exact(channels) {
            for (counts, &level) in self.counts.iter_mut().zip(pixel) {
                counts[usize::from(level)] += 1;
            }
        }
    }

    fn finish(&mut self, quantiles: &[f64]) -> ColumnStatistics {
        self.rows = self.pixels as u64;
        let rows = self.rows;
        if rows == 0 {
            return ColumnStatistics { quantiles_exact: true, ..ColumnStatistics::default() };
        }
        let of_channel = |counts: &[u64; 256]| -> Moments {
            let mut moments = Moments::default();
            counts.iter().enumerate().for_each(|(level, &times)| moments.add_times(level as f64, times));
            moments
        };
        let channels: Vec<Moments> = self.counts.iter().map(of_channel).collect();
        let each = |value: fn(&Moments) -> f64| channels.iter().map(value).collect();
        let of = |counts: &[u64; 256], level: f64| {
            interpolate(level, rows, |rank| {
                let mut below = 0;
                let reached = |n: &u64| {
                    below += n;
                    below > rank
                };
                counts.iter().position(reached).unwrap_or(255) as f64
            })
        };
        ColumnStatistics {
            rows,
            not_finite: 0,
            mean: each(Moments::mean),
            std: each(Moments::std),
            min: each(Moments::min),
            max: each(Moments::max),
            quantiles: quantiles
                .iter()
                .map(|&level| (level, self.counts.iter().map(|counts| of(counts, level)).collect()))
                .collect(),
            quantiles_exact: true,
        }
    }
}

/// The quantile `level` of `count` sorted values: between the two whose ranks enclose `level × (count − 1)`.
fn interpolate(level: f64, count: u64, value: impl Fn(u64) -> f64) -> f64 {
    let place = level * (count - 1) as f64;
    let below = place.floor();
    let (low, high) = (value(below as u64), value((below as u64 + 1).min(count - 1)));
    let (share, step) = (place - below, high - low);
    if step.is_finite() { low + step * share } else { low * (1.0 - share) + high * share }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_whose_squares_are_beyond_f64_have_statistics() {
        let mut rows = Rows::new(1, 100, 0);
        rows.add(Slice::F64(&[f64::MAX, f64::MIN, 0.0, f64::MAX]));
        let found = rows.finish(&[0.25, 0.5]);
        assert_eq!((found.mean[0], found.min[0], found.max[0]), (f64::MAX / 4.0, f64::MIN, f64::MAX));
        // Of 1, -1, 0 and 1: 11 / 16.
        assert!((found.std[0] / f64::MAX - 0.6875_f64.sqrt()).abs() < 1e-12, "{:e}", found.std[0]);
        assert_eq!(found.quantiles, [(0.25, vec![f64::MIN + f64::MAX * 0.75]), (0.5, vec![f64::MAX / 2.0])]);
        let mut one = Rows::new(1, 100, 0);
        one.add(Slice::F64(&[1e200, 3e200]));
        let found = one.finish(&[]);
        let is_near = |value: f64, wanted: f64| (value / wanted - 1.0).abs() < 1e-15;
        assert!(is_near(found.mean[0], 2e200) && is_near(found.std[0], 1e200), "{found:?}");
    }
}
