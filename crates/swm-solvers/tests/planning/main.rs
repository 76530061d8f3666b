//! Planning as its users see it: golden problems, invariance, the MPC policy in a world, the true simulator.

mod golden;
mod mpc;
mod problems;
mod simulator;
mod solving;
mod worlds;
