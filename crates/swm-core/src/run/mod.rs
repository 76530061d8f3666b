//! What a run of episodes is made of: which episodes ([`Rollout`]), how the world is built ([`WorldOptions`]), where an
//! environment stands ([`LiveEpisode`]), and how an episode ended ([`EpisodeEnd`]).

mod episode;
mod info;
mod options;
mod rollout;
mod slot;

pub use episode::{EpisodeEnd, LiveEpisode, Margins};
pub use info::RunInfo;
pub use options::{MAX_FRAME_SKIP, WorldOptions};
pub use rollout::{Cancel, Rollout};
pub(crate) use slot::{Progress, Slot};
