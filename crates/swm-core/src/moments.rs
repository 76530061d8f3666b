//! Means and standard deviations of numbers that come one by one, and when numbers count as constant: the one running sum and the one
//! rule of all statistics in this project.

use serde::{Deserialize, Serialize};

/// A component is constant where its std is at most this share of its mean…
const RELATIVE: f64 = 1e-6;
/// …and this much more: the noise of a solver around 0.
const ABSOLUTE: f64 = 1e-8;

/// Whether a component of this mean and std counts as constant: its std is at most 1e-8 + 1e-6 × |mean|. Rounding to f32 alone gives a
/// constant a std of up to 1e-7 × |mean|, by which nothing may be divided.
pub fn is_constant(mean: f64, std: f64) -> bool {
    !varies(mean, std, ABSOLUTE)
}

/// What `value - mean` is divided by to standardize a component, and multiplied by to undo it: the std, and 1 where the component
/// [is constant](is_constant), which is then only shifted. So a value that is off by 1e-3 never becomes 1e5 or more.
pub fn divisor(mean: f64, std: f64) -> f64 {
    divisor_with(mean, std, ABSOLUTE)
}

/// As [`divisor`], with another absolute part in place of 1e-8.
pub fn divisor_with(mean: f64, std: f64, absolute: f64) -> f64 {
    if varies(mean, std, absolute) { std } else { 1.0 }
}

/// Of a NaN: no.
fn varies(mean: f64, std: f64, absolute: f64) -> bool {
    std > absolute + RELATIVE * mean.abs()
}

/// Mean, spread and extremes of numbers, in f64 and in their order.
///
/// Source of the update: B. P. Welford, "Note on a method for calculating corrected sums of squares and products", Technometrics 4
/// (1962). It subtracts no large sums from each other, and gives equal numbers a std of exactly 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Moments {
    count: f64,
    mean: f64,
    /// Sum of squared differences from the mean.
    squares: f64,
    min: f64,
    max: f64,
}

impl Default for Moments {
    /// Of no numbers.
    fn default() -> Self {
        // JSON has no infinities.
        Self { count: 0.0, mean: 0.0, squares: 0.0, min: f64::MAX, max: f64::MIN }
    }
}

impl Moments {
    /// Takes a number, which is finite.
    pub fn add(&mut self, value: f64) {
        self.count += 1.0;
        let difference = value - self.mean;
        self.mean += difference / self.count;
        self.squares += difference * (value - self.mean);
        self.min = self.min.min(value);
        self.max = self.max.max(value);
    }

    /// Takes a number so many times.
    ///
    /// Source: T. F. Chan, G. H. Golub and R. J. LeVeque, "Updating formulae and a pairwise algorithm for computing sample variances"
    /// (1979).
    pub fn add_times(&mut self, value: f64, times: u64) {
        if times == 0 {
            return;
        }
        let (more, difference) = (times as f64, value - self.mean);
        let all = self.count + more;
        self.mean += difference * (more / all);
        self.squares += difference * difference * (self.count * more / all);
        self.count = all;
        self.min = self.min.min(value);
        self.max = self.max.max(value);
    }

    /// How many numbers there were.
    pub fn count(&self) -> u64 {
        self.count as u64
    }

    /// Their mean; 0 of none.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Their variance, of the population (divided by their number); 0 of none.
    pub fn variance(&self) -> f64 {
        if self.count > 0.0 { self.squares / self.count } else { 0.0 }
    }

    /// Their standard deviation, of the population; 0 of none.
    pub fn std(&self) -> f64 {
        self.variance().sqrt()
    }

    /// The least; 0 of none.
    pub fn min(&self) -> f64 {
        if self.count > 0.0 { self.min } else { 0.0 }
    }

    /// The greatest; 0 of none.
    pub fn max(&self) -> f64 {
        if self.count > 0.0 { self.max } else { 0.0 }
    }

    /// Whether they [count as constant](is_constant).
    pub fn is_constant(&self) -> bool {
        is_constant(self.mean, self.std())
    }

