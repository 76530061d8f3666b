//! Numpy's archives of one array, `arr_0`: reading any of them, and growing our own row by row. No pickled objects.

mod archive;
mod growing;
mod header;

pub use archive::{Array, check_end, members};
pub(super) use growing::GrowingArray;
pub use header::ArrayType;
