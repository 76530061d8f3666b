//! What the readers of datasets of other programs share with copies, loaders and formats, and what such a dataset is where nothing reads
//! it. The readers are in the crate `swm-data-foreign`; its layouts are entries of a registry.

mod known;
mod lerobot;
mod source;
mod unread;

pub(crate) use known::{mcap, of_hdf5, recognize};
pub(crate) use unread::unread;

pub use known::BRING;
pub use lerobot::{LEROBOT_NAMES, is_lerobot_in_lance, lerobot_info};
pub use source::{REWARDS_NOTE, RewardsAt, source_record};
