//! The open file of a recording with its datasets, and closing them. Nothing is read or written here.

use std::{io, mem};

use hdf5_metno as h5;
use swm_core::{Dtype, Field};

use super::layout::{EP_LEN, EP_OFFSET};
use crate::error::{At as _, FormatError, Result};
use crate::recording::EP_IDX;

/// A file open for writing, with its datasets.
#[derive(Debug)]
pub(super) struct Handles {
    pub(super) file: h5::File,
    pub(super) columns: Vec<h5::Dataset>,
    pub(super) ep_idx: h5::Dataset,
    pub(super) ep_len: h5::Dataset,
    pub(super) ep_offset: h5::Dataset,
}

impl Handles {
    /// Opens or makes every dataset by `open`.
    pub(super) fn new(
        file: h5::File,
        fields: &[Field],
        open: impl Fn(&h5::File, &Field) -> h5::Result<h5::Dataset>,
    ) -> Result<Self> {
        let open = |field: &Field| {
            open(&file, field).map_err(library_error).at(format_args!("column `{}`", field.name))
        };
        let columns = fields.iter().map(open).collect::<Result<_, _>>()?;
        let ep_idx = open(&Field::step(EP_IDX, Dtype::I32, &[]))?;
        let ep_len = open(&Field::step(EP_LEN, Dtype::I32, &[]))?;
        let ep_offset = open(&Field::step(EP_OFFSET, Dtype::I64, &[]))?;
        Ok(Self { file, columns, ep_idx, ep_len, ep_offset })
    }

    /// Does something first; if that fails, the file is left as it is.
    pub(super) fn prepared(self, prepare: impl FnOnce(&Self) -> Result<()>) -> Result<Self> {
        match prepare(&self) {
            Ok(()) => Ok(self),
            Err(error) => {
                self.abandon();
                Err(error)
            }
        }
    }

    /// Closes the file, which then opens like any other.
    pub(super) fn close(self) -> Result<()> {
        if let Err(error) = self.file.flush() {
            self.abandon();
            return Err(library_error(error));
        }
        let Self { file, columns, ep_idx, ep_len, ep_offset } = self;
        drop((columns, ep_idx, ep_len, ep_offset));
        file.close().map_err(library_error)
    }

    /// Leaves the file as it is now, as a kill would. After a failed write this is the only safe way: the library
    /// would try to write the same data again, and (in version 2.2) closing a dataset that cannot be written leaves
    /// a dangling pointer to it. The handles stay open until the process ends.
    pub(super) fn abandon(self) {
        mem::forget(self);
    }
}

/// Why the library failed: the operating system's reason where it gives one, without addresses and times.
pub(super) fn library_error(error: h5::Error) -> FormatError {
    let text = error.to_string();
    let system = text.split_once("errno = ").and_then(|(_, rest)| {
        let (number, rest) = rest.split_once(", error message = '")?;
        Some((io::Error::from_raw_os_error(number.parse().ok()?).kind(), rest.split_once('\'')?.0))
    });
    match system {
        Some((kind, message)) => io::Error::new(kind, message).into(),
        None => FormatError::other(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_gives_the_reason() {
        let error = h5::Error::from(
            "H5FD_write(): failed: time = now, errno = 28, error message = 'No space left on device', buf = 0x7f",
        );
        let error = library_error(error);
        assert_eq!(error.to_string(), "No space left on device");
        assert!(matches!(error, FormatError::Io(error) if error.kind() == io::ErrorKind::StorageFull));
        let error = library_error(h5::Error::from("H5Dopen(): no such object"));
        assert_eq!(error.to_string(), "H5Dopen(): no such object");
    }
}
