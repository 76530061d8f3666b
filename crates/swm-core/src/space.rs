//! Spaces: what an action, an observation or a factor may be. A space never holds a current value.

use rand::{Rng, RngExt as _};
use serde::{Deserialize, Serialize};

use crate::batch::{Column, Dtype, Slice, SliceMut, Value};
use crate::error::BatchError;

/// A set of values of one type and shape, or a dictionary of such sets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Space {
    /// Real numbers between bounds, both included.
    Box {
        /// `float32` or `float64`.
        dtype: Dtype,
        /// Shape; empty for a scalar.
        shape: Vec<usize>,
        /// Lower bounds, one per element.
        low: Vec<f64>,
        /// Upper bounds, one per element.
        high: Vec<f64>,
    },
    /// One integer in `start..start + n`.
    Discrete {
        /// How many.
        n: i64,
        /// The smallest.
        start: i64,
    },
    /// Several integers, element `i` in `start[i]..start[i] + n[i]`.
    MultiDiscrete {
        /// How many, per element.
        n: Vec<i64>,
        /// The smallest, per element.
        start: Vec<i64>,
    },
    /// A color: three `u8` in red, green, blue order.
    Rgb,
    /// Named spaces, in order.
    Dict {
        /// Names and spaces.
        spaces: Vec<(String, Space)>,
    },
}

impl Space {
    /// A box with the same bounds for every element.
    pub fn uniform_box(dtype: Dtype, shape: &[usize], low: f64, high: f64) -> Self {
        let dim = shape.iter().product();
        Space::Box { dtype, shape: shape.to_vec(), low: vec![low; dim], high: vec![high; dim] }
    }

    /// The element type; a dictionary has none.
    pub fn dtype(&self) -> Option<Dtype> {
        match self {
            Space::Box { dtype, .. } => Some(*dtype),
            Space::Discrete { .. } | Space::MultiDiscrete { .. } => Some(Dtype::I64),
            Space::Rgb => Some(Dtype::U8),
            Space::Dict { .. } => None,
        }
    }

    /// The shape of one value; a dictionary has none.
    pub fn shape(&self) -> Vec<usize> {
        match self {
            Space::Box { shape, .. } => shape.clone(),
            Space::Discrete { .. } | Space::Dict { .. } => Vec::new(),
            Space::MultiDiscrete { n, .. } => vec![n.len()],
            Space::Rgb => vec![3],
        }
    }

    /// The number of elements of one value. Allocates nothing: it is asked at every step.
    pub fn dim(&self) -> usize {
        match self {
            Space::Box { low, .. } => low.len(),
            Space::Discrete { .. } => 1,
            Space::MultiDiscrete { n, .. } => n.len(),
            Space::Rgb => 3,
            Space::Dict { spaces } => spaces.iter().map(|(_, space)| space.dim()).sum(),
        }
    }

