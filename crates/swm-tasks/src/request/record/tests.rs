//! Refusals, notes, parts and continuations of recordings.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use serde_json::json;
use swm_core::testing::TOY;

use super::super::Progress;
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

/// Three episodes of up to 5 actions, without images.
fn request(out: &Path) -> Record {
    let (env, out) = (TOY.id.to_owned(), out.to_owned());
    Record { env, out, episodes: Some(3), max_steps: 5, image_size: None, ..Record::default() }
}

fn record(request: &Record) -> Result<Recorded, TaskError> {
    request.run(&registry(), &mut ())
}

fn set(name: &str, value: impl Into<Json>, to: &'static str) -> Fix {
    Fix::Set { setting: Assignment::of(name, value), to }
}

/// The mode `append`, with further settings.
fn append(total: Option<u64>, instead_of: Option<&'static str>, to: &str) -> Fix {
    let mut settings = vec![Assignment::of("mode", "append")];
    settings.extend(total.map(|total| Assignment::of("total", total)));
    Fix::SetAll { settings, instead_of, to: to.to_owned() }
}

#[test]
fn every_refusal_names_the_setting_and_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let (held, letter, out) =
        (folder.path().join("held.h5"), folder.path().join("letter.h5"), folder.path().join("new.h5"));
    record(&Record { total: Some(3), episodes: None, ..request(&held) }).unwrap();
    std::fs::write(&letter, "dear").unwrap();
    let any = |fixes: Vec<Fix>| Some(Fix::Any(fixes));
    let replace = || set("mode", "overwrite", "to replace it");
    let leave = |a, b| any(vec![Fix::Leave(a), Fix::Leave(b)]);
    let mix = || Some(set("mix", true, "to append all the same"));
    let size = json!({ "height": 8, "width": 8 });
    let table = [
        (json!({ "env": "" }), "env: must be given", None),
        (json!({ "out": "" }), "out: must be given", None),
        (json!({ "episodes": null }), "episodes: must be given", None),
        (json!({ "epsodes": 3 }), "epsodes=3: unknown (did you mean `episodes`?)", None),
        (json!({ "seed": -1 }), "seed=-1: must be a whole number, 0 or more", None),
        (json!({ "mode": "replace" }), "mode=replace: no value `replace`", None),
        (json!({ "shard": "3/2" }), "shard=3/2: must be part I of N parts", None),
        (json!({ "episodes": 0 }), "episodes=0: no episode is recorded; use 1 or more", None),
        (json!({ "episodes": null, "total": 0 }), "total=0: no episode is recorded", None),
        (json!({ "total": 5 }), "total=5: counts the episodes that are there", leave("total", "episodes")),
        (json!({ "quality": 0 }), "quality=0: use 1 to 100", None),
        (
            json!({ "replayable": 4, "image_size": size }),
            "image_size=8x8: a replayable recording has no images",
            leave("image_size", "replayable"),
        ),
        (json!({ "replayable": 0 }), "replayable: every 0 steps is not in", None),
        (json!({ "without": ["gaol"] }), "without: ", None),
        (json!({ "max_steps": 0 }), "max_steps: 0 steps; use 1 or more", None),
        (json!({ "num_envs": 0 }), "num_envs: 0 is not in 1 to", None),
        (json!({ "frame_skip": 0 }), "frame_skip: 0 is not in 1 to", None),
        (json!({ "threads": 0 }), "threads=0: use 1 to 1024 threads", None),
        (
            json!({ "vary": [""] }),
            "vary: it names no factor",
            Some(set("vary", json!(["none"]), "to sample none")),
        ),
        (json!({ "set": { "point.gain": "much" } }), "set=point.gain=much: `much` is not a number", None),
        (json!({ "policy": "random:@none.toml" }), "settings file none.toml: ", None),
        (
            json!({ "out": letter }),
            "letter.h5 exists, and no episode can be added to it (",
            Some(Fix::Change("out")),
        ),
        (
            json!({ "out": held, "episodes": 2 }),
            "held.h5 exists and holds 3 episodes; give mode=append to record 2 more, or mode=append and total=5 in place of episodes \
             for the next ones of the same recording, or mode=overwrite to replace it",
            any(vec![
                append(None, None, "to record 2 more"),
                append(Some(5), Some("episodes"), "for the next ones of the same recording"),
                replace(),
            ]),
        ),
        (
            json!({ "out": held, "episodes": 10 }),
            "held.h5 exists and holds 3 episodes; ",
            any(vec![
                append(Some(10), Some("episodes"), "to complete it to 10"),
                append(None, None, "to record 10 more"),
                replace(),
            ]),
        ),
        (
            json!({ "out": held, "episodes": null, "total": 3 }),
            "held.h5 exists and holds 3 episodes; ",
            any(vec![append(Some(6), None, "to record 3 more"), replace()]),
        ),
        (
            json!({ "out": held, "episodes": null, "total": 9 }),
            "held.h5 exists and holds 3 episodes; ",
            any(vec![append(None, None, "to complete it"), replace()]),
        ),
        (
            json!({ "out": held, "mode": "append", "episodes": u64::MAX }),
            "so many more than 3 are too many to count",
            None,
        ),
        (
            json!({ "out": held, "mode": "append", "episodes": null, "total": 9, "seed": 7 }),
            "its episodes are of another recording: seed 0, not 7",
            mix(),
        ),
        (
            json!({ "out": held, "mode": "append", "shard": "1/2", "episodes": 9 }),
            "it holds the whole recording, not part 1/2 of 9 episodes",
            mix(),
        ),
    ];
    let before = std::fs::read(&held).unwrap();
    for (given, text, fix) in table {
        let mut asked = object(serde_json::to_value(request(&out)).unwrap());
        asked.extend(object(given));
        let refused = Record::from_json(&asked).and_then(|asked| record(&asked));
        let error = match refused {
            Err(error @ TaskError::Request(_)) => error,
            other => panic!("{asked:?}: {other:?}"),
        };
        assert!(error.to_string().contains(text), "{text}: {error}");
        assert_eq!(error.fix(), fix.as_ref(), "{error}");
        assert!(!out.exists(), "nothing is written for a wrong request: {error}");
    }
    assert!(std::fs::read(&held).unwrap() == before, "what is refused changes nothing");
}

