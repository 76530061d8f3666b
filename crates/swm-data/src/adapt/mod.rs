//! Datasets made of datasets: some episodes of one, several end to end, columns of two, constant columns, columns
//! joined or kept in memory, images of another size, reading that can be ended. Each is a [`Dataset`](crate::Dataset) again, so they nest, and everything that reads a dataset reads them.

mod area;
mod cached;
mod columns;
mod concat;
mod constants;
pub(crate) mod inner;
mod joined;
mod opened;
mod resized;
mod subset;
mod watched;

pub use cached::Cached;
pub use columns::Columns;
pub use concat::Concat;
pub use constants::{Constants, fill_factors};
pub use joined::Joined;
pub use opened::opened_with;
pub use resized::{Fit, Resized};
pub use subset::{Subset, split_episodes};
pub use watched::Watched;
