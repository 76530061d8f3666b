//! Refusals, notes and continuations of copies, and of verifications.

use std::path::Path;

use serde_json::Map;
use swm_core::testing::TOY;

use super::super::{Record, Request, Verify};
use super::*;

fn registry() -> Registry {
    Registry::new().with(swm_data::FORMATS).with(&[TOY])
}

fn object(json: Json) -> Map<String, Json> {
    match json {
        Json::Object(map) => map,
        other => panic!("{other} is no object"),
    }
}

/// A recording of so many episodes of up to 5 actions, with images of this side, or none.
fn record(out: &Path, episodes: u64, side: Option<usize>, seed: u64) {
    let image_size = side.map(|side| ImageSize { height: side, width: side });
    let (env, out) = (TOY.id.to_owned(), out.to_owned());
    let request =
        Record { env, out, episodes: Some(episodes), max_steps: 5, image_size, seed, ..Record::default() };
    request.run(&registry(), &mut ()).unwrap();
}

/// What a request is refused with.
fn refused<R: Request>(given: Json) -> TaskError
where
    R::Outcome: std::fmt::Debug,
{
    let given = object(given);
    match R::from_json(&given).and_then(|request| request.run(&registry(), &mut ())) {
        Err(error @ TaskError::Request(_)) => error,
        other => panic!("{given:?}: {other:?}"),
    }
}

