//! Datasets of layouts that a registry lacks, by the signs of [`super::known`]: a message says which crate reads them.

use std::path::Path;

use swm_core::Registry;

use super::known::{Sign, first_file, is_it};
use crate::entry::Layout;
use crate::error::DataError;
use crate::formats::hdf5;

/// What has the layouts, and the feature that one of them needs.
const CRATE: &str = "`swm-data-foreign`";
const PARQUET: &str = "minari-parquet";

/// Signs of what layouts of that crate read: what it is, and the name of the layout. More particular ones come first.
const READ: &[(Sign, &str, &str)] = &[
    (
        Sign::Folder(&["frames.lance", "meta/info.json"]),
        "a LeRobot dataset in the storage of Lance",
        "lance-table",
    ),
    (Sign::Folder(&["_versions/*.manifest"]), "a table of Lance", "lance-table"),
    (Sign::Folder(&["data/0/part-0.parquet"]), "a Minari dataset in Parquet", PARQUET),
    (Sign::Folder(&["0/part-0.parquet"]), "the data of a Minari dataset in Parquet", PARQUET),
    (Sign::Folder(&["data/main_data.hdf5"]), "a Minari dataset", "hdf5-groups"),
    (Sign::Folder(&["main_data.hdf5"]), "the data of a Minari dataset", "hdf5-groups"),
    (Sign::Hdf5(&["episode_*/observations"]), "the data of a Minari dataset", "hdf5-groups"),
    (Sign::Hdf5(&["data/demo_*"]), "a dataset of robomimic, LIBERO or MimicGen", "hdf5-groups"),
    (Sign::Hdf5(&["traj_*/actions"]), "a dataset of ManiSkill", "hdf5-groups"),
    (Sign::Hdf5(&["observations", "actions", "rewards", "terminals"]), "a dataset of D4RL", "d4rl"),
    (
        Sign::Hdf5(&["observation", "action", "reward", "discount", "step_type"]),
        "a dataset of V-D4RL",
        "vd4rl",
    ),
    (Sign::Hdf5(&["observations/qpos", "action"]), "a dataset of ALOHA", "aloha"),
    (Sign::Zip(&["observations.npy", "actions.npy", "terminals.npy"]), "a dataset of OGBench or PLDM", "npz"),
    (
        Sign::Zips(&["observations.npy", "actions.npy", "terminals.npy"]),
        "a dataset of OGBench or PLDM",
        "npz",
    ),
    (Sign::Zip(&["action.npy", "reward.npy", "is_first.npy"]), "an episode of DreamerV3", "dreamer"),
    (
        Sign::Zip(&["action.npy", "reward.npy", "discount.npy"]),
        "an episode of DreamerV2 or V-D4RL",
        "dreamer",
    ),
    (Sign::Zips(&["action.npy", "reward.npy", "is_first.npy"]), "a dataset of DreamerV3", "dreamer"),
    (
        Sign::Zips(&["action.npy", "reward.npy", "discount.npy"]),
        "a dataset of DreamerV2 or V-D4RL",
        "dreamer",
    ),
    (Sign::Zip(&["*meta/episode_ends/.zarray"]), "a Zarr replay buffer, as of UMI", "zarr"),
    (Sign::Zip(&["*meta/episode_ends/zarr.json"]), "a Zarr replay buffer, as of UMI", "zarr"),
    (Sign::Folder(&["meta/episode_ends"]), "a Zarr replay buffer, as of diffusion_policy and UMI", "zarr"),
    (Sign::Folder(&["dataset_info.json", "features.json"]), "an RLDS dataset", "rlds"),
    (Sign::Folder(&["states.pth"]), "a dataset of DINO-WM", "dino-wm"),
    (Sign::Folder(&["train/states.pth"]), "a dataset of DINO-WM", "dino-wm"),
];

/// The error for a dataset that a layout would read which the registry lacks.
pub(crate) fn unread(registry: &Registry, path: &Path) -> Option<DataError> {
    let mut lacking =
        READ.iter().filter_map(|row| Some((row, registry.find::<Layout>(row.2).err()?))).peekable();
    lacking.peek()?;
    // Of a folder of HDF5 files, the first.
    let first = first_file(path, "hdf5").or_else(|| first_file(path, "h5"));
    let members = hdf5::names(first.as_deref().unwrap_or(path));
    let ((_, name, layout), unknown) = lacking.find(|((sign, ..), _)| is_it(sign, path, &members))?;
    let fix = unknown.fix.unwrap_or_else(|| {
        let feature = if *layout == PARQUET { " with its feature `lerobot`" } else { "" };
        format!("no layout of this registry reads it: add the crate {CRATE}{feature}, and its layouts to the registry that reads")
    });
    Some(DataError::not_a_dataset(path, format!("it is {name}; {fix}")))
}
