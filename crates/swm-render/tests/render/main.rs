//! Integration tests of the renderers, in one binary.

mod golden;
mod incremental;
mod scenes;
