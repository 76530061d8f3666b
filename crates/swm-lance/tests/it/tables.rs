//! Whole tables: all rows of all columns, in parts of several sizes.

use std::sync::atomic::Ordering;

use swm_lance::{Column, Cursor, Kind, Table, Values};

use crate::formulas::row;
use crate::memory::{DELETED, Memory, TABLES, folder};

fn open(name: &str) -> Table {
    Table::open(&folder().join(format!("{name}.lance"))).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Those that other tests read.
const OTHERS: &[&str] = &["deleted", "deleted_many", "plain", "plain_episodes", "recorded"];

/// Compares rows with the formulas.
fn check(place: &str, column: &Column, first: u64, values: &Values) {
    for at in 0..values.rows() {
        let expected = row(&column.name, first + at as u64);
        let place = format!("{place}, column `{}` ({}), row {}", column.name, column.kind, first + at as u64);
        assert_eq!(values.is_valid(at), expected.is_some(), "{place}");
        let items = values.items(at);
        let Some(expected) = expected else {
            assert!(!matches!(column.kind, Kind::List(_)) || items.is_empty(), "{place}");
            continue;
        };
        assert_eq!(items.len(), expected.len(), "{place}");
        for (item, expected) in items.zip(&expected) {
            assert_eq!(values.is_item_valid(item), expected.is_some(), "{place}");
            if let Some(expected) = expected {
                assert_eq!(values.item(item), Some(&expected[..]), "{place}");
            }
        }
    }
}

fn read(table: &Table, column: &Column, first: u64, count: usize, cursor: &mut Cursor) -> Values {
    let values = table.read(column, first, count, cursor);
    let values =
        values.unwrap_or_else(|error| panic!("`{}`, {count} rows from {first} on: {error}", column.name));
    assert_eq!(values.rows(), count);
    values
}

#[test]
fn all_rows_of_all_columns_are_as_they_were_written() {
    for name in TABLES {
        let table = open(name);
        assert!(table.rows() > 0 && !table.columns().is_empty());
        for column in table.columns() {
            let values = read(&table, column, 0, table.rows() as usize, &mut Cursor::default());
            check(name, column, 0, &values);
        }
    }
}

#[test]
fn parts_of_any_size_are_as_the_whole() {
    for name in TABLES {
        let (table, mut cursor) = (open(name), Cursor::default());
        for size in [1, 7, 400] {
            let mut first = 0;
            while first < table.rows() {
                let count = size.min((table.rows() - first) as usize);
                for column in table.columns() {
                    check(name, column, first, &read(&table, column, first, count, &mut cursor));
                }
                // Short reads jump over some rows.
                first += (count as u64).max(if size == 1 { 13 } else { 0 });
            }
        }
    }
}

#[test]
fn the_folder_holds_no_other_tables() {
    let mut names: Vec<String> =
        folder().read_dir().unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.retain(|name| name.ends_with(".lance") && !OTHERS.contains(&name.trim_end_matches(".lance")));
    names.sort();
    assert_eq!(names, TABLES.iter().map(|name| format!("{name}.lance")).collect::<Vec<_>>());
}

#[test]
fn rows_that_are_not_there_are_errors() {
    let table = open("borders_2_2");
    let column = &table.columns()[0];
    for (first, count) in [(table.rows(), 1), (0, table.rows() as usize + 1), (u64::MAX, 2)] {
        assert!(table.read(column, first, count, &mut Cursor::default()).is_err());
    }
    assert_eq!(table.read(column, table.rows(), 0, &mut Cursor::default()).unwrap().rows(), 0);
    let error = Table::open(&folder().join("missing.lance")).unwrap_err();
    assert!(!error.is_unsupported() && error.to_string().contains("_versions"), "{error}");
}

/// A clip of 4 rows, as training reads it.
#[test]
fn a_clip_reads_what_it_needs() {
    for (name, column, most) in
        [("large_2_2", "jpeg", 4 * 500 + 100), ("large_2_1", "image", 4 * 300), ("narrow_2_0", "vec", 32)]
    {
        let memory = Memory::of(name);
        let table = Table::open_in(Box::new(memory.clone())).unwrap();
        let (column, mut cursor) = (table.column(column).unwrap(), Cursor::default());
        read(&table, column, 0, 1, &mut cursor);
        let before = memory.read.load(Ordering::Relaxed);
        check(name, column, 3, &read(&table, column, 3, 4, &mut cursor));
        let bytes = memory.read.load(Ordering::Relaxed) - before;
        assert!(bytes <= most, "{name}, `{}`: {bytes} bytes for 4 rows", column.name);
    }
    // The chunk is there already.
    let memory = Memory::of("borders_2_2");
    let table = Table::open_in(Box::new(memory.clone())).unwrap();
    let (column, mut cursor) = (table.column("few").unwrap(), Cursor::default());
    read(&table, column, 100, 4, &mut cursor);
    let before = memory.read.load(Ordering::Relaxed);
    assert!(before < memory.files.values().map(|file| file.len() as u64).sum::<u64>() / 2);
    read(&table, column, 200, 4, &mut cursor);
    assert_eq!(memory.read.load(Ordering::Relaxed), before);
}

/// How many rows make.py wrote, and those that it left.
fn left(name: &str) -> (u64, Vec<u64>) {
    let is_deleted = |row: &u64| match name {
        "deleted" => [0, 1, 15, 16, 19, 20].contains(row) || (46..144).contains(row),
        _ => matches!((row / 60, row % 60), (20..105, _) | (3, 10..20) | (5, ..5) | (7, 55..)),
    };
    let rows = if name == "deleted" { 150 } else { 6600 };
    (rows, (0..rows).filter(|row| !is_deleted(row)).collect())
}

/// From lists for two fragments, one of which Zstandard compressed, and from a bitmap.
#[test]
fn deleted_rows_are_not_there() {
    for name in DELETED {
        let (table, (rows, left), mut cursor) = (open(name), left(name), Cursor::default());
        assert_eq!((table.rows(), table.deleted()), (left.len() as u64, rows - left.len() as u64));
        let behind = |at: &usize| left[*at] != at.checked_sub(1).map_or(0, |before| left[before] + 1);
        let gaps: Vec<u64> = (0..left.len()).filter(behind).map(|at| at as u64).collect();
        assert_eq!(table.gaps().collect::<Vec<_>>(), gaps, "{name}");
        for column in table.columns() {
            for size in [1, 7, left.len()] {
                for first in (0..left.len()).step_by(size) {
                    let count = size.min(left.len() - first);
                    let values = read(&table, column, first as u64, count, &mut cursor);
                    for (at, &row) in left[first..][..count].iter().enumerate() {
                        let expected = self::row(&column.name, row).and_then(|items| items[0].clone());
                        assert_eq!(values.item(at), expected.as_deref(), "{name}, `{}`, {row}", column.name);
                    }
                }
            }
        }
    }
}

#[test]
fn a_list_of_deleted_rows_that_is_gone_or_contradicts_the_manifest_is_an_error() {
    for name in DELETED {
        let memory = Memory::of(name);
        for path in memory.files.keys().filter(|path| path.starts_with("_deletions/")) {
            let mut without = memory.clone();
            without.files.remove(path);
            let error = Table::open_in(Box::new(without)).unwrap_err();
            assert!(!error.is_unsupported() && error.to_string().contains(path), "{error}");
        }
    }
    // The list of the other fragment.
    let mut memory = Memory::of("deleted");
    let lists: Vec<String> =
        memory.files.keys().filter(|path| path.starts_with("_deletions/")).cloned().collect();
    memory.files.insert(lists[1].clone(), memory.files[&lists[0]].clone());
    let error = Table::open_in(Box::new(memory)).unwrap_err();
    assert!(error.to_string().contains("5 rows are deleted, and the manifest records 99"), "{error}");
}
