//! A published result is repeated from a recipe: found, imported, evaluated, compared, and not done twice.

use std::path::Path;

use swm_checkpoints::reproduce::Reproduce;
use swm_checkpoints::{MODELS, POLICIES};
use swm_core::Registry;
use swm_tasks::evaluation::read_receipt;
use swm_tasks::request::{Fix, Message, Request as _, TaskError};

use super::dot::{DOT, SIDE};
use super::record;

/// The recipe of a checkpoint of the reference's own, in the environment of these tests.
fn recipe(folder: &Path, sha256: Option<&str>) -> Reproduce {
    let text = format!(
        r#"
name = "lewm-dot"
about = "a test"
env = "{}"
image = {SIDE}

[checkpoint]
model = "lewm"
repository = "nobody-here/lewm-dot"
revision = "main"
weights = "weights.pt"
{}

[dataset]
name = "data.h5"
size = "2 kB"

[policy]
samples = 6
elites = 2
iterations = 1
horizon = 2
receding_horizon = 2

[[figure]]
name = "historic"
protocol = "rows of all episodes"
reported = 0.0
std = 1.5
source = "a paper"

[figure.made]
tier = "historic"
episodes = 3
goal_offset = 4
budget = 4
seeds = [0, 1]

[[figure]]
name = "moderate"
protocol = "held-out episodes"
reported = 99.0
source = "another paper"

[figure.made]
tier = "moderate"
episodes = 2
goal_offset = 4
budget = 4
held_out = 1.0
seeds = [42]
"#,
        DOT.id,
        sha256.map_or(String::new(), |hash| format!("sha256 = \"{hash}\""))
    );
    let path = folder.join("recipe.toml");
    std::fs::write(&path, text).expect("the folder is there");
    Reproduce {
        recipe: Some(path),
        folder: Some(folder.to_owned()),
        out: folder.join("out"),
        num_envs: 2,
        threads: Some(1),
        ..Reproduce::default()
    }
}

fn registry() -> Registry {
    Registry::new().with(swm_data::FORMATS).with(POLICIES).with(MODELS).with(&[DOT])
}

/// Puts the checkpoint where a download has it.
fn download(folder: &Path) {
    let golden =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/checkpoints/lewm_transformers4");
    let place = folder.join("lewm-dot");
    std::fs::create_dir(&place).expect("it is not there yet");
    for name in ["config.json", "weights.pt"] {
        std::fs::copy(golden.join(name), place.join(name)).expect("a golden file");
    }
}

#[test]
fn a_recipe_is_imported_evaluated_and_compared() {
    let folder = tempfile::tempdir().unwrap();
    let request = recipe(folder.path(), None);
    let fails = |request: &Reproduce| match request.run(&registry(), &mut ()) {
        Err(TaskError::Request(message)) => *message,
        other => panic!("{other:?}"),
    };

    // Nothing is there, and nothing is begun.
    let looked = Reproduce { check_only: true, ..request.clone() }.run(&registry(), &mut ()).unwrap();
    assert_eq!(looked.needs.iter().map(|need| need.what).collect::<Vec<_>>(), ["checkpoint", "dataset"]);
    assert!(looked.needs.iter().all(|need| need.found.is_none()) && looked.rows.is_empty());
    let missing = fails(&request);
    assert!(missing.text.contains("hf download nobody-here/lewm-dot config.json weights.pt"), "{missing}");
    assert!(missing.text.contains("dataset (2 kB): not in"), "{missing}");
    assert_eq!(missing.fix, Some(Fix::set_to("fetch", true, "to fetch all of it")));
    assert!(!request.out.exists());

    record(folder.path());
    download(folder.path());
    let done = request.run(&registry(), &mut ()).unwrap();
    assert_eq!(done.recipe, "lewm-dot");
    let [historic, moderate] = &done.rows[..] else { panic!("{done:?}") };
    assert_eq!((historic.ours.episodes, historic.repetitions.len(), moderate.ours.episodes), (6, 2, 2));
    let [low, high] = historic.ours.ci95;
    assert_eq!(historic.is_within, (low..=high).contains(&0.0));
    assert!((historic.difference - historic.ours.success_rate).abs() < 1e-12 && historic.std.is_some());
    assert!(
        (moderate.difference - (moderate.ours.success_rate - 99.0)).abs() < 1e-12 && moderate.std.is_none()
    );
    for one in historic.repetitions.iter().chain(&moderate.repetitions) {
        let receipt = read_receipt(&one.receipt).unwrap();
        assert_eq!(receipt.manifest_hash, one.manifest_hash);
        assert_eq!(
            (receipt.summary.success_rate, receipt.manifest.image.unwrap().width),
            (one.success_rate, SIDE)
        );
        assert!(one.random.is_some() && receipt.policy.contains("samples=6"), "{}", receipt.policy);
    }
    let table: serde_json::Value =
        serde_json::from_slice(&std::fs::read(request.out.join("reproduction.json")).unwrap()).unwrap();
    assert_eq!((&table["recipe"], table["rows"].as_array().map(Vec::len)), (&"lewm-dot".into(), Some(2)));

    // What is done already is not done again.
    let mut notes: Vec<Message> = Vec::new();
    let again = request.run(&registry(), &mut notes).unwrap();
    assert_eq!(serde_json::to_value(&again.rows).unwrap(), table["rows"]);
    assert_eq!(notes.iter().filter(|note| note.text.contains("already done")).count(), 3, "{notes:?}");

    // A part of it.
    let part = Reproduce {
        figure: vec!["historic".to_owned()],
        pairs: Some(1),
        out: folder.path().join("part"),
        ..request.clone()
    };
    let done = part.run(&registry(), &mut ()).unwrap();
    assert_eq!((done.rows.len(), done.rows[0].ours.episodes), (1, 2));
}

#[test]
fn other_weights_than_the_recipe_s_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    download(folder.path());
    let fails = |request: &Reproduce| request.run(&registry(), &mut ()).unwrap_err();
    let error = fails(&recipe(folder.path(), Some(&"0".repeat(64))));
    assert!(error.to_string().contains("it is another checkpoint"), "{error}");
    assert_eq!(error.fix(), Some(&Fix::Change("checkpoint")));
    let request = recipe(folder.path(), None);
    for (wrong, text) in [
        (
            Reproduce { figure: vec!["strict".to_owned()], ..request.clone() },
            "strict: is no figure of lewm-dot",
        ),
        (Reproduce { name: "lewm-pusht".to_owned(), ..request.clone() }, "is in place of a named one"),
        (Reproduce { name: "lewm-dots".to_owned(), recipe: None, ..request.clone() }, "is no recipe"),
        (Reproduce { recipe: None, ..request.clone() }, "name: must be given"),
        (Reproduce { pairs: Some(0), ..request.clone() }, "pairs=0: use 1 or more"),
        (Reproduce { out: "".into(), ..request.clone() }, "a folder for the results must be named"),
        (Reproduce { checkpoint: Some("no/such".to_owned()), ..request.clone() }, "no such file or folder"),
    ] {
        let error = fails(&wrong).to_string();
        assert!(error.contains(text), "{text}: {error}");
    }
}
