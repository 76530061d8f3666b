//! What the workspace's end-to-end tests share.

pub mod golden;

/// The examples of the README are tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;

/// The examples of the page about planning, too.
#[cfg(doctest)]
#[doc = include_str!("../../docs/solvers.md")]
pub struct Planning;

/// And those of the page about data.
#[cfg(doctest)]
#[doc = include_str!("../../docs/data.md")]
pub struct Data;
