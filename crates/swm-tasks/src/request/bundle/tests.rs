//! Tests of bundles: what is refused, what they hold, that they move, and that a changed byte is found.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value as Json, json};
use swm_core::testing::TOY;
use swm_core::{PolicyEntry, PolicyError, Registry, policies};

use super::{Bundled, MakeBundle};
use crate::bundle::{Bundle, receipt_to_repeat};
use crate::evaluation::{RunOptions, read_manifest, verify};
use crate::report_page::{Item, PageOptions, write_page};
use crate::request::{Evaluate, Fix, MakeBoard, MakeManifest, Message, Request as _, TaskError};

/// Acts at random, and depends on a folder of weights with a description, as trained models do.
const MODEL: PolicyEntry = PolicyEntry::new("model", "acts by its weights", |_, args| {
    let run = run_of(args)?;
    for file in ["weights.bin", "step.json"] {
        fs::read(run.join(file)).map_err(|error| args.wrong(format!("{file}: {error}")))?;
    }
    Ok(Box::new(policies::random()))
})
.files(|args| Ok(vec![run_of(args)?.join("weights.bin")]))
.companions(|args| Ok(vec![run_of(args)?.join("step.json")]));

fn run_of(args: &swm_core::PolicyArgs) -> Result<PathBuf, PolicyError> {
    let run = args.positional.first().and_then(Json::as_str).ok_or_else(|| args.wrong("name a run"))?;
    Ok(run.into())
}

fn registry() -> Registry {
    Registry::new().with(swm_data::FORMATS).with(&[TOY]).with(&[MODEL])
}

/// A result of `policy` in the folder `out`, on a manifest beside it.
fn evaluate(folder: &Path, policy: &str, name: &str) -> PathBuf {
    let (task, out) = (folder.join("task.toml"), folder.join(name));
    if !task.exists() {
        let make = MakeManifest {
            env: TOY.id.to_owned(),
            out: task.clone(),
            episodes: 4,
            budget: Some(5),
            ..MakeManifest::default()
        };
        make.run(&registry(), &mut ()).unwrap();
    }
    let given = json!({ "manifest": task, "policy": policy, "reference": ["random"], "out": out });
    let Json::Object(given) = given else { panic!("it is an object") };
    Evaluate::from_json(&given).and_then(|asked| asked.run(&registry(), &mut ())).unwrap();
    out
}

/// A run of the policy `model`.
fn run(folder: &Path) -> PathBuf {
    let run = folder.join("my run");
    fs::create_dir_all(&run).unwrap();
    for (file, content) in [("weights.bin", "w"), ("step.json", "{}"), ("metrics.jsonl", "not needed")] {
        fs::write(run.join(file), content).unwrap();
    }
    run
}

fn bundle(result: &Path, out: &Path) -> Result<Bundled, TaskError> {
    MakeBundle { result: result.to_owned(), out: out.to_owned(), ..MakeBundle::default() }
        .run(&registry(), &mut ())
}

