//! Which crate may depend on which: the arrows of docs/ARCHITECTURE.md.

use super::Violation;
use crate::metadata::Metadata;

/// Each crate of the workspace and the crates of the workspace it may name in its manifest, for tests too: a test that
/// needs more belongs in `tests/`. A name that ends with `*` stands for a family.
const ARROWS: &[(&str, &[&str])] = &[
    ("swm-core", &[]),
    // For its errors, with a feature of its own.
    ("swm-render", &["swm-core"]),
    ("swm-files", &["swm-core"]),
    ("swm-media", &[]),
    ("swm-lance", &[]),
    ("swm-fov", &["swm-core"]),
    ("swm-mujoco", &["swm-core", "swm-render"]),
    ("swm-envs-mujoco", &["swm-core", "swm-fov", "swm-mujoco", "swm-render"]),
    ("swm-envs-*", &["swm-core", "swm-fov", "swm-render"]),
    ("swm-solvers", &["swm-core"]),
    ("swm-data", &["swm-core", "swm-files", "swm-media", "swm-render"]),
    ("swm-data-lerobot", &["swm-core", "swm-files", "swm-media", "swm-data"]),
    (
        "swm-data-foreign",
        &["swm-core", "swm-files", "swm-lance", "swm-media", "swm-data", "swm-data-lerobot"],
    ),
    ("swm-data-lance", &["swm-core", "swm-files", "swm-media", "swm-data"]),
    ("swm-nn", &["swm-core"]),
    ("swm-weights", &[]),
    (
        "swm-baselines",
        &["swm-core", "swm-files", "swm-nn", "swm-weights", "swm-solvers", "swm-data", "swm-tasks"],
    ),
    (
        "swm-checkpoints",
        // Tests of settings open datasets of other programs.
        &[
            "swm-core",
            "swm-files",
            "swm-nn",
            "swm-weights",
            "swm-solvers",
            "swm-data",
            "swm-data-foreign",
            "swm-tasks",
            "swm-baselines",
        ],
    ),
    ("swm-onnx", &["swm-core", "swm-solvers"]),
    (
        "swm-tasks",
        &["swm-core", "swm-files", "swm-fov", "swm-media", "swm-solvers", "swm-data", "swm-data-foreign"],
    ),
    ("swm-jobs", &["swm-core", "swm-files", "swm-data", "swm-tasks"]),
    ("swm-ui", &["swm-core", "swm-files", "swm-media", "swm-solvers", "swm-data", "swm-tasks"]),
    ("swm", &["swm-*"]),
    ("swm-py", &["swm"]),
    ("swm-tests", &["swm", "swm-*"]),
    ("swm-benches", &["swm", "swm-*"]),
    ("xtask", &["swm", "swm-*"]),
];

/// What nothing depends on.
const LEAVES: &[&str] = &["swm-py", "swm-tests", "swm-benches", "xtask"];

/// Families of crates that must not be built into swm-core: tensors, file formats, images, physics.
const HEAVY: &[&str] = &[
    "arrow",
    "burn",
    "candle",
    "faer",
    "nalgebra",
    "ndarray",
    "ort",
    "tch",
    "tract", // tensors
    "hdf5",
    "lance",
    "mcap",
    "npyz",
    "parquet",
    "tiff",
    "zarrs",
    "zip", // file formats
    "ffmpeg",
    "gif",
    "image",
    "jpeg",
    "openh264",
    "png",
    "tiny-skia",
    "zune", // images
    "mujoco",
    "parry",
    "rapier", // physics
];

