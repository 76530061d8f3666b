//! The model on dots of any color: that it learns, what its frames are, and that neighbors change no bits.

use rand::RngExt as _;
use serde_json::json;
use swm_core::seed::keyed;

use crate::models::dots::{BYTES, CLIPS, SIDE, clips, image, images};
use crate::{Baseline, ClipBatch, DataDims, Device, Images, MakeOptions, Step, make, restore};

const STEPS: usize = 2;

/// Clips of a dot that jumps about on a table, in sampled colors, and white on black.
struct Dots {
    pixels: Vec<u8>,
    canonical: Vec<u8>,
    actions: Vec<f32>,
}

impl Dots {
    fn new(seed: u64) -> Self {
        let mut stream = keyed(seed, "test looks", [0, 0]);
        let (mut pixels, mut canonical) = (Vec::new(), Vec::new());
        for _ in 0..CLIPS {
            let table: [u8; 3] = [(); 3].map(|()| stream.random_range(0..80));
            let dot: [u8; 3] = [(); 3].map(|()| stream.random_range(150..=255));
            for _ in 0..STEPS {
                let shape = image([(); 2].map(|()| stream.random_range(2..=13)));
                let color = |(at, value): (usize, &u8)| if *value == 0 { table[at % 3] } else { dot[at % 3] };
                pixels.extend(shape.iter().enumerate().map(color));
                canonical.extend(shape);
            }
        }
        Self { pixels, canonical, actions: vec![0.0; CLIPS * STEPS * 2] }
    }

    fn batch(&self) -> ClipBatch<'_> {
        let canonical = Some(images(&self.canonical, STEPS));
        ClipBatch { canonical, ..clips(&self.pixels, &self.actions, STEPS) }
    }
}

fn tiny(frames: usize) -> Box<dyn Baseline> {
    let model =
        json!({"image": SIDE, "channels": [8, 8, 8], "frames": frames, "clip": STEPS, "frameskip": 1});
    let changes = json!({"model": model, "optim": {"lr": 0.01, "schedule": "constant", "ema": 0.0}});
    let dims = DataDims { action_dim: 2, proprio_dim: 0 };
    make("canonical", &MakeOptions { changes, seed: 1, ..MakeOptions::new("small", dims) }).unwrap()
}

fn trained(frames: usize, steps: u64) -> Box<dyn Baseline> {
    let mut model = tiny(frames);
    for step in 0..steps {
        model.train_step(&Dots::new(step).batch(), &Step { seed: 1, phase: 0, step, total: steps }).unwrap();
    }
    model
}

#[test]
fn it_learns_to_draw_the_canonical_look() {
    let unseen = Dots::new(1000);
    for frames in [1, 2] {
        let model = trained(frames, 150);
        let unexplained = model.validate(&unseen.batch(), 0).unwrap().total;
        assert!(unexplained < 0.4, "{frames} frames: {unexplained}");
        // As bytes, the dot is in its place: the brightest pixel of each drawing lies on it.
        let drawer = model.canonicalizer().unwrap();
        let all = images(&unseen.pixels, STEPS);
        let drawn = drawer.draw(&all, &all).unwrap();
        assert_eq!((drawer.side(), drawn.len()), (SIDE, unseen.pixels.len()));
        let brightest = |image: &[u8]| {
            let sum = |pixel: &[u8]| pixel.iter().map(|value| u32::from(*value)).sum::<u32>();
            image.chunks(3).enumerate().max_by_key(|(_, pixel)| sum(pixel)).unwrap().0
        };
        let found = drawn.chunks(BYTES).zip(unseen.canonical.chunks(BYTES));
        let right = found.filter(|(drawn, wanted)| wanted[3 * brightest(drawn)] == 255).count();
        assert!(right > CLIPS * STEPS * 8 / 10, "{frames} frames: {right} of {}", CLIPS * STEPS);
    }
}

#[test]
fn the_other_frame_is_seen_by_two_frames_alone() {
    let dots = Dots::new(7);
    let [first, second] = [0, 1].map(|at| &dots.pixels[at * BYTES..][..BYTES]);
    let one = |values| Images { rows: 1, ..images(values, 1) };
    for (frames, sees) in [(1, false), (2, true)] {
        let model = trained(frames, 3);
        let drawer = model.canonicalizer().unwrap();
        let alone = drawer.draw(&one(first), &one(first)).unwrap();
        let beside = drawer.share().draw(&one(first), &one(second)).unwrap();
        assert_eq!(alone != beside, sees, "{frames} frames");
    }
}

#[test]
fn drawings_do_not_depend_on_when_and_with_what_they_are_made() {
    let dots = Dots::new(8);
    let mut model = trained(2, 3);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    model.save_weights(&path).unwrap();
    let mut again = restore(model.model_config(), Device::Cpu).unwrap();
    again.load_weights(&path).unwrap();
    let pair = |values| Images { rows: 2, ..images(values, 1) };
    let [now, goal] = [0, 2].map(|at| &dots.pixels[at * BYTES..][..2 * BYTES]);
    let drawer = model.canonicalizer().unwrap();
    let drawn = drawer.draw(&pair(now), &pair(goal)).unwrap();
    let all = images(&dots.pixels, STEPS);
    drawer.draw(&all, &all).unwrap();
    assert_eq!(drawer.draw(&pair(now), &pair(goal)).unwrap(), drawn, "after others");
    assert_eq!(
        again.canonicalizer().unwrap().draw(&pair(now), &pair(goal)).unwrap(),
        drawn,
        "saved and loaded"
    );
    // A copy keeps the weights of its moment.
    model.train_step(&dots.batch(), &Step { seed: 1, phase: 0, step: 3, total: 10 }).unwrap();
    assert_eq!(drawer.draw(&pair(now), &pair(goal)).unwrap(), drawn);
    assert_ne!(model.canonicalizer().unwrap().draw(&pair(now), &pair(goal)).unwrap(), drawn);
    let few = Images { rows: 1, ..images(&now[..BYTES], 1) };
    let error = drawer.draw(&pair(now), &few).unwrap_err().to_string();
    assert!(error.contains("2 images beside 1 others"), "{error}");
}

#[test]
fn what_it_cannot_learn_from_is_refused() {
    let dots = Dots::new(9);
    let at = Step { seed: 1, phase: 0, step: 0, total: 10 };
    let mut model = tiny(2);
    assert!(model.learns_canonical());
    let error =
        model.train_step(&ClipBatch { canonical: None, ..dots.batch() }, &at).unwrap_err().to_string();
    assert!(error.contains("`canonical`: the batch has no images in the canonical look"), "{error}");
    let few = Images { rows: 1, ..images(&dots.canonical[..STEPS * BYTES], STEPS) };
    let error =
        model.train_step(&ClipBatch { canonical: Some(few), ..dots.batch() }, &at).unwrap_err().to_string();
    assert!(error.contains("of the same rows"), "{error}");
    for (changes, reason) in [
        (json!({"model": {"image": 20}}), "`model.image` is 20; it must be a multiple of 8"),
        (json!({"model": {"frames": 3}}), "`model.frames` is 3"),
        (json!({"model": {"channels": [8, 0, 8]}}), "`model.channels` is 0"),
    ] {
        let dims = DataDims { action_dim: 2, proprio_dim: 0 };
        let made = make("canonical", &MakeOptions { changes, ..MakeOptions::new("small", dims) });
        let message = made.err().unwrap().to_string();
        assert!(message.contains(reason), "{message}");
    }
}