/// A function of a request, its settings, the error and the remedy.
type Row = (fn(Json) -> TaskError, Json, &'static str, Option<Fix>);

#[test]
fn every_refusal_names_the_setting_and_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let [source, other, large, out] = ["a.h5", "other.h5", "large.h5", "out.h5"].map(path);
    record(&source, 3, Some(8), 0);
    record(&other, 3, Some(8), 7);
    record(&large, 1, Some(12), 0);
    let (missing, named) = (path("none.h5"), path("{}.h5"));
    let convert: fn(Json) -> TaskError = refused::<Convert>;
    let merge: fn(Json) -> TaskError = refused::<Merge>;
    let split: fn(Json) -> TaskError = refused::<Split>;
    let verify: fn(Json) -> TaskError = refused::<Verify>;
    let any = |fixes: Vec<Fix>| Some(Fix::Any(fixes));
    let size = |side: usize| size_json(ImageSize { height: side, width: side });
    let replace = || Fix::set_to("overwrite", true, "to replace it");
    let copy = |more: Json| {
        let mut given = object(json!({ "source": source, "target": out }));
        given.extend(object(more));
        Json::Object(given)
    };
    let table: Vec<Row> = vec![
        (convert, json!({ "target": out }), "source: must be given", None),
        (convert, json!({ "source": source }), "target: must be given", None),
        (convert, copy(json!({ "qualty": 3 })), "qualty=3: unknown (did you mean `quality`?)", None),
        (convert, copy(json!({ "quality": 0 })), "quality=0: use 1 to 100", None),
        (convert, copy(json!({ "quality": 101 })), "quality=101: use 1 to 100", None),
        (
            convert,
            copy(json!({ "quality": 50 })),
            "quality: the format `hdf5` keeps images without loss",
            None,
        ),
        (convert, copy(json!({ "key_frames": 0 })), "key_frames=0: use 1 to 10000", None),
        (convert, copy(json!({ "fps": 0 })), "fps=0: a rate is a number above 0", None),
        (convert, copy(json!({ "image_size": size(0) })), "image size 0x0 is out of range", None),
        (
            convert,
            copy(json!({ "fit": "crop" })),
            "fit=crop: no image is resized",
            any(vec![Fix::set("image_size", size(64)), Fix::Leave("fit")]),
        ),
        (convert, copy(json!({ "fit": "zoom" })), "fit=zoom: ", None),
        (
            convert,
            copy(json!({ "image_size": "none", "fit": "pad" })),
            "fit=pad: no image is resized",
            any(vec![Fix::set("image_size", size(64)), Fix::Leave("fit")]),
        ),
        (convert, copy(json!({ "opening": { "fps": -1 } })), "above 0", None),
        (convert, copy(json!({ "opening": { "camera": "wrist" } })), "has no use for it", None),
        (convert, json!({ "source": missing, "target": out }), "none.h5", None),
        (
            convert,
            json!({ "source": source, "target": source }),
            "is the dataset to read and the one to write; give another target",
            Some(Fix::Change("target")),
        ),
        (
            convert,
            json!({ "source": source, "target": other }),
            "other.h5 exists and is another dataset: it is not the beginning of this copy",
            any(vec![Fix::Change("target"), replace()]),
        ),
        (merge, json!({ "out": out }), "sources: must be given", None),
        (merge, json!({ "sources": [source, other] }), "out: must be given", None),
        (merge, json!({ "sources": [source], "out": out }), "one dataset was given", None),
        (merge, json!({ "sources": [source, missing], "out": out }), "none.h5", None),
        (merge, json!({ "sources": [source, source], "out": out }), "a.h5 is named twice", None),
        (
            merge,
            json!({ "sources": [source, large], "out": out }),
            "large.h5 holds images of 12x12; give image_size=8x8 for images of one size",
            Some(Fix::set_to("image_size", size(8), "for images of one size")),
        ),
        (
            merge,
            json!({ "sources": [source, large], "out": other, "image_size": size(8) }),
            "other.h5 exists and is another dataset",
            any(vec![Fix::Change("out"), replace()]),
        ),
        (split, json!({ "out": named }), "source: must be given", None),
        (split, json!({ "source": source }), "out: must be given", None),
        (split, json!({ "source": source, "out": "x.h5" }), "out=x.h5: write `{}` where the name", None),
        (split, json!({ "source": source, "out": named, "parts": ["a"] }), "a: write NAME=FRACTION", None),
        (
            split,
            json!({ "source": source, "out": named, "parts": ["a=1", "a=2"] }),
            "a=2: each part needs a name of its own",
            None,
        ),
        (split, json!({ "source": source, "out": named, "parts": ["../a=1"] }), "without slashes", None),
        (
            split,
            json!({ "source": source, "out": named, "parts": ["a=x"] }),
            "the fraction is no number",
            None,
        ),
        (
            split,
            json!({ "source": source, "out": named, "parts": ["a=-1"] }),
            "use numbers of 0 or more",
            None,
        ),
        (
            split,
            json!({ "source": source, "out": named, "parts": ["a=1", "b=0"] }),
            "parts=a=1,b=0: `b` would get none of the 3 episodes",
            None,
        ),
        (verify, json!({}), "dataset: must be given", None),
        (verify, json!({ "dataset": missing }), "none.h5", None),
        (
            verify,
            json!({ "dataset": source, "dry_run": true }),
            "dry_run=true: is about a repair, and none is asked for",
            any(vec![Fix::set("fix", true), Fix::Leave("dry_run")]),
        ),
    ];
    let before = std::fs::read(&other).unwrap();
    for (run, given, text, fix) in table {
        let error = run(given.clone());
        assert!(error.to_string().contains(text), "{text}: {error}");
        assert_eq!(error.fix(), fix.as_ref(), "{error}");
        assert!(!out.exists(), "nothing is written for a wrong request: {given}");
    }
    assert!(std::fs::read(&other).unwrap() == before, "what is refused changes nothing");
    let unknown = Convert { source, target: out, ..Convert::default() };
    let to = CopyOptions { format: Some("xyz".to_owned()), ..CopyOptions::default() };
    let error = Convert { to, ..unknown }.run(&registry(), &mut ()).unwrap_err();
    assert!(error.to_string().contains("unknown dataset format `xyz`"), "{error}");
}

