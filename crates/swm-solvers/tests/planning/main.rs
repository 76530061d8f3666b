//! Planning as its users see it: golden problems, obstacle courses, invariance, the MPC policy in a world, the true simulator.

mod constrained;
mod controller;
mod courses;
mod covariance;
mod descent;
mod golden;
mod golden_sampling;
mod gradients;
mod grasp;
mod ilqr;
mod models;
mod mpc;
mod problems;
mod sampling;
mod simulator;
mod solving;
mod traces;
mod units;
mod world_models;
mod worlds;
