//! One pass over the rows of a column: running means and stds (Welford's recurrence), extremes, and what is kept
//! for quantiles: a uniform sample of rows, or the counts of all 256 levels of an image's channels.

use rand::RngExt as _;
use swm_core::Slice;
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
pub(super) struct Moments {
    width: usize,
    rows: u64,
    not_finite: u64,
    mean: Vec<f64>,
    /// Sums of squared differences from the mean.
    squares: Vec<f64>,
    min: Vec<f64>,
    max: Vec<f64>,
    /// Rows end to end: a uniform sample of those so far (Vitter's algorithm R).
    sample: Vec<f64>,
    capacity: usize,
    stream: Stream,
    row: Vec<f64>,
}

impl Moments {
    /// Of rows of `width` values; quantiles from at most `capacity` of them, which `stream` chooses.
    pub(super) fn new(width: usize, capacity: usize, stream: u64) -> Self {
        Self {
            width,
            rows: 0,
            not_finite: 0,
            mean: vec![0.0; width],
            squares: vec![0.0; width],
            min: vec![f64::INFINITY; width],
            max: vec![f64::NEG_INFINITY; width],
            sample: Vec::new(),
            capacity,
            stream: keyed(0, "statistics", [stream, 0]),
            row: vec![0.0; width],
        }
    }

    fn add_row(&mut self) {
        self.rows += 1;
        for (at, &value) in self.row.iter().enumerate() {
            let difference = value - self.mean[at];
            self.mean[at] += difference / self.rows as f64;
            self.squares[at] += difference * (value - self.mean[at]);
            self.min[at] = self.min[at].min(value);
            self.max[at] = self.max[at].max(value);
        }
        if self.rows <= self.capacity as u64 {
            self.sample.extend_from_slice(&self.row);
            return;
        }
        let place = self.stream.random_range(0..self.rows);
        if place < self.capacity as u64 {
            let at = place as usize * self.width;
            self.sample[at..at + self.width].copy_from_slice(&self.row);
        }
    }
}

impl Accumulate for Moments {
    fn add(&mut self, rows: Slice<'_>) {
        if self.width == 0 {
            return;
        }
        for first in (0..rows.len()).step_by(self.width) {
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
        let mut sorted: Vec<Vec<f64>> = Vec::with_capacity(self.width);
        for at in 0..self.width {
            let mut values: Vec<f64> = self.sample.iter().skip(at).step_by(self.width).copied().collect();
            values.sort_unstable_by(f64::total_cmp);
            sorted.push(values);
        }
        let at = |&level: &f64| {
            let of =
                |values: &Vec<f64>| interpolate(level, values.len() as u64, |rank| values[rank as usize]);
            (level, sorted.iter().map(of).collect())
        };
        ColumnStatistics {
            rows: self.rows,
            not_finite,
            mean: self.mean.clone(),
            std: self.squares.iter().map(|squares| (squares / self.rows as f64).sqrt()).collect(),
            min: self.min.clone(),
            max: self.max.clone(),
            quantiles: quantiles.iter().map(at).collect(),
            quantiles_exact: self.rows <= self.capacity as u64,
        }
    }
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
        let levels = |counts: &[u64; 256], weight: &dyn Fn(f64) -> f64| {
            let sum: f64 = counts.iter().enumerate().map(|(level, &n)| n as f64 * weight(level as f64)).sum();
            sum / rows as f64
        };
        let mean: Vec<f64> = self.counts.iter().map(|counts| levels(counts, &|level| level)).collect();
        let variance = |(counts, mean): (&[u64; 256], &f64)| levels(counts, &|level| (level - mean).powi(2));
        let std = self.counts.iter().zip(&mean).map(|pair| variance(pair).sqrt()).collect();
        let end = |counts: &[u64; 256], last: bool| {
            let present = |&level: &usize| counts[level] > 0;
            let level = if last { (0..256).rfind(present) } else { (0..256).find(present) };
            level.unwrap_or_default() as f64
        };
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
            std,
            min: self.counts.iter().map(|counts| end(counts, false)).collect(),
            max: self.counts.iter().map(|counts| end(counts, true)).collect(),
            quantiles: quantiles
                .iter()
                .map(|&level| (level, self.counts.iter().map(|counts| of(counts, level)).collect()))
                .collect(),
            mean,
            quantiles_exact: true,
        }
    }
}

/// The quantile `level` of `count` sorted values: between the two whose ranks enclose `level × (count − 1)`.
fn interpolate(level: f64, count: u64, value: impl Fn(u64) -> f64) -> f64 {
    let place = level * (count - 1) as f64;
    let below = place.floor();
    let (low, high) = (value(below as u64), value((below as u64 + 1).min(count - 1)));
    low + (high - low) * (place - below)
}
