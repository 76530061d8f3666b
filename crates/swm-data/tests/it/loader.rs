//! The windowed loader on our own recordings.

use swm_core::Batch;
use swm_data::loader::{BatchOptions, ClipOptions, GoalOptions, Images, Loader, Rewards};
use swm_data::{WriteMode, create, open};

use crate::support::{assert_same, contents, episode, metadata, record, schema};

fn loader(path: &std::path::Path, options: &ClipOptions) -> Loader {
    Loader::new(open(path).unwrap(), options).unwrap()
}

#[test]
fn clips_stride_columns_and_keep_actions_dense() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..4).unwrap(); // 5, 1, 300 and 17 rows
    let episodes = contents(&path);
    let keys = ["action", "state", "pixels", "step_idx"].map(str::to_owned).to_vec();
    let options = ClipOptions::default().num_steps(3).frameskip(4).keys(Some(keys));
    let loader = loader(&path, &options);
    assert_eq!(loader.len(), (300 - 11) + (17 - 11));
    let shapes: Vec<_> = loader.schema().fields().iter().map(|field| field.shape.clone()).collect();
    assert_eq!(shapes, [vec![3, 8], vec![3, 7], vec![3, 40, 40, 3], vec![3]]);

    let mut batch = loader.new_batch();
    let wanted = [0, 288, 289, 294, 100];
    loader.read(&wanted, &mut batch).unwrap();
    for (row, &index) in wanted.iter().enumerate() {
        let clip = loader.clip(index).unwrap();
        let whole = &episodes[clip.episode];
        let states = whole.get::<f64>("state").unwrap();
        let actions = whole.get::<f32>("action").unwrap();
        let pixels = whole.get::<u8>("pixels").unwrap();
        let row = batch.row(row);
        let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(row.get("action").unwrap()), bits(&actions[2 * clip.start..][..24]));
        for step in 0..3 {
            let at = clip.start + 4 * step;
            assert_eq!(row.get::<f64>("state").unwrap()[7 * step..][..7], states[7 * at..][..7]);
            assert!(row.get::<u8>("pixels").unwrap()[4800 * step..][..4800] == pixels[4800 * at..][..4800]);
        }
    }
}

/// Four episodes as a world records them: the first row has no reward, the last no action.
fn record_rewards(path: &std::path::Path) {
    let schema = schema();
    let mut writer = create(path, WriteMode::Append, None).unwrap();
    writer.begin(&schema, &metadata()).unwrap();
    for (index, rows) in [5, 1, 60, 17].into_iter().enumerate() {
        let mut batch = episode(&schema, index, rows);
        batch.get_mut::<f64>("reward").unwrap()[0] = f64::NAN;
        let actions = batch.get_mut::<f32>("action").unwrap();
        actions.iter_mut().enumerate().for_each(|(at, value)| *value = at as f32);
        actions[2 * (rows - 1)..].fill(f32::NAN);
        writer.write_episode(&batch).unwrap();
    }
    writer.finish().unwrap();
}

/// The rewards of a block's actions, by hand: row t holds the reward of arriving at it.
fn summed(rewards: &[f64], first: usize, skip: usize) -> f64 {
    match rewards.get(first + 1..=first + skip) {
        Some(rewards) => rewards.iter().sum(),
        None => f64::NAN,
    }
}

#[test]
fn rewards_are_beside_the_actions_that_earn_them_when_asked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record_rewards(&path);
    let episodes = contents(&path);
    let keys = Some(vec!["reward".to_owned(), "action".to_owned()]);
    for (steps, skip) in [(1, 1), (3, 1), (3, 5)] {
        let options = ClipOptions::default().num_steps(steps).frameskip(skip).keys(keys.clone());
        let options = options.rewards(Rewards::OfActions).threads(Some(1));
        for float32 in [false, true] {
            let loader = loader(&path, &options.clone().float32(float32));
            let mut batch = loader.new_batch();
            loader.read(&(0..loader.len()).collect::<Vec<_>>(), &mut batch).unwrap();
            for index in 0..loader.len() {
                let clip = loader.clip(index).unwrap();
                let rewards = episodes[clip.episode].get::<f64>("reward").unwrap();
                assert!(rewards[0].is_nan() && !rewards[1..].iter().any(|reward| reward.is_nan()));
                let row = batch.row(index);
                for step in 0..steps {
                    let wanted = summed(rewards, clip.start + step * skip, skip);
                    let found = match float32 {
                        true => f64::from(row.get::<f32>("reward").unwrap()[step]),
                        false => row.get::<f64>("reward").unwrap()[step],
                    };
                    let wanted = if float32 { f64::from(wanted as f32) } else { wanted };
                    assert_eq!(found.to_bits(), wanted.to_bits(), "{steps} {skip} {index} {step}");
                    let actions = row.get::<f32>("action").unwrap();
                    let block = &actions[step * skip * 2..][..skip * 2];
                    assert_eq!(found.is_nan(), block.iter().any(|value| value.is_nan()));
                }
            }
        }
    }
}

#[test]
fn columns_of_f64_become_f32_when_asked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..1).unwrap();
    let goals = GoalOptions::hindsight(&["state"], 3);
    let options = ClipOptions::default().num_steps(2).goals(Some(goals));
    let (stored, narrow) = (loader(&path, &options), loader(&path, &options.clone().float32(true)));
    let (mut a, mut b) = (stored.new_batch(), narrow.new_batch());
    stored.read(&[0, 2], &mut a).unwrap();
    narrow.read(&[0, 2], &mut b).unwrap();
    for name in ["state", "goal_state", "reward"] {
        let wanted: Vec<u32> =
            a.get::<f64>(name).unwrap().iter().map(|&value| (value as f32).to_bits()).collect();
        let found: Vec<u32> = b.get::<f32>(name).unwrap().iter().map(|value| value.to_bits()).collect();
        assert_eq!(found, wanted, "{name}");
    }
    assert_eq!(a.get::<i64>("step_idx").unwrap(), b.get::<i64>("step_idx").unwrap());
}

