//! Servers with faults: what is tried again, and what the errors name.

use std::sync::atomic::Ordering;

use super::super::fetch::fetch_from;
use super::super::testing::Fault;
use super::super::{Object, RemoteError};
use super::*;

#[test]
fn cut_slow_and_busy_answers_are_continued() {
    let whole = bytes(3 << 20);
    for faults in [
        vec![Fault::Cut, Fault::Cut, Fault::Cut],
        vec![Fault::Status(503), Fault::Status(429), Fault::Status(500)],
        vec![Fault::Slow],
        vec![Fault::Silent],
    ] {
        let test = Test::http(&[("/x", whole.clone())]);
        test.server.fail(&faults);
        let object = test.object("/x").unwrap();
        let mut out = vec![0; whole.len()];
        object.read_exact_at(&mut out, 0).unwrap();
        assert_eq!(out, whole, "{faults:?}");
    }
}

#[test]
fn a_change_under_the_reader_is_an_error() {
    let test = Test::http(&[("/x", bytes(3 << 20))]);
    let object = test.object("/x").unwrap();
    test.server.put("/x", vec![1; 3 << 20]);
    let mut out = vec![0; 10];
    let error = object.read_exact_at(&mut out, 2 << 20).unwrap_err().to_string();
    assert!(error.contains("changed after it was opened") && error.contains("open it again"), "{error}");
    // A new look at it reads the new version, and none of the old blocks.
    test.object("/x").unwrap().read_exact_at(&mut out, 0).unwrap();
    assert_eq!(out, [1; 10]);
}

#[test]
fn servers_without_ranges_or_tags() {
    let whole = bytes((2 << 20) + 5);
    let test = Test::http(&[("/x", whole.clone())]);
    test.server.state.has_no_ranges.store(true, Ordering::Relaxed);
    let object = test.object("/x").unwrap();
    let error = object.read_exact_at(&mut [0; 10], 1 << 20).unwrap_err().to_string();
    assert!(error.contains("gives no parts of it"), "{error}");
    let out = test.cache.path().join("x");
    fetch_from(&test.remote, &test.at("/x"), Some(&out)).unwrap();
    assert_eq!(std::fs::read(&out).unwrap(), whole);
    test.server.state.has_no_tags.store(true, Ordering::Relaxed);
    assert!(test.object("/x").is_ok());
}

/// What a failed reading of an object shows.
fn message_of(object: &Object, at: u64) -> String {
    let error = object.read_exact_at(&mut [0; 10], at).unwrap_err();
    let found = RemoteError::within(&error).unwrap().clone();
    found.while_trying("read").to_string()
}

#[test]
fn every_fault_of_an_open_object_is_named_with_address_reason_and_fix() {
    let many = |fault| vec![fault; 5];
    for (faults, reason, fix) in [
        (many(Fault::Cut), ", 5 times", "what was fetched is kept"),
        (many(Fault::Silent), "no answer in 1.5 s, 5 times", "check the connection"),
        (many(Fault::Status(500)), "answers 500, 5 times", "check the connection"),
        (vec![Fault::Status(401)], "access is denied (401)", "wants a login"),
        (vec![Fault::Status(403)], "access is denied (403)", "wants a login"),
        (vec![Fault::Status(404)], "nothing is there (404)", "check the address"),
        (vec![Fault::Status(412)], "it was changed after it was opened", "open it again"),
        (vec![Fault::Status(416)], "from 2097152 on (416)", "another server"),
    ] {
        // The last block is so short that half of it is no progress.
        let test = Test::http(&[("/x", bytes((2 << 20) + 50))]);
        let object = test.object("/x").unwrap();
        test.server.fail(&faults);
        let message = message_of(&object, (2 << 20) + 40);
        let name = format!("cannot read {}/x: ", test.server.url);
        assert!(message.starts_with(&name), "{faults:?}: {message}");
        assert!(message.contains(reason) && message.contains(fix), "{faults:?}: {message}");
        assert!(!message.contains("damaged"), "{faults:?}: {message}");
    }
}

#[test]
fn an_object_that_was_cut_there_is_changed() {
    let test = Test::http(&[("/x", bytes(3 << 20))]);
    test.server.state.has_no_tags.store(true, Ordering::Relaxed);
    let object = test.object("/x").unwrap();
    // Without a tag its length tells.
    test.server.put("/x", bytes(2 << 20));
    let message = message_of(&object, (2 << 20) + 5);
    assert!(message.contains("changed after it was opened"), "{message}");
}