/// Episodes that were there, those that were written, and what cancels the recording after so many.
#[derive(Clone, Default)]
struct Heard {
    total: Arc<AtomicU64>,
    before: Arc<AtomicU64>,
    written: Arc<Mutex<Vec<u64>>>,
    cancel: Cancel,
    most: Option<usize>,
}

impl Report for Heard {
    fn note(&mut self, note: &Message) {
        panic!("{note}");
    }

    fn begin(&mut self, stage: &Stage<'_>) -> Result<Box<dyn Progress>, BoxError> {
        assert_eq!((stage.name, stage.unit), ("record", "episodes"));
        self.total.store(stage.total, Ordering::Relaxed);
        Ok(Box::new(self.clone()))
    }

    fn cancel(&self) -> Cancel {
        self.cancel.clone()
    }
}

impl Progress for Heard {
    fn done(&self, _success: Option<bool>) {}

    fn before(&self, units: u64) {
        self.before.store(units, Ordering::Relaxed);
    }

    fn written(&self, episode: u64, rows: usize) {
        assert!(rows > 0);
        let mut written = self.written.lock().unwrap();
        written.push(episode);
        if self.most == Some(written.len()) {
            self.cancel.cancel();
        }
    }
}

#[test]
fn parts_and_continuations_are_the_bytes_of_one_recording() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let whole = Record { episodes: Some(5), num_envs: 1, threads: Some(1), ..request(&path("whole.h5")) };
    let recorded = record(&whole).unwrap();
    assert_eq!((recorded.episodes, recorded.total_episodes), (5, 5));
    let bytes = std::fs::read(path("whole.h5")).unwrap();
    let total = Record { episodes: None, mode: WriteMode::Append, ..request(&path("two.h5")) };
    record(&Record { total: Some(2), ..total.clone() }).unwrap();
    let mut heard = Heard::default();
    let rest = Record { total: Some(5), ..total };
    let recorded = rest.run(&registry(), &mut heard).unwrap();
    assert_eq!((recorded.episodes, recorded.total_episodes), (3, 5));
    assert!(std::fs::read(path("two.h5")).unwrap() == bytes);
    assert_eq!([&heard.before, &heard.total].map(|count| count.load(Ordering::Relaxed)), [2, 3]);
    assert_eq!(*heard.written.lock().unwrap(), [2, 3, 4]);
    let part = Record { shard: "2/2".parse().ok(), episodes: Some(5), ..request(&path("part.h5")) };
    let mut heard = Heard::default();
    assert_eq!(part.run(&registry(), &mut heard).unwrap().episodes, 3);
    assert_eq!(*heard.written.lock().unwrap(), [2, 3, 4], "an episode has its index in the whole");
}

#[test]
fn another_recording_is_appended_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.h5");
    record(&request(&out)).unwrap();
    let other = Record { seed: 7, mode: WriteMode::Append, ..request(&out) };
    let mut notes: Vec<Message> = Vec::new();
    assert_eq!(other.run(&registry(), &mut notes).unwrap().total_episodes, 6);
    let [note] = notes.as_slice() else { panic!("{notes:?}") };
    let text =
        "these episodes were appended to it, though its episodes are of another recording: seed 0, not 7";
    assert!(note.text.ends_with(text), "{note}");
}

#[test]
fn a_cancelled_recording_keeps_what_is_committed_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let (out, whole) = (folder.path().join("a.h5"), folder.path().join("whole.h5"));
    let twenty = Record { episodes: Some(20), num_envs: 1, threads: Some(1), ..request(&out) };
    let mut heard = Heard { most: Some(2), ..Heard::default() };
    let error = twenty.run(&registry(), &mut heard).unwrap_err();
    assert!(matches!(error, TaskError::World(WorldError::Cancelled)), "{error}");
    let held = swm_data::open(&out).unwrap().num_episodes();
    assert!((2..20).contains(&held), "{held}");
    let rest = Record { episodes: None, total: Some(20), mode: WriteMode::Append, ..request(&out) };
    record(&rest).unwrap();
    record(&Record { episodes: Some(20), ..request(&whole) }).unwrap();
    assert!(std::fs::read(&out).unwrap() == std::fs::read(&whole).unwrap());
}

#[test]
fn a_request_is_its_json() {
    let request = Record {
        shard: "3/16".parse().ok(),
        mode: WriteMode::Append,
        replayable: Some(16),
        ..request(Path::new("a.h5"))
    };
    let json = object(serde_json::to_value(&request).unwrap());
    assert_eq!(
        (&json["shard"], &json["mode"], &json["image_size"]),
        (&json!("3/16"), &json!("append"), &Json::Null)
    );
    assert_eq!(Record::from_json(&json).unwrap(), request);
    assert_eq!(Record::default().max_steps, WorldOptions::default().max_episode_steps.unwrap());
}
