//! Values of a Parquet column as they are stored: what the type of a column adds to them, and which of them are missing.

use parquet::basic::{ConvertedType, LogicalType, Repetition};
use parquet::column::reader::ColumnReaderImpl;
use parquet::data_type::DataType;
use parquet::schema::types::ColumnDescriptor;
use swm_data::error::{Result, invalid, missing, unsupported};

use super::table::not_parquet;

/// More values than this in a column of one file are taken for damage: the head of a file may claim any number.
pub(super) const MAX_VALUES: i64 = 1 << 28;

/// The values of some rows that are there, and which are missing between them.
pub(super) struct Values<T> {
    there: Vec<T>,
    /// Of each value, how far down the column's type it is there; empty where none can be missing.
    depths: Vec<i16>,
    /// Of each value, 0 where it begins a row; empty where a row is a value.
    repeats: Vec<i16>,
}

impl<T> Values<T> {
    pub(super) fn read<D: DataType<T = T>>(
        mut reader: ColumnReaderImpl<D>,
        column: &ColumnDescriptor,
        rows: usize,
    ) -> Result<Self> {
        let (has_depth, has_lists) = (column.max_def_level() > 0, column.max_rep_level() > 0);
        let (mut there, mut depths, mut repeats) = (Vec::new(), Vec::new(), Vec::new());
        let mut done = 0;
        while done < rows {
            let read = reader.read_records(
                rows - done,
                has_depth.then_some(&mut depths),
                has_lists.then_some(&mut repeats),
                &mut there,
            );
            let (records, ..) = read.map_err(not_parquet)?;
            if records == 0 {
                return Err(invalid(format!("{done} of {rows} rows are there")));
            }
            if there.len().max(depths.len()) as i64 > MAX_VALUES {
                return Err(invalid(format!("{} values", there.len().max(depths.len()))));
            }
            done += records;
        }
        Ok(Self { there, depths, repeats })
    }

    /// All of them, none of which may be missing.
    pub(super) fn whole(self) -> Result<Vec<T>> {
        match self.depths.len().saturating_sub(self.there.len()) {
            0 => Ok(self.there),
            count => Err(missing(format!(
                "{count} of its values are missing (null), which only floats and texts may be"
            ))),
        }
    }

    /// One of each row, and which are missing.
    pub(super) fn each(self, column: &ColumnDescriptor) -> Result<Vec<Option<T>>> {
        if !self.repeats.is_empty() {
            return Err(unsupported("its rows are lists"));
        }
        if self.depths.is_empty() {
            return Ok(self.there.into_iter().map(Some).collect());
        }
        let (full, mut there) = (column.max_def_level(), self.there.into_iter());
        Ok(self.depths.iter().map(|&depth| if depth == full { there.next() } else { None }).collect())
    }

    /// The same after a change of each.
    pub(super) fn map<U>(self, change: impl Fn(T) -> U) -> Values<U> {
        let there = self.there.into_iter().map(change).collect();
        Values { there, depths: self.depths, repeats: self.repeats }
    }
}

impl<T: Clone> Values<T> {
    /// All of them, with `other` in the place of each that is missing: other programs write a NaN as null. A row whose whole list is
    /// missing has as many as the others.
    pub(super) fn with_missing(self, column: &ColumnDescriptor, other: T) -> Result<Vec<T>> {
        if self.depths.len() <= self.there.len() {
            return Ok(self.there);
        }
        let full = column.max_def_level();
        let is_optional = column.self_type().get_basic_info().repetition() == Repetition::OPTIONAL;
        // Above this depth, a value is missing and not its list.
        let of_value = if is_optional { full - 1 } else { full };
        let is_first = |at: usize| self.repeats.get(at).is_none_or(|&repeat| repeat == 0);
        let is_value = |at: usize| self.depths[at] >= of_value;
        let starts: Vec<usize> = (0..self.depths.len()).filter(|&at| is_first(at)).collect();
        let ends = starts.iter().skip(1).copied().chain([self.depths.len()]);
        let rows = || starts.iter().copied().zip(ends.clone());
        let width = rows().find(|&(start, _)| is_value(start)).map(|(start, end)| end - start);
        let width = width.ok_or(missing("all of its values are missing (null)"))?;
        let (mut all, mut there) = (Vec::with_capacity(starts.len() * width), self.there.iter());
        for (start, end) in rows() {
            if end - start == 1 && !is_value(start) {
                all.extend(std::iter::repeat_n(other.clone(), width));
                continue;
            }
            for at in start..end {
                match self.depths[at] {
                    depth if depth == full => all.extend(there.next().cloned()),
                    _ if is_value(at) => all.push(other.clone()),
                    _ => return Err(missing("a part of a row is missing (null)")),
                }
            }
        }
        match all.len() as i64 > MAX_VALUES {
            true => Err(invalid(format!("{} values", all.len()))),
            false => Ok(all),
        }
    }
}

/// Whether a column holds whole numbers without a sign, of so many bits.
pub(super) fn is_unsigned(column: &ColumnDescriptor, bits: i8) -> bool {
    let converted = if bits == 64 { ConvertedType::UINT_64 } else { ConvertedType::UINT_32 };
    column.converted_type() == converted
        || column.logical_type_ref() == Some(&LogicalType::integer(bits, false))
}

/// Whether a column holds floats of 16 bits.
pub(super) fn is_half(column: &ColumnDescriptor) -> bool {
    column.logical_type_ref() == Some(&LogicalType::Float16) && column.type_length() == 2
}

/// The type of a column, for messages.
pub(super) fn type_name(column: &ColumnDescriptor) -> String {
    let physical = column.physical_type();
    match column.logical_type_ref() {
        Some(logical) => format!("{physical} ({logical:?})"),
        None => physical.to_string(),
    }
}
