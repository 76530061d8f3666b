//! Tables that pylance 14.0.2 wrote. tests/golden/lance/README.md describes them.

mod formulas;
mod memory;
mod tables;
