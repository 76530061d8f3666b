//! What must not be in a build, whatever features are chosen, and what each feature of `swm` alone may bring.

use super::builds::Choice;
use crate::cargo_tree::CargoTree;

/// Heavy parts, by a crate that stands for each.
const TENSORS: &str = "burn";
const GPU: &str = "cubecl-cuda";
const HDF5: &str = "hdf5-metno";
const LANCE: &str = "lance-core";
const MATRICES: &str = "faer";
const MUJOCO: &str = "swm-envs-mujoco";
const ONNX: &str = "ort";
const PARQUET: &str = "parquet";
const PHYSICS_2D: &str = "rapier2d-f64";
const PHYSICS_3D: &str = "rapier3d-f64";
const VIDEOS: &str = "openh264";
const SHELL: &str = "clap";
const WEB: &str = "axum";

/// What the lowest crates keep out: all of it, and images.
const ALL_HEAVY: &[&str] = &[
    "swm-render",
    "png",
    TENSORS,
    HDF5,
    LANCE,
    MATRICES,
    MUJOCO,
    ONNX,
    PARQUET,
    PHYSICS_2D,
    PHYSICS_3D,
    VIDEOS,
    SHELL,
];

/// Crates and what no feature of theirs pulls in.
const NEVER: &[(&str, &[&str])] = &[
    ("swm-core", ALL_HEAVY),
    ("swm-fov", ALL_HEAVY),
    (
        "swm-render",
        &[
            "swm-core", "png", TENSORS, HDF5, LANCE, MATRICES, MUJOCO, ONNX, PARQUET, PHYSICS_2D, PHYSICS_3D,
            VIDEOS, SHELL,
        ],
    ),
    (
        "swm-media",
        &["swm-core", TENSORS, HDF5, LANCE, MATRICES, MUJOCO, ONNX, PARQUET, PHYSICS_2D, PHYSICS_3D, SHELL],
    ),
    (
        "swm-envs-2d",
        &[
            "swm-data",
            "swm-solvers",
            TENSORS,
            HDF5,
            LANCE,
            MATRICES,
            MUJOCO,
            ONNX,
            PARQUET,
            PHYSICS_3D,
            VIDEOS,
            SHELL,
        ],
    ),
    (
        "swm-envs-3d",
        &[
            "swm-data",
            "swm-solvers",
            TENSORS,
            HDF5,
            LANCE,
            MATRICES,
            MUJOCO,
            ONNX,
            PARQUET,
            PHYSICS_2D,
            VIDEOS,
            SHELL,
        ],
    ),
    (
        "swm-envs-mujoco",
        &[
            "swm-data",
            "swm-solvers",
            TENSORS,
            HDF5,
            LANCE,
            MATRICES,
            ONNX,
            PARQUET,
            PHYSICS_2D,
            PHYSICS_3D,
            VIDEOS,
            SHELL,
        ],
    ),
    (
        "swm-solvers",
        &[
            "swm-data",
            "swm-render",
            TENSORS,
            HDF5,
            LANCE,
            MUJOCO,
            ONNX,
            PARQUET,
            PHYSICS_2D,
            PHYSICS_3D,
            VIDEOS,
            SHELL,
        ],
    ),
    ("swm-data", &["swm-solvers", TENSORS, LANCE, MATRICES, MUJOCO, ONNX, PHYSICS_2D, PHYSICS_3D, SHELL]),
    ("swm-data-lance", &["swm-solvers", TENSORS, MATRICES, MUJOCO, ONNX, PHYSICS_2D, PHYSICS_3D, SHELL]),
    (
        "swm-onnx",
        &[
            "swm-data",
            "swm-render",
            TENSORS,
            HDF5,
            LANCE,
            MUJOCO,
            PARQUET,
            PHYSICS_2D,
            PHYSICS_3D,
            VIDEOS,
            SHELL,
        ],
    ),
    ("swm-ui", &[TENSORS, LANCE, MATRICES, MUJOCO, ONNX, PARQUET, PHYSICS_2D, PHYSICS_3D, VIDEOS, SHELL]),
    ("swm-baselines", &[LANCE, MUJOCO, ONNX, PARQUET, PHYSICS_2D, PHYSICS_3D, SHELL]),
];

/// Features of `swm` and the heavy parts that they alone bring.
const ONLY_WITH: &[(&str, &str)] = &[
    ("baselines", TENSORS),
    ("cli", SHELL),
    ("cuda", GPU),
    ("faer", MATRICES),
    ("lance", LANCE),
    ("lerobot", PARQUET),
    ("mp4", VIDEOS),
    ("mujoco", MUJOCO),
    ("onnx", ONNX),
    ("rapier", PHYSICS_2D),
    ("rapier", PHYSICS_3D),
    ("ui", WEB),
];

/// Features that turn on another one.
const IMPLIES: &[(&str, &str)] = &[("cuda", "baselines"), ("lance", "mp4"), ("lerobot", "mp4")];

/// One line for each crate that is in a build and must not be, or is not and should be.
pub(super) fn offences(choice: &Choice, tree: &CargoTree) -> Vec<String> {
    let name = choice.name();
    let has = |part: &str| tree.dependencies().any(|unit| unit.name == part);
    let never = NEVER.iter().filter(|(package, _)| *package == choice.build.package);
    let never = never.flat_map(|(_, parts)| *parts).filter(|part| has(part));
    let mut offences: Vec<String> = never.map(|part| format!("{name} pulls in {part}")).collect();
    if choice.build.package == "swm" && !choice.build.default_features {
        for (feature, part) in ONLY_WITH {
            let is_on = choice.called == *feature;
            let is_implied = IMPLIES.contains(&(&choice.called, feature));
            if has(part) && !is_on && !is_implied {
                offences.push(format!("{name} pulls in {part}, which is the feature `{feature}`'s"));
            } else if is_on && !has(part) {
                offences.push(format!("{name} does not pull in {part}: who does?"));
            }
        }
    }
    offences
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cargo_tree::{Build, Unit};

    fn check(package: &str, called: &str, parts: &[&str], expected: &[&str]) {
        let unit = |name: &&str| Unit { name: (*name).into(), version: "1.0.0".into() };
        let tree = CargoTree {
            root: unit(&package),
            edges: parts.iter().map(|name| (unit(name), [].into())).collect(),
        };
        let build = Build { package: package.into(), default_features: false, features: Vec::new() };
        assert_eq!(offences(&Choice { called: called.into(), build }, &tree), expected);
    }

    #[test]
    fn heavy_parts_are_found_where_they_must_not_be() {
        check("swm-core", "none", &["rand", "serde"], &[]);
        check("swm-core", "none", &["rand", "burn"], &["swm-core:none pulls in burn"]);
        check("swm", "none", &["hdf5-metno"], &[]);
        check("swm", "cli", &["clap", "faer"], &["swm:cli pulls in faer, which is the feature `faer`'s"]);
        check("swm", "lerobot", &["parquet", "openh264"], &[]);
        check("swm", "faer", &[], &["swm:faer does not pull in faer: who does?"]);
    }
}
