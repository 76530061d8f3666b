//! Recorded trajectories of the reference, and what policies reach.

mod episodes;
mod replay;
