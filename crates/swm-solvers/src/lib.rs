//! Planning: costs, solvers, the MPC policy, planning on the true simulator.
