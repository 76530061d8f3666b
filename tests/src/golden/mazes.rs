//! OGBench's humanoid maze and AntSoccer: everything equal to the bit from the recorded start on, but for the places of the humanoid's
//! hands and feet in the frame of its torso: products of matrices, which the linear algebra of NumPy rounds otherwise. Runs are named after their
//! maze, files after the environments without their versions.

use serde_json::{Map, Value as Json};

use super::file::GoldenFile;
use super::rules::{ImageTolerance, Rules, Tolerance, Unit};

/// The humanoid's observation: 24 values before its hands and feet.
const HUMANOID_OBSERVATION: [Unit; 69] = {
    let mut units = [Unit::Given; 69];
    let mut index = 24;
    while index < 36 {
        units[index] = Unit::Reward;
        index += 1;
    }
    units
};

/// Rules by the number of values in positions and velocities, and the observation's units.
macro_rules! maze {
    ($name:ident, $recorded:literal, $id:literal, $nq:literal, $nv:literal, $observation:expr) => {
        pub(super) const $name: Rules = Rules {
            reference_id: $recorded,
            env_id: $id,
            settings: |settings| {
                settings.insert("terminate_at_goal".to_owned(), false.into());
            },
            compared: &[
                ("state_qpos", &[Unit::Given; $nq]),
                ("state_qvel", &[Unit::Given; $nv]),
                ("state_time", &[Unit::Given]),
                ("state_qacc_warmstart", &[Unit::Given; $nv]),
                ("obs", &$observation),
                ("goal_xy", &[Unit::Given; 2]),
                ("goal_observation", &$observation),
                ("reward", &[Unit::Given]),
                ("is_success", &[Unit::Given]),
                ("terminated", &[Unit::Given]),
            ],
            tolerance: [Tolerance { px: 1e-15, rad: 0.0, px_per_s: 0.0 }; 2],
            images: ImageTolerance { equal_pixels: 0.0, largest_difference: 255 },
            steps: usize::MAX,
            starts: &[],
            adapt: |_| Vec::new(),
            expected_differences: &[],
        };
    };
}

maze!(HUMANOID, "swm/OGBHumanoidMaze", "swm/OGBHumanoidMaze-v0", 28, 27, HUMANOID_OBSERVATION);
maze!(ANT_SOCCER, "swm/OGBAntSoccer", "swm/OGBAntSoccer-v0", 22, 20, [Unit::Given; 42]);

/// The maze of a run, which its name tells.
pub(super) fn set_maze(file: &GoldenFile, settings: &mut Map<String, Json>) {
    if [HUMANOID.reference_id, ANT_SOCCER.reference_id].contains(&file.env_id.as_str())
        && let Some((_, maze)) = file.name.rsplit_once(' ')
    {
        settings.insert("maze_type".to_owned(), maze.into());
    }
}