fn files_of(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn a_wrong_request_is_refused_by_its_setting() {
    let folder = tempfile::tempdir().unwrap();
    let (result, taken) = (evaluate(folder.path(), "random", "random"), folder.path().join("taken"));
    fs::create_dir(&taken).unwrap();
    let out = folder.path().join("out");
    let ask = |given: Json| {
        let mut asked = json!({ "result": result, "out": out });
        asked.as_object_mut().unwrap().extend(given.as_object().unwrap().clone());
        MakeBundle::from_json(asked.as_object().unwrap())
            .and_then(|asked| asked.run(&registry(), &mut ()))
            .unwrap_err()
    };
    for (given, told) in [
        (json!({ "result": "" }), "result: must be given"),
        (json!({ "out": "" }), "out: must be given"),
        (json!({ "out": "/" }), "names no new folder"),
        (json!({ "out": taken }), "exists, and a bundle is never changed; give another out"),
        (json!({ "reported": 101.0 }), "is in percent"),
        (
            json!({ "source": "a paper" }),
            "is about a reported rate, and none is given; give reported, or leave out source",
        ),
        (json!({ "license": "" }), "must be one line of text"),
        (json!({ "result": folder.path().join("none") }), "none"),
        (json!({ "licens": "mit" }), "did you mean `license`?"),
    ] {
        let said = ask(given).to_string();
        assert!(said.contains(told), "{said}");
    }
    assert!(!out.exists() && files_of(folder.path()).iter().all(|name| !name.starts_with("new-")));
}

#[test]
fn a_bundle_holds_the_task_the_result_and_nothing_of_this_machine() {
    let folder = tempfile::tempdir().unwrap();
    let result = evaluate(folder.path(), "random", "random");
    let out = folder.path().join("deep/er/bundle");
    let made = MakeBundle {
        result: result.clone(),
        out: out.clone(),
        reported: Some(40.0),
        source: Some("a | paper".to_owned()),
        ..MakeBundle::default()
    };
    let made = made.run(&registry(), &mut ()).unwrap();
    assert_eq!(files_of(&out), ["README.md", "SHA256SUMS", "bundle.json", "manifest.json", "receipt.json"]);
    assert!((made.files, made.is_foreign) == (4, false) && made.bytes > 1000);
    let task = read_manifest(&folder.path().join("task.toml")).unwrap();
    assert_eq!(read_manifest(&out.join("manifest.json")).unwrap().hash(), task.hash());
    let readme = fs::read_to_string(out.join("README.md")).unwrap();
    assert!(
        readme.contains("swm verify-result FOLDER") && readme.contains("by a / paper: 40.0 %"),
        "{readme}"
    );
    for name in files_of(&out) {
        let text = fs::read_to_string(out.join(&name)).unwrap();
        assert!(
            !text.contains(&folder.path().display().to_string()),
            "{name} names a folder of this machine"
        );
    }
    let bundle = Bundle::open(&out).unwrap();
    assert_eq!(bundle.info.reported.unwrap().success_rate, 40.0);
    assert!(
        self::bundle(&out, &folder.path().join("again"))
            .unwrap_err()
            .to_string()
            .contains("is a bundle already")
    );
}

#[test]
fn a_model_travels_with_the_bundle_and_acts_where_that_lies() {
    let folder = tempfile::tempdir().unwrap();
    let run = run(folder.path());
    let result = evaluate(folder.path(), &format!("model:{}", run.display()), "model");
    let out = folder.path().join("bundle");
    let mut notes: Vec<Message> = Vec::new();
    let asked = MakeBundle { result: result.clone(), out: out.clone(), ..MakeBundle::default() };
    asked.run(&registry(), &mut notes).unwrap();
    assert_eq!(notes[0].fix, Some(Fix::set("license", "mit")));
    assert_eq!(files_of(&out.join("model")), ["step.json", "weights.bin"]);
    let card = fs::read_to_string(out.join("MODEL_CARD.md")).unwrap();
    assert!(card.starts_with("---\nlibrary_name: ") && card.contains("`model/weights.bin`"), "{card}");
    let written: Json = serde_json::from_str(&fs::read_to_string(out.join("receipt.json")).unwrap()).unwrap();
    assert_eq!(written["candidate"]["policy"]["positional"][0], "model");
    assert_eq!(written["files"].as_object().unwrap().keys().collect::<Vec<_>>(), ["model/weights.bin"]);

    // Elsewhere, without the run.
    let moved = folder.path().join("moved");
    fs::rename(&out, &moved).unwrap();
    fs::remove_dir_all(&run).unwrap();
    for path in [moved.clone(), moved.join("receipt.json")] {
        let (receipt, opened) = receipt_to_repeat(&path).unwrap();
        assert_eq!(opened.unwrap().files, 7);
        let again = verify(&registry(), &receipt, &RunOptions::default(), false, || ()).unwrap();
        assert!(again.equal, "{again:?}");
        let page = folder.path().join("page.html");
        let options = PageOptions { videos: 1, plans: 0, format: swm_media::Format::Gif };
        let notes = write_page(&registry(), &page, &[Item::read(&path).unwrap()], options, |_| {}).unwrap();
        let html = fs::read_to_string(&page).unwrap();
        assert!(notes.is_empty() && html.contains("data:image/gif"), "{notes:?}");
    }
    let weights = moved.join("model/weights.bin");
    fs::write(&weights, "v").unwrap();
    let said = Item::read(&moved).err().unwrap().to_string();
    assert!(said.contains("model/weights.bin was changed"), "{said}");
    let said = Item::read(Path::new("zoo:nothing")).err().unwrap().to_string();
    assert!(said.contains("there is no model zoo:nothing"), "{said}");
    // Without the run, there is nothing to bundle.
    let said = bundle(&result, &out).unwrap_err().to_string();
    assert!(said.contains("weights.bin, which the result depends on, is not there"), "{said}");
    assert!(
        !out.exists() && files_of(folder.path()).iter().all(|name| !name.starts_with("new-")),
        "a draft is left"
    );
}

#[test]
fn a_model_that_was_trained_further_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let run = run(folder.path());
    let result = evaluate(folder.path(), &format!("model:{}", run.display()), "model");
    fs::write(run.join("weights.bin"), "v").unwrap();
    let said = bundle(&result, &folder.path().join("bundle")).unwrap_err().to_string();
    assert!(
        said.contains("weights.bin was changed since the evaluation") && said.contains("evaluate again"),
        "{said}"
    );
}