#[test]
fn channels_come_first_when_asked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..1).unwrap();
    let keys = Some(vec!["pixels".to_owned()]);
    let options = ClipOptions::default().num_steps(2).keys(keys);
    let last = loader(&path, &options);
    let first = loader(&path, &options.images(Images::ChannelsFirst));
    assert_eq!(first.schema().fields()[0].shape, [2, 3, 40, 40]);
    let (mut a, mut b) = (last.new_batch(), first.new_batch());
    last.read(&[1], &mut a).unwrap();
    first.read(&[1], &mut b).unwrap();
    let (a, b) = (a.get::<u8>("pixels").unwrap(), b.get::<u8>("pixels").unwrap());
    for step in 0..2 {
        for channel in 0..3 {
            for pixel in 0..1600 {
                assert_eq!(a[step * 4800 + pixel * 3 + channel], b[step * 4800 + channel * 1600 + pixel]);
            }
        }
    }
}

#[test]
fn batches_are_those_of_single_reads_whatever_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..4).unwrap();
    let pass = |threads, shuffle| {
        let options = ClipOptions::default().num_steps(4).threads(Some(threads));
        let loader = loader(&path, &options);
        let batches = BatchOptions::default().size(32).shuffle(shuffle).epochs(Some(2));
        let mut stream = loader.batches(&batches).unwrap();
        let mut all: Vec<Batch> = Vec::new();
        for _ in 0..2 {
            all.extend(stream.by_ref().map(Result::unwrap));
        }
        assert!(stream.next().is_none());
        all
    };
    let batches = pass(1, Some(42));
    let clips = 2 + 297 + 14;
    assert_eq!(batches.iter().map(Batch::rows).sum::<usize>(), 2 * clips);
    assert_eq!(batches.last().unwrap().rows(), clips % 32);
    for (a, b) in batches.iter().zip(&pass(3, Some(42))) {
        assert_same(a, b);
    }
    let single = loader(&path, &ClipOptions::default().num_steps(4));
    let mut expected = single.new_batch();
    for (number, batch) in pass(2, None).iter().take(10).enumerate() {
        let clips: Vec<usize> = (32 * number..clips.min(32 * number + 32)).collect();
        single.read(&clips, &mut expected).unwrap();
        assert_same(batch, &expected);
    }
}

#[test]
fn images_are_resized_as_a_still_image_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..1).unwrap();
    let keys = Some(vec!["pixels".to_owned()]);
    let image = Some(swm_core::ImageSize { height: 16, width: 24 });
    let options = ClipOptions::default().num_steps(2).keys(keys);
    let plain = loader(&path, &options);
    let small = loader(&path, &options.clone().image(image).images(Images::ChannelsFirst));
    assert_eq!(small.schema().fields()[0].shape, [2, 3, 16, 24]);
    let (mut a, mut b) = (plain.new_batch(), small.new_batch());
    plain.read(&[2], &mut a).unwrap();
    small.read(&[2], &mut b).unwrap();
    let mut resize = swm_render::AntialiasBilinear::new([40, 40], [16, 24]).unwrap();
    let (stored, resized) = (a.get::<u8>("pixels").unwrap(), b.get::<u8>("pixels").unwrap());
    let mut expected = vec![0; 16 * 24 * 3];
    for step in 0..2 {
        resize.resize(&stored[step * 4800..][..4800], &mut expected).unwrap();
        for (at, value) in expected.iter().enumerate() {
            assert_eq!(resized[step * 1152 + at % 3 * 384 + at / 3], *value);
        }
    }
}

#[test]
fn unusable_settings_say_what_is_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..2).unwrap();
    let refused =
        |options: &ClipOptions| Loader::new(open(&path).unwrap(), options).err().unwrap().to_string();
    let plain = ClipOptions::default;
    assert!(refused(&plain().num_steps(0)).contains("num_steps"));
    assert!(refused(&plain().frameskip(0)).contains("frameskip"));
    assert!(refused(&plain().num_steps(2).frameskip(usize::MAX)).contains("too many"));
    let message = refused(&plain().num_steps(3).frameskip(2));
    assert!(message.contains("spans 6 rows") && message.contains("longest episode has 5"), "{message}");
    let message = refused(&plain().keys(Some(vec!["pixel".to_owned()])));
    assert!(message.contains("did you mean `pixels`"), "{message}");
    let twice = vec!["state".to_owned(), "state".to_owned()];
    assert!(refused(&plain().keys(Some(twice))).contains("`state`"));

    let first = loader(&path, &plain());
    for ahead in [0, 1 << 30] {
        let refused = first.batches(&BatchOptions::default().ahead(ahead)).err().unwrap().to_string();
        assert!(refused.contains("`ahead`") && refused.contains("use 1 to 1024"), "{refused}");
    }
    let mut batch = first.new_batch();
    assert!(first.read(&[6], &mut batch).unwrap_err().to_string().contains("there are 6"));
    let other = loader(&path, &plain().num_steps(2));
    assert!(other.read(&[0], &mut batch).unwrap_err().to_string().contains("another loader"));
    assert_eq!(open(&path).unwrap().num_episodes(), 2);
}