#[test]
fn parts_are_all_episodes_and_join_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    record(&path("a.h5"), 5, None, 0);
    let out = path("{}.h5").display().to_string();
    let parts: Parts = "train=3,val=1.5".parse().unwrap();
    let split = Split { source: path("a.h5"), out, parts, ..Split::default() };
    let mut notes: Vec<Message> = Vec::new();
    let copies = split.run(&registry(), &mut notes).unwrap();
    assert_eq!(copies.iter().map(|copy| copy.episodes).collect::<Vec<_>>(), [3, 2]);
    let [note] = notes.as_slice() else { panic!("{notes:?}") };
    assert_eq!(note.to_string(), "parts: they sum to 4.5; the parts are train 66.7 %, val 33.3 %");
    let sources = vec![path("train.h5"), path("val.h5")];
    let merge = Merge { sources, out: path("both.h5"), ..Merge::default() };
    let copy = merge.run(&registry(), &mut ()).unwrap();
    assert_eq!((copy.episodes, copy.resumed), (5, 0));
    let copy = merge.run(&registry(), &mut ()).unwrap();
    assert_eq!((copy.episodes, copy.resumed, copy.rows), (5, 5, 0), "it is there");
    let verified =
        Verify { dataset: path("both.h5"), ..Verify::default() }.run(&registry(), &mut ()).unwrap();
    assert!(verified.ok && verified.report.episodes == 5, "{verified:?}");
}

#[test]
fn a_copy_that_is_there_keeps_what_it_has_and_a_note_names_the_setting() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    record(&path("a.h5"), 2, Some(8), 0);
    let mut convert = Convert { source: path("a.h5"), target: path("b.folder"), ..Convert::default() };
    convert.run(&registry(), &mut ()).unwrap();
    convert.to.quality = Some(20);
    let mut notes: Vec<Message> = Vec::new();
    convert.run(&registry(), &mut notes).unwrap();
    let [note] = notes.as_slice() else { panic!("{notes:?}") };
    assert!(note.text.contains("was complete, and keeps the rate"), "{note}");
    assert_eq!(note.fix, Some(Fix::set_to("overwrite", true, "to write it anew")));
    convert.to.overwrite = true;
    assert_eq!(convert.run(&registry(), &mut ()).unwrap().resumed, 0);
}

/// Ends the work when it begins.
struct Ended(swm_core::Cancel);

impl Report for Ended {
    fn note(&mut self, _note: &Message) {}

    fn cancel(&self) -> swm_core::Cancel {
        self.0.clone()
    }

    fn begin(&mut self, _stage: &Stage<'_>) -> Result<Box<dyn super::super::Progress>, swm_core::BoxError> {
        self.0.cancel();
        Ok(Box::new(()))
    }
}

#[test]
fn a_copy_or_a_verification_that_is_cancelled_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    record(&path("a.h5"), 2, None, 0);
    let mut ended = Ended(swm_core::Cancel::new());
    let convert = Convert { source: path("a.h5"), target: path("b.h5"), ..Convert::default() };
    let verify = Verify { dataset: path("a.h5"), ..Verify::default() };
    let errors = [
        convert.run(&registry(), &mut ended).map(drop).unwrap_err(),
        verify.run(&registry(), &mut Ended(swm_core::Cancel::new())).map(drop).unwrap_err(),
    ];
    for error in errors {
        assert!(matches!(error, TaskError::World(WorldError::Cancelled)), "{error}");
    }
}

#[test]
fn a_request_is_its_json() {
    let to = CopyOptions {
        image_size: Some(ImageChoice(Some(ImageSize { height: 8, width: 9 }))),
        fit: Some(Fit::Crop),
        ..CopyOptions::default()
    };
    let split = Split { source: "a.h5".into(), out: "{}.h5".to_owned(), seed: 3, to, ..Split::default() };
    let json = object(serde_json::to_value(&split).unwrap());
    assert_eq!((&json["parts"], &json["fit"]), (&json!(["train=0.9", "val=0.1"]), &json!("crop")));
    assert_eq!(Split::from_json(&json).unwrap(), split);
    let changed = swm_core::Settings::changed(&split);
    assert_eq!(changed.keys().collect::<Vec<_>>(), ["source", "seed", "out", "image_size", "fit"]);
    assert_eq!(split.parts.to_string(), "train=0.9,val=0.1");
}
