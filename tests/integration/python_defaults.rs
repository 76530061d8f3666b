//! The defaults in signatures of the Python package, compared with the tables of the requests. The sources are read, so that no
//! wheel is needed.

use std::fs;
use std::path::Path;

use swm::core::Setting;
use swm::core::settings::Settings as _;
use swm::tasks::request::{
    Bench, Convert, Diff, Evaluate, Inspect, MakeBoard, MakeBundle, MakeManifest, Measure, Merge, Plan,
    Preview, Render, Replay, Split, Stats, Sweep, Train, Verify,
};

/// Functions of the package: their file, name, and the settings of their request.
const FUNCTIONS: &[(&str, &str, &[Setting])] = &[
    ("_train.py", "train", Train::SETTINGS),
    ("data/contents.py", "diff", Diff::SETTINGS),
    ("data/contents.py", "inspect", Inspect::SETTINGS),
    ("data/contents.py", "preview", Preview::SETTINGS),
    ("data/contents.py", "stats", Stats::SETTINGS),
    ("data/contents.py", "verify", Verify::SETTINGS),
    ("data/utils.py", "convert", Convert::SETTINGS),
    ("data/utils.py", "merge", Merge::SETTINGS),
    ("data/utils.py", "split_files", Split::SETTINGS),
    ("world/bundles.py", "board", MakeBoard::SETTINGS),
    ("world/bundles.py", "bundle", MakeBundle::SETTINGS),
    ("world/manifests.py", "make_manifest", MakeManifest::SETTINGS),
    ("world/receipts.py", "evaluate", Evaluate::SETTINGS),
    ("world/receipts.py", "verify", MakeBoard::SETTINGS),
    ("world/requests.py", "bench", Bench::SETTINGS),
    ("world/requests.py", "measure", Measure::SETTINGS),
    ("world/requests.py", "plan", Plan::SETTINGS),
    ("world/requests.py", "render", Render::SETTINGS),
    ("world/requests.py", "replay", Replay::SETTINGS),
    ("world/sweeps.py", "sweep", Sweep::SETTINGS),
];

/// Parameters whose settings have another name.
const NAMES: &[(&str, &str)] = &[
    ("distractors", "distractor"),
    ("env_name", "env"),
    ("image_shape", "image_size"),
    ("key_frame_period", "key_frames"),
    ("max_episode_steps", "max_steps"),
    ("references", "reference"),
    ("variation", "vary"),
    ("variation_values", "set"),
];

/// Parameters of a function with their defaults, as the source has them. Of several declarations the last is the function.
fn parameters(source: &str, function: &str) -> Vec<(String, String)> {
    let begins = format!("\ndef {function}(");
    let at = source.rfind(&begins).unwrap_or_else(|| panic!("no function `{function}`"));
    let signature = source[at + begins.len()..].split(") ->").next().unwrap_or_default();
    let lines = signature.lines().map(|line| line.trim().trim_end_matches(','));
    let each = lines.filter_map(|line| {
        let (parameter, default) = line.rsplit_once(" = ")?;
        Some((parameter.split(':').next()?.to_owned(), default.to_owned()))
    });
    each.collect()
}

/// The text of a value as tables of settings have it; `None`: the core chooses, or the value is no plain one.
fn plain(default: &str) -> Option<String> {
    match default {
        "True" => Some("true".to_owned()),
        "False" => Some("false".to_owned()),
        text if text.starts_with('"') => Some(text.trim_matches('"').to_owned()),
        number => number.parse::<f64>().ok().map(|number| number.to_string()),
    }
}

fn differences(
    source: &str,
    function: &str,
    settings: &[Setting],
    compared: &mut Vec<String>,
) -> Vec<String> {
    let mut wrong = Vec::new();
    for (parameter, default) in parameters(source, function) {
        let renamed = NAMES.iter().find(|(python, _)| *python == parameter);
        let name = renamed.map_or(parameter.as_str(), |(_, setting)| *setting);
        let Some(setting) = settings.iter().find(|setting| setting.name == name) else { continue };
        let Some(value) = plain(&default) else { continue };
        let number = setting.default.parse::<f64>().ok().map(|number| number.to_string());
        if value != number.unwrap_or_else(|| setting.default.to_owned()) {
            wrong.push(format!("{function}({parameter}={default}): `{}` in the request", setting.default));
        }
        compared.push(format!("{function}({parameter}={default})"));
    }
    wrong
}

#[test]
fn signatures_have_the_defaults_of_the_requests() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates/swm-py/python/stable_worldmodel_rs");
    let (mut wrong, mut compared) = (Vec::new(), Vec::new());
    for (file, function, settings) in FUNCTIONS {
        let source = fs::read_to_string(package.join(file)).unwrap();
        wrong.extend(differences(&source, function, settings, &mut compared));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    for known in ["make_manifest(seed=42)", "evaluate(num_envs=8)", "verify(num_envs=8)", "board(num_envs=8)"]
    {
        assert!(compared.iter().any(|one| one == known), "{known}: {compared:?}");
    }
}

#[test]
fn another_default_is_found() {
    let source = "\ndef board(\n    out: int = 1,\n) -> None:\n\ndef board(\n    out: AnyPath,\n    *,\n    title: str = \"Others\",\n    \
                  num_envs: int = 16,\n    rerun: bool = True,\n    threads: int | None = None,\n) -> None:\n";
    let mut compared = Vec::new();
    let wrong = differences(source, "board", MakeBoard::SETTINGS, &mut compared);
    let expected = ["title=\"Others\"): `Results`", "num_envs=16): `8`", "rerun=True): `false`"];
    assert_eq!(wrong, expected.map(|part| format!("board({part} in the request")));
    assert_eq!(compared.len(), 3);
}
