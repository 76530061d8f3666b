//! `swm ui`: one local web page that steers and records environments, and shows datasets and results.
//!
//! ```no_run
//! use swm_core::testing::TOY;
//! use swm_core::{EnvEntry, Registry};
//! use swm_ui::{Options, serve};
//!
//! const ENVS: &[EnvEntry] = &[TOY];
//! let options = Options::new(Registry::new().with(ENVS));
//! serve(options, |server| println!("open {}", server.url()))?;
//! # Ok::<(), swm_ui::UiError>(())
//! ```
//!
//! [`Server::bind`] takes a port of the loopback interface, [`Server::url`] is the address with its one-time token, and
//! [`Server::run`] serves until it is stopped or nobody has looked for a while. The page drives a `World` from outside
//! and adds no loop of its own (design page 16); its assets are part of the program.
//!
//! | module | duty |
//! |---|---|
//! | `guard` | token, cookie, `Host`, `Origin`, content security policy |
//! | `roots` | which files may be read and written |
//! | `play` | a WebSocket per live environment, and the thread that steps it |
//! | `data` | datasets: episodes, images, values, samples |
//! | `requests` | recordings, evaluations, sweeps and trainings that the page begins |
//! | `results` | receipts, manifests, sweeps, training curves, jobs |
//! | `connections` | closes those of strangers |
//! | `commands` | what is handed in: jobs as the command line has them |
//! | `server` | routes, limits, the idle stop |
//!
//! What is deliberately absent: environments, numerics, a file format, and any state that is not in files.

#![warn(clippy::print_stdout, clippy::print_stderr)] // They panic where the reader is gone or the disk full.

mod assets;
mod commands;
mod connections;
mod data;
mod error;
mod guard;
mod play;
mod requests;
mod results;
mod roots;
mod server;

pub use commands::Commands;
pub use error::UiError;
pub use server::{Options, SAVING, Server, serve};