#[test]
fn one_changed_byte_is_reported_by_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let run = run(folder.path());
    let result = evaluate(folder.path(), &format!("model:{}", run.display()), "model");
    let out = folder.path().join("bundle");
    bundle(&result, &out).unwrap();
    for name in
        ["manifest.json", "receipt.json", "bundle.json", "README.md", "MODEL_CARD.md", "model/weights.bin"]
    {
        let path = out.join(name);
        let bytes = fs::read(&path).unwrap();
        let mut changed = bytes.clone();
        *changed.last_mut().unwrap() ^= 1;
        fs::write(&path, changed).unwrap();
        let said = Bundle::open(&out).unwrap_err().to_string();
        assert!(said.contains(&format!("{name} was changed")), "{said}");
        fs::write(&path, bytes).unwrap();
    }
    Bundle::open(&out).unwrap();
}

#[test]
fn an_edited_receipt_is_not_bundled() {
    let folder = tempfile::tempdir().unwrap();
    let result = evaluate(folder.path(), "random", "random");
    let path = result.join("receipt.json");
    let mut receipt: Json = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    receipt["summary"]["success_rate"] = 99.0.into();
    fs::write(&path, receipt.to_string()).unwrap();
    let said = bundle(&result, &folder.path().join("bundle")).unwrap_err().to_string();
    assert!(said.contains("the summary is not that of the episodes; evaluate again"), "{said}");
}

fn board(given: &Json) -> Result<super::super::BoardMade, TaskError> {
    MakeBoard::from_json(given.as_object().unwrap()).and_then(|asked| asked.run(&registry(), &mut ()))
}

#[test]
fn a_board_sorts_bundles_by_task_and_runs_them_again() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (one, two) =
        (evaluate(folder.path(), "random", "random"), evaluate(folder.path(), "constant", "constant"));
    let (first, second) = (at("<i>first"), at("second"));
    let reported = MakeBundle {
        result: one,
        out: first.clone(),
        reported: Some(100.0),
        source: Some("<script>alert(1)</script>".to_owned()),
        ..MakeBundle::default()
    };
    reported.run(&registry(), &mut ()).unwrap();
    bundle(&two, &second).unwrap();
    let made =
        board(&json!({ "bundles": [first, second], "out": at("board"), "rerun": true, "title": "<Toy>" }))
            .unwrap();
    assert!(made.board.groups.len() == 1 && made.board.differing().is_empty());
    let rows = &made.board.groups[0].rows;
    assert!(rows[0].summary.success_rate >= rows[1].summary.success_rate && rows[0].test.is_none());
    let test = rows[1].test.as_ref().unwrap();
    assert!((test.difference - (rows[0].summary.success_rate - rows[1].summary.success_rate)).abs() < 1e-9);
    assert!(rows.iter().all(|row| row.rerun.as_ref().unwrap().equal));
    let reproduction = &made.board.reported[0];
    assert!((reproduction.difference - (reproduction.summary.success_rate - 100.0)).abs() < 1e-9);
    let html = fs::read_to_string(&made.page).unwrap();
    for text in [
        "<h1>&lt;Toy&gt;</h1>",
        "&lt;i&gt;first",
        "&lt;script&gt;alert(1)",
        "Reproduced against reported",
        ">equal<",
    ] {
        assert!(html.contains(text), "no `{text}` in\n{html}");
    }
    assert!(!html.contains("<script") && !html.contains("http"), "the page needs nothing else");
    // It is written anew; what is no board is kept.
    board(&json!({ "bundles": [first], "out": at("board") })).unwrap();
    assert!(!fs::read_to_string(&made.page).unwrap().contains("second"));
    for (given, told) in [
        (json!({ "bundles": [], "out": at("x") }), "bundles: must be given"),
        (
            json!({ "bundles": [first], "out": at("random") }),
            "holds something else than a board; give another out",
        ),
        (
            json!({ "bundles": [first], "out": at("x"), "oracle": true }),
            "oracle=true: runs again what is not",
        ),
        (json!({ "bundles": [first, first], "out": at("x") }), "are one bundle; give it once"),
        (json!({ "bundles": [at("random")], "out": at("x") }), "it is a result; `swm bundle` makes"),
    ] {
        let said = board(&given).unwrap_err().to_string();
        assert!(said.contains(told), "{said}");
    }
    assert!(!at("x").exists());
}
