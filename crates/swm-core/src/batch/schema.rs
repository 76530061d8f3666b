//! What a table may hold: named fields with a type, a shape, and whether they change in an episode.

use std::collections::HashMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::Dtype;
use crate::error::{BatchError, nearest};

/// When a field gets a new value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FieldKind {
    /// At every step: state, pixels, action, reward.
    Step,
    /// At every reset: factors of variation, goal, seed.
    Episode,
}

/// One named field: its element type, the shape of one row, and when it changes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Field {
    /// Dotted name: `state`, `variation.block.color`.
    pub name: String,
    /// Element type.
    pub dtype: Dtype,
    /// Shape of one row; empty for a scalar, `[H, W, 3]` for pixels.
    pub shape: Vec<usize>,
    /// When it changes.
    pub kind: FieldKind,
}

impl Field {
    /// A field that changes at every step.
    pub fn step(name: &str, dtype: Dtype, shape: &[usize]) -> Self {
        Self { name: name.to_owned(), dtype, shape: shape.to_vec(), kind: FieldKind::Step }
    }

    /// A field that is constant in an episode.
    pub fn episode(name: &str, dtype: Dtype, shape: &[usize]) -> Self {
        Self { kind: FieldKind::Episode, ..Self::step(name, dtype, shape) }
    }

    /// The number of values in one row.
    pub fn dim(&self) -> usize {
        self.shape.iter().product()
    }
}

/// An ordered list of fields with unique names.
#[derive(Clone, Debug, Default)]
pub struct Schema {
    fields: Vec<Field>,
    /// The dimension of every field, because rows ask for it at every access.
    dims: Vec<usize>,
    by_name: HashMap<String, usize>,
}

impl Schema {
    /// Checks that the names are unique.
    ///
    /// # Errors
    ///
    /// [`BatchError::DuplicateField`]: two fields share a name.
    pub fn new(fields: Vec<Field>) -> Result<Arc<Self>, BatchError> {
        let mut by_name = HashMap::with_capacity(fields.len());
        for (index, field) in fields.iter().enumerate() {
            if by_name.insert(field.name.clone(), index).is_some() {
                return Err(BatchError::DuplicateField { name: field.name.clone() });
            }
        }
        let dims = fields.iter().map(Field::dim).collect();
        Ok(Arc::new(Self { fields, dims, by_name }))
    }

    /// The fields, in order.
    pub fn fields(&self) -> &[Field] {
        &self.fields
    }

    /// The number of values in one row of field `index`.
    pub fn dim(&self, index: usize) -> usize {
        self.dims[index]
    }

    /// Bytes that the values of one row take; text counts without its letters.
    pub fn row_bytes(&self) -> usize {
        let value = |field: &Field| field.dtype.bytes().unwrap_or(size_of::<String>());
        self.fields.iter().zip(&self.dims).map(|(field, dim)| dim.saturating_mul(value(field))).sum()
    }

    /// The position of a field.
    pub fn index(&self, name: &str) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    /// The position of a field.
    ///
    /// # Errors
    ///
    /// [`BatchError::UnknownField`], with the nearest name that there is, and all of them.
    pub fn require(&self, name: &str) -> Result<usize, BatchError> {
        self.index(name).ok_or_else(|| BatchError::UnknownField {
            name: name.to_owned(),
            nearest: nearest(name, self.fields.iter().map(|field| field.name.as_str())),
            known: self.names(),
        })
    }

    /// The names of the fields, with commas; of many, the first ones.
    pub fn names(&self) -> String {
        const MOST: usize = 32;
        let names: Vec<&str> = self.fields.iter().take(MOST).map(|field| field.name.as_str()).collect();
        match self.fields.len().saturating_sub(MOST) {
            0 => names.join(", "),
            more => format!("{} and {more} more", names.join(", ")),
        }
    }
}

impl PartialEq for Schema {
    fn eq(&self, other: &Self) -> bool {
        self.fields == other.fields
    }
}