/// Crates of the workspace that name one which lies above them or on their layer.
pub(super) fn arrows(metadata: &Metadata) -> Vec<Violation> {
    let members: Vec<&str> = metadata.members().map(|package| package.name.as_str()).collect();
    let mut violations = Vec::new();
    for package in metadata.members() {
        let Some((_, allowed)) = ARROWS.iter().find(|(pattern, _)| matches(pattern, &package.name)) else {
            violations.push(Violation::new(
                &package.name,
                "has no layer: add it to ARROWS in xtask/src/tidy/layers.rs and to docs/ARCHITECTURE.md",
            ));
            continue;
        };
        let ours = package.dependencies.iter().map(|dependency| dependency.name.as_str());
        for name in ours.filter(|name| members.contains(name)) {
            let is_allowed = allowed.iter().any(|pattern| matches(pattern, name)) && !LEAVES.contains(&name);
            if !is_allowed {
                let allowed =
                    if allowed.is_empty() { "none of the workspace".into() } else { allowed.join(", ") };
                violations.push(Violation::new(
                    &package.name,
                    format!("depends on {name}; it may depend on: {allowed}"),
                ));
            }
        }
    }
    violations
}

/// Crates in a build of swm-core that make it heavy.
pub(super) fn light_core(metadata: &Metadata) -> Vec<Violation> {
    let Some(core) = metadata.members().find(|package| package.name == "swm-core") else { return Vec::new() };
    let heavy = metadata
        .built_into(core)
        .into_iter()
        .filter(|name| HEAVY.iter().any(|family| is_of_family(family, name)));
    heavy
        .map(|name| {
            let message = format!("is built with {name}: move what needs it into the crate whose duty it is");
            Violation::new("swm-core", message)
        })
        .collect()
}

fn matches(pattern: &str, name: &str) -> bool {
    pattern.strip_suffix('*').map_or(pattern == name, |start| name.starts_with(start))
}

/// `rapier2d` and `rapier-testbed` are of the family `rapier`; `imagery` is not of the family `image`.
fn is_of_family(family: &str, name: &str) -> bool {
    name.strip_prefix(family).is_some_and(|rest| !rest.starts_with(|c: char| c.is_ascii_alphabetic()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metadata::fixture;

    #[test]
    fn the_layers_of_the_design_pass() {
        let metadata = fixture(
            "swm-core:\nswm-fov: swm-core\nswm-render:\nswm-envs-2d: swm-core swm-fov swm-render\n\
             swm-solvers: swm-core ~proptest\nswm-data: swm-core\nswm: swm-core swm-data swm-envs-2d\n\
             swm-tests: swm\nxtask: swm-data\n-proptest:",
        );
        assert_eq!(arrows(&metadata), []);
    }

    #[test]
    fn arrows_that_point_up_or_sideways_are_found_in_tests_too() {
        let metadata = fixture(
            "swm-core:\nswm-data: swm-solvers\nswm-envs-2d: swm-data\nswm-solvers: ~swm-envs-2d\nswm-tests:\nswm: swm-tests",
        );
        let found: Vec<String> = arrows(&metadata)
            .into_iter()
            .map(|violation| violation.place + ": " + &violation.message)
            .collect();
        assert_eq!(
            found,
            [
                "swm-data: depends on swm-solvers; it may depend on: swm-core, swm-files, swm-media, swm-render",
                "swm-envs-2d: depends on swm-data; it may depend on: swm-core, swm-fov, swm-render",
                "swm-solvers: depends on swm-envs-2d; it may depend on: swm-core",
                "swm: depends on swm-tests; it may depend on: swm-*",
            ]
        );
    }

    #[test]
    fn a_crate_without_a_layer_is_found() {
        assert_eq!(arrows(&fixture("surprise:"))[0].place, "surprise");
    }

    #[test]
    fn a_heavy_crate_behind_another_is_found_in_core() {
        let metadata = fixture("swm-core: helper ~png\n-helper: rapier2d serde\n-rapier2d:\n-serde:\n-png:");
        let found = light_core(&metadata);
        assert_eq!(found.len(), 1);
        assert!(found[0].message.contains("rapier2d"), "{}", found[0].message);
    }

    #[test]
    fn families_end_at_a_word() {
        assert!(
            is_of_family("burn", "burn-tensor")
                && is_of_family("parry", "parry3d")
                && is_of_family("ort", "ort")
        );
        assert!(!is_of_family("image", "imagery") && !is_of_family("ort", "sort"));
    }
}
