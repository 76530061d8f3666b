//! What the workspace's end-to-end tests share.

pub mod golden;
