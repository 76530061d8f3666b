//! Lists of tasks that contradict the rows: errors and notes with the place and the fix.

use std::fs;
use std::path::Path;

use swm_data::tools::verify::verify;
use swm_data::{Dataset, Steps};

use crate::copied;
use crate::golden;
use crate::open;
use crate::published::column_of;

/// The text of the first row of an episode, or the error of reading it.
fn first_text(dataset: &mut dyn Dataset, episode: usize) -> Result<String, String> {
    let task = column_of(dataset, "task");
    let mut out = [String::new()];
    let steps = Steps { first: 0, count: 1, stride: 1 };
    let read = dataset.rows(task, episode, steps, swm_core::SliceMut::Str(&mut out));
    read.map(|()| out[0].clone()).map_err(|error| error.to_string())
}

/// All problems of a dataset.
fn problems(path: &Path) -> String {
    let report = verify(open(path).unwrap().as_mut(), &mut |_| {});
    report.problems.into_iter().map(|problem| problem.reason).collect::<Vec<_>>().join("; ")
}

fn assert_has(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "{part}: {message}");
    }
}

/// A dataset of one task an episode, with another list of tasks.
fn with_list(folder: &Path, list: &str) -> std::path::PathBuf {
    let path = folder.join("copy");
    copied(&golden("lerobot_v2.1"), &path);
    fs::write(path.join("meta/tasks.jsonl"), list).unwrap();
    path
}

fn with_several_tasks(path: &Path) {
    let several = "{\"episode_index\": 0, \"tasks\": [\"push the block\", \"wait\"], \"length\": 4}\n\
                   {\"episode_index\": 1, \"tasks\": [\"push the block\"], \"length\": 6}\n";
    fs::write(path.join("meta/episodes.jsonl"), several).unwrap();
}

#[test]
fn a_number_that_the_list_does_not_have_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = with_list(folder.path(), "{\"task_index\": 7, \"task\": \"push the block\"}\n");
    let mut dataset = open(&path).unwrap();
    for episode in 0..2 {
        let message = first_text(dataset.as_mut(), episode).unwrap_err();
        let place = format!("episode {episode}");
        assert_has(&message, &["`task`", &place, "no task 0", "row 0", "add its text to the list"]);
    }
    assert_has(&problems(&path), &["`task_index` is 0 in row 0"]);
}

#[test]
fn another_text_than_that_of_the_episode_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = with_list(folder.path(), "{\"task_index\": 0, \"task\": \"lift the block\"}\n");
    let message = first_text(open(&path).unwrap().as_mut(), 1).unwrap_err();
    assert_has(&message, &["`task`", "episode 1", "row 0", "`lift the block`", "`push the block`"]);
}

#[test]
fn numbers_that_are_listed_twice_or_negative_are_noted_where_texts_do_not_depend_on_them() {
    for (list, parts) in [
        (
            "{\"task_index\": 0, \"task\": \"push the block\"}\n{\"task_index\": 0, \"task\": \"wait\"}\n",
            ["the number 0 is that of two tasks, `push the block` and `wait`", "give one of them another"],
        ),
        (
            "{\"task_index\": 0, \"task\": \"push the block\"}\n{\"task_index\": -1, \"task\": \"wait\"}\n",
            ["the task `wait` has the number -1", "give it another"],
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = with_list(folder.path(), list);
        let mut dataset = open(&path).unwrap();
        let notes = dataset.info().notes.join("; ");
        assert_has(&notes, &["`meta/tasks.jsonl`", "are not compared"]);
        assert_has(&notes, &parts);
        assert_eq!(first_text(dataset.as_mut(), 0).unwrap(), "push the block");
        assert_has(&problems(&path), &parts);
        // Where an episode has several, rows have no other texts.
        with_several_tasks(&path);
        let message = open(&path).err().unwrap().to_string();
        assert_has(&message, &["`meta/tasks.jsonl`"]);
        assert_has(&message, &parts);
    }
}

#[test]
fn lists_of_sound_datasets_give_no_note() {
    for version in ["lerobot_v2.1", "lerobot_v3.0"] {
        let mut dataset = open(&golden(version)).unwrap();
        assert!(dataset.info().notes.iter().all(|note| !note.contains("task")), "{:?}", dataset.info().notes);
        assert_eq!(first_text(dataset.as_mut(), 1).unwrap(), "push the block");
    }
}
