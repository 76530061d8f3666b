//! The only folder with `unsafe`: NumPy arrays over memory of the core, and tables over memory of NumPy and torch.
#![expect(unsafe_code, reason = "memory that the core and NumPy share")]

pub(crate) mod tables;
pub(crate) mod views;
