//! What the benchmarks share: worlds and scenes of PushT, and clocks that do not count what other programs do.
//!
//! No benchmark stands here; they are in `benches/` (criterion) and `peers/` (compared with the reference).

mod clock;
mod measurement;
mod planning;
mod pusht;

pub use clock::{Clock, Elapsed};
pub use measurement::{Measurement, print, seconds};
pub use planning::{FreeCost, SolveCase};
pub use pusht::{Actions, BareEnv, EPISODE_STEPS, Image, world, world_of};