    /// The [`divisor`] of their mean and std.
    pub fn divisor(&self) -> f64 {
        divisor(self.mean, self.std())
    }
}

impl Extend<f64> for Moments {
    fn extend<T: IntoIterator<Item = f64>>(&mut self, values: T) {
        values.into_iter().for_each(|value| self.add(value));
    }
}

impl FromIterator<f64> for Moments {
    fn from_iter<T: IntoIterator<Item = f64>>(values: T) -> Self {
        let mut all = Self::default();
        all.extend(values);
        all
    }
}

/// Those of each component of rows end to end, `[N, D]` with D = `dim`.
pub fn of_rows(values: &[f64], dim: usize) -> Vec<Moments> {
    let mut all = vec![Moments::default(); dim];
    for row in values.chunks_exact(dim.max(1)) {
        all.iter_mut().zip(row).for_each(|(moments, &value)| moments.add(value));
    }
    all
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_million_rows_far_from_0_keep_their_mean_and_std() {
        // Of f32 values, as summed in f32 they gave 0.4285 and 0.0038.
        let value = |row: u32| f64::from(0.4249_f32 + if row.is_multiple_of(2) { 0.001 } else { -0.001 });
        let all: Moments = (0..1_000_000).map(value).collect();
        assert!((all.mean() - 0.4249).abs() < 1e-7 && (all.std() - 0.001).abs() < 1e-7, "{all:?}");
        let large: Moments = (0..1000).map(|row| 1e9 + f64::from(row % 2)).collect();
        assert!((large.mean() - (1e9 + 0.5)).abs() < 1e-6 && (large.std() - 0.5).abs() < 1e-6, "{large:?}");
    }

    #[test]
    fn constants_have_a_std_of_0_and_are_only_shifted() {
        for value in [0.1, f64::from(0.1_f32), 1234.567, 1e300, -7.0, 0.0] {
            let all: Moments = (0..1000).map(|_| value).collect();
            assert_eq!((all.mean(), all.std(), all.divisor()), (value, 0.0, 1.0));
            assert_eq!((all.min(), all.max()), (value, value));
        }
        // What rounding to f32, or a solver's noise around 0, leaves of a constant.
        for noise in [0.1 * f64::from(f32::EPSILON), 1e-9] {
            let all: Moments = (0..1000).map(|row| 0.1 + f64::from(row % 2) * noise).collect();
            assert!(all.std() > 0.0 && all.is_constant(), "{all:?}");
        }
        assert_eq!([divisor(0.0, 1e-7), divisor(1e3, 0.01), divisor(-1e3, 1e-4)], [1e-7, 0.01, 1.0]);
        assert_eq!([divisor(0.0, 1e-9), divisor(f64::NAN, 1.0), divisor(0.0, f64::NAN)], [1.0; 3]);
        assert_eq!(divisor_with(0.0, 1e-9, 0.0), 1e-9);
    }

    proptest! {
        #[test]
        fn nothing_that_is_off_by_a_thousandth_is_blown_up(mean in -1e6f64..1e6, std in 0.0f64..1e-3) {
            prop_assert!(1e-3 / divisor(mean, std) < 1e5);
        }

        #[test]
        fn numbers_may_come_one_by_one_or_counted(counts in proptest::collection::vec(0u64..50, 1..20)) {
            let (mut counted, mut single) = (Moments::default(), Moments::default());
            for (value, &times) in counts.iter().enumerate() {
                let value = value as f64 / 3.0 + 100.0;
                counted.add_times(value, times);
                single.extend((0..times).map(|_| value));
            }
            prop_assert_eq!(counted.count(), single.count());
            for (a, b) in [(counted.mean(), single.mean()), (counted.std(), single.std())] {
                prop_assert!((a - b).abs() < 1e-9, "{} {}", a, b);
            }
            prop_assert_eq!((counted.min(), counted.max()), (single.min(), single.max()));
        }
    }
}
