//! One folder per dataset format; each exports one `FORMAT` for the table in `format`.

pub(crate) mod hdf5;
