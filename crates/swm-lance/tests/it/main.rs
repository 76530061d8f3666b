//! Tables that pylance 14.0.2 wrote. tests/golden/lance/README.md describes them.

#![expect(clippy::unwrap_used, reason = "helpers of tests panic as tests do")]

mod formulas;
mod memory;
mod tables;