    /// A word for tables: `box`, `discrete`, `multi_discrete`, `rgb`, `dict`.
    pub fn kind(&self) -> &'static str {
        match self {
            Space::Box { .. } => "box",
            Space::Discrete { .. } => "discrete",
            Space::MultiDiscrete { .. } => "multi_discrete",
            Space::Rgb => "rgb",
            Space::Dict { .. } => "dict",
        }
    }

    /// Smallest and largest value of every element, both included.
    pub fn bounds(&self) -> (Vec<f64>, Vec<f64>) {
        match self {
            Space::Box { low, high, .. } => (low.clone(), high.clone()),
            Space::Discrete { n, start } => (vec![*start as f64], vec![(start + n - 1) as f64]),
            Space::MultiDiscrete { n, start } => (
                start.iter().map(|&s| s as f64).collect(),
                start.iter().zip(n).map(|(&s, &n)| (s + n - 1) as f64).collect(),
            ),
            Space::Rgb => (vec![0.0; 3], vec![255.0; 3]),
            Space::Dict { spaces } => {
                let parts = spaces.iter().map(|(_, space)| space.bounds());
                parts.fold((Vec::new(), Vec::new()), |(mut low, mut high), (l, h)| {
                    low.extend(l);
                    high.extend(h);
                    (low, high)
                })
            }
        }
    }

    /// The space of `rows` values of this space: `[rows, …shape]`.
    pub fn batch(&self, rows: usize) -> Space {
        let repeat_f = |v: &[f64]| v.repeat(rows);
        let repeat_i = |v: &[i64]| v.repeat(rows);
        match self {
            Space::Box { dtype, shape, low, high } => Space::Box {
                dtype: *dtype,
                shape: std::iter::once(rows).chain(shape.iter().copied()).collect(),
                low: repeat_f(low),
                high: repeat_f(high),
            },
            Space::Discrete { n, start } => {
                Space::MultiDiscrete { n: vec![*n; rows], start: vec![*start; rows] }
            }
            Space::MultiDiscrete { n, start } => {
                Space::MultiDiscrete { n: repeat_i(n), start: repeat_i(start) }
            }
            Space::Rgb => Space::MultiDiscrete { n: vec![256; 3 * rows], start: vec![0; 3 * rows] },
            Space::Dict { spaces } => Space::Dict {
                spaces: spaces.iter().map(|(name, space)| (name.clone(), space.batch(rows))).collect(),
            },
        }
    }

    /// Samples one value, every element uniformly. A dictionary's elements are sampled in order and returned flat
    /// as `f64`.
    pub fn sample(&self, rng: &mut impl Rng) -> Value {
        let mut data = Column::zeros(self.dtype().unwrap_or(Dtype::F64), self.dim());
        self.sample_into(rng, data.as_slice_mut());
        let shape = if matches!(self, Space::Dict { .. }) { vec![self.dim()] } else { self.shape() };
        Value { shape, data }
    }

    /// Samples one value into `out`, which has this space's type and dim. Allocates nothing, but for a dictionary.
    ///
    /// # Panics
    /// If `out` has another type.
    pub fn sample_into(&self, rng: &mut impl Rng, out: SliceMut<'_>) {
        match (self, out) {
            (Space::Box { low, high, .. }, SliceMut::F32(out)) => {
                for (out, (low, high)) in out.iter_mut().zip(low.iter().zip(high)) {
                    *out = (low + (high - low) * rng.random::<f64>()) as f32;
                }
            }
            (Space::Box { low, high, .. }, SliceMut::F64(out)) => {
                for (out, (low, high)) in out.iter_mut().zip(low.iter().zip(high)) {
                    *out = low + (high - low) * rng.random::<f64>();
                }
            }
            (Space::Discrete { n, start }, SliceMut::I64(out)) => {
                out.fill_with(|| start + rng.random_range(0..*n));
            }
            (Space::MultiDiscrete { n, start }, SliceMut::I64(out)) => {
                for (out, (n, start)) in out.iter_mut().zip(n.iter().zip(start)) {
                    *out = start + rng.random_range(0..*n);
                }
            }
            (Space::Rgb, SliceMut::U8(out)) => out.fill_with(|| rng.random()),
            (Space::Dict { spaces }, SliceMut::F64(mut out)) => {
                for (name, space) in spaces {
                    let numbers = space.sample(rng).to_f64s(name).expect("spaces hold numbers only");
                    let (head, tail) = out.split_at_mut(numbers.len());
                    head.copy_from_slice(&numbers);
                    out = tail;
                }
            }
            (space, out) => panic!("a {} space has no values of {}", space.kind(), out.dtype()),
        }
    }

    /// Whether `values` (one value of this space) lie in it. `what` names them in errors.
    ///
    /// # Errors
    ///
    /// [`BatchError::WrongValue`]: another count of numbers, or one outside the bounds; NaN is outside.
    pub fn check(&self, what: &str, values: Slice<'_>) -> Result<(), BatchError> {
        let (low, high) = self.bounds();
        if values.len() != low.len() {
            return Err(BatchError::WrongValue {
                name: what.to_owned(),
                expected: format!("{} number(s)", low.len()),
                found: values.len().to_string(),
            });
        }
        for index in 0..values.len() {
            let value = values.as_f64(index).unwrap_or(f64::NAN);
            if !self.is_within(low[index], value, high[index]) {
                return Err(BatchError::WrongValue {
                    name: what.to_owned(),
                    expected: format!("between {} and {}", low[index], high[index]),
                    found: value.to_string(),
                });
            }
        }
        Ok(())
    }

    /// Compares at the precision of the values: 0.05 as `f32` lies above 0.05, and is the bound all the same.
    fn is_within(&self, low: f64, value: f64, high: f64) -> bool {
        match self {
            Space::Box { dtype: Dtype::F32, .. } => low as f32 <= value as f32 && value as f32 <= high as f32,
            _ => low <= value && value <= high,
        }
    }

    /// Whether integers lie in this space of integers; true for other spaces, whose bounds are advice. Allocates
    /// nothing.
    pub fn holds_integers(&self, values: Slice<'_>) -> bool {
        let within = |value: i64, n: i64, start: i64| value >= start && value - start < n;
        match (self, values) {
            (Space::Discrete { n, start }, Slice::I64(values)) => {
                values.iter().all(|&value| within(value, *n, *start))
            }
            (Space::MultiDiscrete { n, start }, Slice::I64(values)) => {
                values.iter().zip(n.iter().zip(start)).all(|(&value, (&n, &start))| within(value, n, start))
            }
            _ => true,
        }
    }

    /// Whether a value has this space's type and shape and lies in it.
    pub fn contains(&self, value: &Value) -> bool {
        let typed = match self.dtype() {
            Some(dtype) => value.data.dtype() == dtype && value.shape == self.shape(),
            None => true,
        };
        typed && self.check("value", value.data.as_slice()).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::EpisodeSeed;

    fn spaces() -> Vec<Space> {
        let simple = vec![
            Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0),
            Space::uniform_box(Dtype::F64, &[], 50.0, 450.0),
            Space::Discrete { n: 7, start: 1 },
            Space::MultiDiscrete { n: vec![16, 3], start: vec![0, 10] },
            Space::Rgb,
        ];
        let dict = Space::Dict {
            spaces: simple.iter().enumerate().map(|(i, s)| (i.to_string(), s.clone())).collect(),
        };
        simple.into_iter().chain([dict]).collect()
    }

    #[test]
    fn samples_lie_in_their_space() {
        let mut rng = EpisodeSeed::new(3).stream("space test");
        for space in spaces() {
            for _ in 0..200 {
                let value = space.sample(&mut rng);
                assert!(space.contains(&value), "{space:?} does not contain {value}");
            }
            assert_eq!(space.batch(4).dim(), 4 * space.dim());
            assert_eq!(space.dim(), space.bounds().0.len());
        }
    }

    #[test]
    fn bounds_lie_in_their_space_at_every_precision() {
        let space = Space::uniform_box(Dtype::F32, &[], 0.01, 0.05);
        for bound in [0.01, 0.05] {
            assert!(space.check("x", Slice::F64(&[bound])).is_ok());
            assert!(space.check("x", Slice::F32(&[bound as f32])).is_ok(), "{bound}");
            assert!(space.check("x", Slice::F64(&[f64::from(bound as f32)])).is_ok(), "{bound}");
        }
        assert!(space.check("x", Slice::F32(&[0.05f32.next_up()])).is_err());
        assert!(space.check("x", Slice::F32(&[0.01f32.next_down()])).is_err());
        assert!(space.check("x", Slice::F32(&[f32::NAN])).is_err());
    }

    #[test]
    fn what_lies_outside_is_refused_with_the_bounds() {
        let space = Space::uniform_box(Dtype::F64, &[], 50.0, 450.0);
        let message = space.check("agent.x", Slice::F64(&[451.0])).unwrap_err().to_string();
        assert_eq!(message, "`agent.x` must be between 50 and 450, found 451");
        assert!(!space.contains(&Value::scalar(f64::NAN)));
        assert!(!space.contains(&Value::scalar(60.0f32)), "another type is another value");
    }
}
