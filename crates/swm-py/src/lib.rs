//! `_swm`: the compiled half of the Python package `stable_worldmodel_rs`.
//!
//! One file per subject, each with a function `add` that puts its classes into the module. What is glue or needs torch is
//! Python, beside this crate in `python/stable_worldmodel_rs`.

#![expect(clippy::needless_pass_by_value, reason = "PyO3 hands arguments over by value")]

mod arrays;
mod checkpoints;
mod cost;
mod dataset;
mod errors;
mod evaluate;
mod evaluation;
mod fork;
mod infos;
mod integers;
mod interrupt;
mod loader;
mod manifest;
mod media;
mod memory;
mod mirror;
mod policy;
mod program;
mod receipt;
mod record;
mod report;
mod requests;
mod runs;
mod solver;
mod statistics;
mod sweep;
mod words;
mod world;
mod writer;
mod zoo;

use pyo3::prelude::*;

/// The compiled half of `stable_worldmodel_rs`: import that package instead.
#[pymodule(name = "_swm")]
fn swm_module(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("HAS_TRAINING", cfg!(feature = "baselines"))?;
    dataset::add(m)?;
    errors::add(m)?;
    evaluate::add(m)?;
    evaluation::add(m)?;
    fork::add(m)?;
    loader::add(m)?;
    manifest::add(m)?;
    media::add(m)?;
    program::add(m)?;
    receipt::add(m)?;
    record::add(m)?;
    checkpoints::add(m)?;
    requests::add(m)?;
    solver::add(m)?;
    statistics::add(m)?;
    sweep::add(m)?;
    world::add(m)?;
    writer::add(m)?;
    zoo::add(m)?;
    Ok(())
}
