//! The replay buffer: whole episodes, oldest out first, drawn from, dumped and loaded.

use swm_core::{Batch, EpisodeSink as _};
use swm_data::loader::{ClipOptions, GoalOptions};
use swm_data::{Dataset as _, ReplayBuffer, Sampler, WriteMode, open};

use crate::support::{assert_same, contents, episode, metadata, schema};

fn filled(capacity: usize, lengths: &[usize]) -> ReplayBuffer {
    let mut buffer = ReplayBuffer::new(capacity);
    let schema = schema();
    assert_eq!(buffer.begin(&schema, &metadata()).unwrap(), 0);
    for (index, &rows) in lengths.iter().enumerate() {
        buffer.write_episode(&episode(&schema, index, rows)).unwrap();
    }
    buffer.finish().unwrap();
    buffer
}

fn read(buffer: &ReplayBuffer, number: usize) -> Batch {
    let mut dataset = buffer.dataset().unwrap();
    let mut batch = Batch::new(dataset.schema().clone(), 0);
    dataset.read(number, 0..dataset.episode_len(number), &mut batch).unwrap();
    batch
}

#[test]
fn the_oldest_episodes_leave_whole() {
    let mut buffer = filled(20, &[8, 5, 6]);
    assert_eq!((buffer.rows(), buffer.num_episodes(), buffer.written()), (19, 3, 3));
    let before = buffer.dataset().unwrap();
    buffer.write_episode(&episode(&schema(), 3, 2)).unwrap();
    assert_eq!((buffer.rows(), buffer.num_episodes(), buffer.written()), (13, 3, 4));
    assert_same(&read(&buffer, 0), &episode(&schema(), 1, 5));
    assert_same(&read(&buffer, 2), &episode(&schema(), 3, 2));
    // A dataset of an earlier moment stays what it was.
    assert_eq!((before.num_episodes(), before.episode_len(0)), (3, 8));
    buffer.write_episode(&episode(&schema(), 4, 20)).unwrap();
    assert_eq!((buffer.rows(), buffer.num_episodes()), (20, 1));
    assert_same(&read(&buffer, 0), &episode(&schema(), 4, 20));
    let message = buffer.write_episode(&episode(&schema(), 5, 21)).unwrap_err().to_string();
    assert!(message.contains("21 rows does not fit into 20"), "{message}");
    assert_eq!(buffer.rows(), 20);
    assert_eq!(buffer.begin(&schema(), &metadata()).unwrap(), 5);
    let other = swm_core::Schema::new(schema().fields()[1..].to_vec()).unwrap();
    assert!(buffer.begin(&other, &metadata()).is_err());
    assert!(ReplayBuffer::new(5).dataset().is_err());
    assert!(ReplayBuffer::new(5).write_episode(&episode(&schema(), 0, 1)).is_err());
}

#[test]
fn samples_are_clips_of_the_content_and_repeatable() {
    let mut buffer = filled(100, &[12, 9]);
    let keys = ["step_idx", "state"].map(str::to_owned).to_vec();
    let goals = GoalOptions::hindsight(&["step_idx"], 3);
    let options = ClipOptions::default().num_steps(3).keys(Some(keys)).goals(Some(goals)).threads(Some(1));
    let mut sampler = Sampler::new(options.clone(), 7);
    let (mut batch, mut again) = (buffer.dataset().map(|d| Batch::new(d.schema().clone(), 0)).unwrap(), None);
    for _ in 0..2 {
        sampler.sample(&buffer, 200, 4, &mut batch).unwrap();
        assert_eq!(batch.rows(), 200);
        let (rows, goals) =
            (batch.get::<i64>("step_idx").unwrap(), batch.get::<i64>("goal_step_idx").unwrap());
        for (clip, goal) in rows.chunks(3).zip(goals) {
            // `step_idx` grows by 31 from row to row.
            assert_eq!(clip[2] - clip[0], 62);
            assert!(*goal > clip[2] && (goal - clip[2]) % 31 == 0, "{clip:?} {goal}");
        }
        if let Some(earlier) = again.replace(batch.clone()) {
            assert_same(&earlier, &batch);
        }
        sampler = Sampler::new(options.clone(), 7);
    }
    let first = batch.clone();
    sampler.sample(&buffer, 200, 5, &mut batch).unwrap();
    assert_ne!(first, batch);
    // New episodes are drawn from at once.
    buffer.write_episode(&episode(&schema(), 40, 50)).unwrap();
    sampler.sample(&buffer, 200, 6, &mut batch).unwrap();
    assert!(batch.get::<i64>("step_idx").unwrap().iter().any(|&value| value >= 40 * 7919 - 5));
    assert!(Sampler::new(options, 7).sample(&ReplayBuffer::new(9), 1, 0, &mut batch).is_err());
}

#[test]
fn a_buffer_goes_to_a_file_and_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("buffer.h5");
    let buffer = filled(30, &[8, 5, 6]);
    buffer.dump(&path, WriteMode::Error, None).unwrap();
    let stored = contents(&path);
    assert_eq!(stored.len(), 3);
    for (number, batch) in stored.iter().enumerate() {
        assert_same(&read(&buffer, number), batch);
    }
    assert!(buffer.dump(&path, WriteMode::Error, None).is_err());
    let loaded = ReplayBuffer::load(open(&path).unwrap().as_mut(), 12).unwrap();
    assert_eq!((loaded.num_episodes(), loaded.rows(), loaded.written()), (2, 11, 3));
    assert_same(&read(&loaded, 1), &stored[2]);
}
