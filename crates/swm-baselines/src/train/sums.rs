//! Means of the values of steps, between two records.

use serde::{Deserialize, Serialize};

use crate::baseline::Losses;

/// The values of a step, the loss first.
pub(crate) fn values(losses: &Losses) -> Vec<(String, f64)> {
    let parts = losses.parts.iter().map(|&(name, value)| (name.to_owned(), f64::from(value)));
    [("loss".to_owned(), f64::from(losses.total))].into_iter().chain(parts).collect()
}

/// Means in the making.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Sums {
    values: Vec<(String, f64)>,
    weight: f64,
}

impl Sums {
    /// Adds values, weighed.
    pub(crate) fn add(&mut self, values: &[(String, f64)], weight: f64) {
        self.weight += weight;
        for (name, value) in values {
            match self.values.iter_mut().find(|(known, _)| known == name) {
                Some((_, sum)) => *sum += value * weight,
                None => self.values.push((name.clone(), value * weight)),
            }
        }
    }

    /// The means; then there is nothing.
    pub(crate) fn take(&mut self) -> Vec<(String, f64)> {
        let Self { values, weight } = std::mem::take(self);
        values.into_iter().map(|(name, sum)| (name, sum / weight)).collect()
    }
}
