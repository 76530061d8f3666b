//! OGBench's manipulation environments: an arm with a gripper, cubes, and furniture.

mod arm;
mod compose;
mod factors;
mod layout;
mod models;
mod pose;
mod settings;
