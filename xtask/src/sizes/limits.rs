//! What must not be in a build, whatever features are chosen, and what each feature of `swm` alone may bring.

use super::builds::Choice;
use crate::cargo_tree::CargoTree;

/// Heavy parts, by a crate that stands for each.
const TENSORS: &str = "burn";
const GPU: &str = "cubecl-cuda";
const HDF5: &str = "hdf5-metno";
const LANCE: &str = "lance-core";
const MATRICES: &str = "faer";
const MUJOCO: &str = "swm-mujoco";
const ONNX: &str = "ort";
const NETWORK: &str = "ureq-proto";
const PARQUET: &str = "parquet";
const PHYSICS_2D: &str = "rapier2d-f64";
const PHYSICS_3D: &str = "rapier3d-f64";
const VIDEOS: &str = "openh264";
const SHELL: &str = "clap";
const WEB: &str = "axum";

/// What crates keep out, but for what they are there for.
const HEAVY: &[&str] =
    &[TENSORS, HDF5, LANCE, MATRICES, MUJOCO, NETWORK, ONNX, PARQUET, PHYSICS_2D, PHYSICS_3D, VIDEOS, SHELL];

/// Crates, the heavy parts that features of theirs may pull in, and what else none does.
const LIMITS: &[(&str, &[&str], &[&str])] = &[
    ("swm-core", &[], &["swm-render", "png"]),
    ("swm-fov", &[], &["swm-render", "png"]),
    ("swm-files", &[NETWORK], &["swm-render", "png"]),
    ("swm-render", &[], &["png"]),
    ("swm-media", &[VIDEOS], &["swm-core"]),
    ("swm-lance", &[], &["swm-core", "png"]),
    ("swm-envs-2d", &[PHYSICS_2D], &["swm-data", "swm-solvers"]),
    ("swm-envs-3d", &[PHYSICS_3D], &["swm-data", "swm-solvers"]),
    ("swm-mujoco", &[MUJOCO], &["swm-data", "swm-fov", "swm-solvers"]),
    ("swm-envs-mujoco", &[MUJOCO], &["swm-data", "swm-solvers"]),
    ("swm-solvers", &[MATRICES], &["swm-data", "swm-render"]),
    ("swm-data", &[HDF5, NETWORK, VIDEOS], &["swm-solvers"]),
    ("swm-data-foreign", &[HDF5, NETWORK, PARQUET, VIDEOS], &["swm-solvers"]),
    ("swm-data-lance", &[HDF5, LANCE, PARQUET, VIDEOS], &["swm-solvers"]),
    ("swm-data-lerobot", &[HDF5, PARQUET, VIDEOS], &["swm-solvers"]),
    ("swm-onnx", &[MATRICES, ONNX], &["swm-data", "swm-render"]),
    ("swm-tasks", &[HDF5, MATRICES], &[]),
    ("swm-jobs", &[HDF5], &[]),
    ("swm-ui", &[HDF5], &[]),
    ("swm-nn", &[TENSORS], &["swm-data", "swm-solvers"]),
    ("swm-weights", &[], &["swm-core", "png"]),
    ("swm-checkpoints", &[TENSORS, HDF5, MATRICES, NETWORK, VIDEOS], &[]),
    // CUDA's build script fetches LLVM.
    ("swm-baselines", &[TENSORS, HDF5, MATRICES, NETWORK, VIDEOS], &[]),
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
    ("remote", NETWORK),
    ("ui", WEB),
];

/// Features that turn on another one.
const IMPLIES: &[(&str, &str)] =
    &[("cuda", "baselines"), ("cuda", "remote"), ("lance", "mp4"), ("lerobot", "mp4")];

/// One line for each crate that is in a build and must not be, or is not and should be.
pub(super) fn offences(choice: &Choice, tree: &CargoTree) -> Vec<String> {
    let name = choice.name();
    let has = |part: &str| tree.dependencies().any(|unit| unit.name == part);
    let own = LIMITS.iter().filter(|(package, ..)| *package == choice.build.package);
    let never = own.flat_map(|(_, allowed, others)| {
        others.iter().chain(HEAVY.iter().filter(|part| !allowed.contains(part)))
    });
    let never = never.filter(|part| has(part));
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
