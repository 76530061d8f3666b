//! Columns and tables: the one shape that all data has, from a live `World` to a dataset file.
//!
//! A [`Batch`] is a [`Schema`] and one typed [`Column`] per field. In `World::infos` a row is an environment; in
//! a recorded episode a row is a step.

mod column;
mod rows;
mod schema;
mod table;
mod value;

pub use column::{Column, Dtype, Element, Slice, SliceMut};
pub use rows::{Row, RowsMut};
pub use schema::{Field, FieldKind, Schema};
pub use table::Batch;
pub use value::Value;
