//! The only `unsafe` code of this crate: NumPy views into columns of the core, and tables over memory that Python owns.
