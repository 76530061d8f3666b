//! Folders of episodes of Dreamer's agents and of V-D4RL.

use std::fs;

use swm_core::Column;
use swm_data::{Dataset, OpenOptions};

use crate::published::{check, column_of, golden, lengths, numbers, opened, rows};
use crate::{copied, open};

const SAMPLE: &str = "dreamer_toy";

fn of_episode(dataset: &mut dyn Dataset, name: &str, episode: usize) -> Vec<f64> {
    let (column, length) = (column_of(dataset, name), dataset.episode_len(episode));
    numbers(&rows(dataset, column, episode, 0, length))
}

#[test]
fn the_action_of_a_row_is_the_one_that_led_to_the_next() {
    let names = [
        ("action", "action", 1.0),
        ("reward", "reward", 1.0),
        ("discount", "discount", 1.0),
        ("is_first", "is_first", 1.0),
        ("is_terminal", "terminated", 1.0),
    ];
    let mut dataset = check(SAMPLE, &OpenOptions::default(), &names);
    assert_eq!(lengths(dataset.as_ref()), [6, 4, 7]);
    for (episode, length) in [6, 4, 7].into_iter().enumerate() {
        for (name, dim) in [("action", 2), ("reward", 1)] {
            let values = of_episode(dataset.as_mut(), name, episode);
            let missing = values.iter().position(|value| value.is_nan());
            assert_eq!((missing, values.len()), (Some((length - 1) * dim), length * dim), "{name} {episode}");
        }
        // The second episode ends, the others are cut.
        for (name, is_marked) in [("terminated", episode == 1), ("truncated", episode != 1)] {
            let marks = of_episode(dataset.as_mut(), name, episode);
            let last = marks[length - 1] != 0.0;
            assert!(
                last == is_marked && marks[..length - 1].iter().all(|&mark| mark == 0.0),
                "{name} {marks:?}"
            );
        }
    }
    let info = dataset.info();
    assert_eq!(info.format, "dreamer");
    assert!(info.notes.iter().any(|note| note.contains("led to an image")), "{:?}", info.notes);
    assert_eq!(info.skipped.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["log_name"]);
}

#[test]
fn an_episode_is_a_dataset_of_its_own() {
    let file = fs::read_dir(golden(SAMPLE)).unwrap().flatten().map(|entry| entry.path()).min().unwrap();
    let mut dataset = open(&file).unwrap();
    assert_eq!(lengths(dataset.as_ref()), [6]);
    let mut folder = open(&golden(SAMPLE)).unwrap();
    for name in ["action", "pixels"] {
        let read = |dataset: &mut dyn Dataset| {
            let column = column_of(dataset, name);
            rows(dataset, column, 0, 0, 5)
        };
        let parts: [Column; 2] = [read(dataset.as_mut()), read(folder.as_mut())];
        assert_eq!(parts[0], parts[1], "{name}");
    }
}

#[test]
fn an_episode_of_another_shape_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mixed");
    copied(&golden(SAMPLE), &path);
    fs::copy(golden("visual-cube-single-play-v0.npz"), path.join("20211105T123003-x-1.npz")).unwrap();
    let refused = opened(&path, &OpenOptions::default()).err().unwrap().to_string();
    assert!(refused.contains("20211105T123003-x-1.npz") && refused.contains("`reward`"), "{refused}");
}
