//! Reads Lance tables, the default format of the Python package `stable-worldmodel`, without the crates of Lance.
//!
//! A table is a folder `name.lance`. It has versions, of which the newest is read; a version lists files, and a file has the pages of each
//! column. Rows are read by number:
//!
//! ```no_run
//! use std::path::Path;
//! use swm_lance::{Cursor, Table};
//!
//! let table = Table::open(Path::new("pusht.lance"))?;
//! for column in table.columns() {
//!     println!("{}: {} rows of {}", column.name, table.rows(), column.kind);
//! }
//! if let Some(column) = table.column("action") {
//!     // Rows 100 to 103: four bytes for each float32.
//!     let values = table.read(column, 100, 4, &mut Cursor::default())?;
//!     for bytes in values.numbers().chunks_exact(4) {
//!         println!("{}", f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
//!     }
//! }
//! # Ok::<(), swm_lance::LanceError>(())
//! ```
//!
//! | part of the format | what is read |
//! |---|---|
//! | manifests | both namings; detached versions are none of the history |
//! | deleted rows | lists (Arrow) and bitmaps (Roaring); [`Table::gaps`] has where they were |
//! | files | versions 2.0, 2.1, 2.2 |
//! | values | booleans, integers, floats of 16, 32 and 64 bits, texts, bytes; fixed-size lists of numbers; lists of all these; members of structures; missing ones |
//! | encodings of 2.0 | flat, bit-packed, dictionary, FSST, LZ4, Zstandard |
//! | encodings since 2.1 | chunks, large values by themselves, constants; flat, bit-packed, run-length, split bytes, dictionary, FSST, LZ4, Zstandard |
//!
//! What is not in the table is an error that names it ([`LanceError::is_unsupported`]): overwritten values, blobs, packed structures,
//! lists of lists, files of other versions.
//!
//! Every size and position of a file is checked against the file before memory is asked for, and nested descriptions have a limit:
//! damaged tables are errors. Files are read by position through a [`Store`], so that tables may be anywhere.
//!
//! What is deliberately absent: writing, queries, indices, and any knowledge of episodes and images.

mod array;
mod block;
mod codes;
mod cursor;
mod deletions;
mod error;
mod file;
mod kind;
mod layout;
mod manifest;
mod page;
mod proto;
mod store;
mod table;
mod values;

pub use cursor::Cursor;
pub use error::LanceError;
pub use kind::{Column, Kind};
pub use store::{Bytes, Store};
pub use table::Table;
pub use values::Values;
