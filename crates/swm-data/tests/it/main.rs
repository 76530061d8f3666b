//! Datasets as a user sees them: recording, reading, appending, damage, the loader, files of the reference.

#![expect(clippy::unwrap_used, reason = "helpers of tests panic as tests do")]

mod adapt;
mod append;
mod buffer;
mod compatibility;
mod crash;
mod damage;
mod damage_mcap;
#[cfg(unix)]
mod exhaustion;
mod exits;
mod folders;
mod golden;
mod hostile_hdf5;
#[cfg(unix)]
mod hostile_places;
#[cfg(unix)]
mod hostile_writes;
mod index;
mod loader;
mod loader_cache;
mod loader_properties;
mod loader_sharing;
mod mcap_order;
mod mutations;
mod parts;
#[cfg(target_os = "linux")]
mod power_loss;
mod round_trip;
mod statistics;
mod streams;
mod texts;
mod tools;
mod types;
mod unread;

// Other crates run the tests of every format on theirs: they have these names, too.
use swm_data::format::built_in as registry;
use swm_data::testing as support;
use swm_data::testing::copied;
use swm_data::testing::mutations::{mutate, play, seed};
use swm_data::tools::copy::copy;
use swm_data::{FORMATS, create, create_with, open};
