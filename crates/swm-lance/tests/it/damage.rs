//! Damaged tables: an error or values, without a panic, and with memory in proportion to the file.
