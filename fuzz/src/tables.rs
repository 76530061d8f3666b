//! Lance tables of every version and encoding that are read.

use std::fs;
use std::path::Path;

use swm_lance::{Cursor, Table};

use crate::sample::{Sample, Samples};

/// The tables of the tests.
pub fn samples() -> Samples {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/lance");
    let entries = fs::read_dir(golden).expect("the tables are there");
    let mut paths: Vec<_> = entries.map(|entry| entry.expect("it is listed").path()).collect();
    paths.retain(|path| path.extension().is_some_and(|ending| ending == "lance"));
    paths.sort();
    Samples::new(paths.iter().map(|path| Sample::copy(path)).collect())
}

/// Reads all columns.
pub fn read(path: &Path) {
    let Ok(table) = Table::open(path) else { return };
    let mut cursor = Cursor::default();
    for column in table.columns() {
        for first in [0, table.rows() / 2] {
            let count = (table.rows() - first).min(5000) as usize;
            let _ = table.read(column, first, count, &mut cursor);
        }
    }
}
