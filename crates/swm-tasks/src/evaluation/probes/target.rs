//! What a probe predicts: a column of the true state, some of its elements, or an angle by its cosine and sine.

use std::fmt;
use std::str::FromStr;

use swm_core::Batch;

use crate::error::{TaskError, wrong};

/// Written `state`, `state[0,1]`, or `angle(state[4])`. An angle jumps where it wraps; cosine and sine do not.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProbeTarget {
    /// The column.
    pub column: String,
    /// Which of its elements, if not all.
    pub elements: Vec<usize>,
    /// Whether they are angles in radians: each becomes two numbers.
    pub is_angle: bool,
}

impl ProbeTarget {
    /// What is to be predicted of all rows, `[N, S]`, and S. What is missing is NaN.
    ///
    /// # Errors
    ///
    /// There is no such column or element, or it holds no numbers.
    pub fn values(&self, rows: &Batch) -> Result<(Vec<f64>, usize), TaskError> {
        let column = rows.column(rows.schema().require(&self.column)?);
        let dim = column.len() / rows.rows().max(1);
        let all: Vec<usize> = (0..dim).collect();
        let elements = if self.elements.is_empty() { &all } else { &self.elements };
        if let Some(element) = elements.iter().find(|&&element| element >= dim) {
            return Err(format!("`{self}`: no element {element}; `{}` has {dim}, from 0", self.column).into());
        }
        let mut values = Vec::new();
        for row in 0..rows.rows() {
            for element in elements {
                let value = column.as_f64(row * dim + element);
                let value = value.ok_or_else(|| format!("`{}` holds no numbers", self.column))?;
                if self.is_angle {
                    values.extend([value.cos(), value.sin()]);
                } else {
                    values.push(value);
                }
            }
        }
        Ok((values, elements.len() * if self.is_angle { 2 } else { 1 }))
    }
}

impl From<&str> for ProbeTarget {
    /// All of a column.
    fn from(column: &str) -> Self {
        Self { column: column.to_owned(), elements: Vec::new(), is_angle: false }
    }
}

impl FromStr for ProbeTarget {
    type Err = TaskError;

    fn from_str(text: &str) -> Result<Self, TaskError> {
        let wrong = || wrong(format!("`{text}`: write COLUMN, COLUMN[0,1] or angle(COLUMN[4])"));
        let inner =
            text.strip_prefix("angle(").map(|rest| rest.strip_suffix(')').ok_or_else(wrong)).transpose()?;
        let named = inner.unwrap_or(text);
        let (column, elements) = match named.split_once('[') {
            None => (named, Vec::new()),
            Some((column, rest)) => {
                let elements = rest.strip_suffix(']').ok_or_else(wrong)?.split(',');
                (
                    column,
                    elements
                        .map(|element| element.trim().parse().map_err(|_| wrong()))
                        .collect::<Result<_, _>>()?,
                )
            }
        };
        if column.is_empty() || column.contains([']', '(', ')']) {
            return Err(wrong());
        }
        Ok(Self { column: column.to_owned(), elements, is_angle: inner.is_some() })
    }
}

impl fmt::Display for ProbeTarget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let elements: Vec<String> = self.elements.iter().map(usize::to_string).collect();
        let named = match elements.is_empty() {
            true => self.column.clone(),
            false => format!("{}[{}]", self.column, elements.join(",")),
        };
        if self.is_angle { write!(f, "angle({named})") } else { f.write_str(&named) }
    }
}

#[cfg(test)]
mod tests {
    use swm_core::{Dtype, Field, Schema};

    use super::*;

    #[test]
    fn targets_are_read_as_they_are_written() {
        for text in ["state", "state[0,1]", "angle(state[4])", "angle(qpos)"] {
            assert_eq!(text.parse::<ProbeTarget>().unwrap().to_string(), text);
        }
        for text in ["", "state[", "state[x]", "angle(state", "state]", "angle()", "cos(state)"] {
            assert!(text.parse::<ProbeTarget>().unwrap_err().to_string().contains("write COLUMN"), "{text}");
        }
    }

    #[test]
    fn an_angle_is_its_cosine_and_sine() {
        let mut rows = Batch::new(Schema::new(vec![Field::step("state", Dtype::F64, &[2])]).unwrap(), 2);
        let half = std::f64::consts::PI;
        rows.rows_mut().select(0).write(0, &[5.0, half / 2.0]);
        rows.rows_mut().select(1).write(0, &[7.0, -half]);
        let values = |text: &str| text.parse::<ProbeTarget>().unwrap().values(&rows);
        let (found, dim) = values("angle(state[1])").unwrap();
        let wanted = [0.0, 1.0, -1.0, 0.0];
        assert!(dim == 2 && found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-15), "{found:?}");
        assert_eq!(values("state[0]").unwrap(), (vec![5.0, 7.0], 1));
        assert_eq!(values("state").unwrap(), (vec![5.0, half / 2.0, 7.0, -half], 2));
        assert!(values("state[2]").unwrap_err().to_string().contains("no element 2; `state` has 2"));
        assert!(values("stat").is_err());
    }
}
