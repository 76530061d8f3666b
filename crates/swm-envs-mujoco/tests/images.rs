//! Images by OpenGL against those of the reference, at the recorded cases.
//!
//! The recorded ones were rendered through EGL by Mesa 22.3.6 in software; other drivers round differently, so that what is
//! asserted leaves room for them. The output says how many pixels are equal. Without OpenGL the tests say so and pass.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::PathBuf;

use serde::Deserialize;
use swm_core::env::PIXELS;
use swm_core::{
    Batch, Env, EnvConfig, EnvError, Episode, EpisodeSeed, ImageSize, ResetOptions, Schema, Value,
};
use swm_mujoco::gl::GlContext;

/// A case in `tests/golden/pictures/scenes.json`; its image has the same name.
#[derive(Deserialize)]
struct Recorded {
    factors: BTreeMap<String, serde_json::Value>,
    start: BTreeMap<String, Vec<f64>>,
}

const SIDE: usize = 224;

fn golden(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/pictures").join(name)
}

fn cases() -> BTreeMap<String, Recorded> {
    let text = std::fs::read_to_string(golden("scenes.json")).expect("the cases are committed");
    serde_json::from_str(&text).expect("cases")
}

/// Whether there is OpenGL; prints why not.
fn has_gl() -> bool {
    match GlContext::new() {
        Ok(context) => {
            println!("rendered through {}", context.driver_name());
            true
        }
        Err(error) => {
            println!("skipped: {error}");
            false
        }
    }
}

fn make(settings: &[(&str, serde_json::Value)]) -> Result<Box<dyn Env>, EnvError> {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    let config = EnvConfig { image: Some(ImageSize { height: SIDE, width: SIDE }), settings };
    swm_envs_mujoco::CHEETAH.make(&config)
}

fn cheetah() -> (Box<dyn Env>, Batch) {
    let env = make(&[("renderer", "gl".into())]).expect("there is OpenGL");
    let row = Batch::new(Schema::new(env.spec().fields.clone()).expect("distinct names"), 1);
    (env, row)
}

/// The image of a case, `[224, 224, 3]`.
fn render((env, row): &mut (Box<dyn Env>, Batch), case: &Recorded) -> Vec<u8> {
    let mut options = ResetOptions { variation: Some(Vec::new()), ..ResetOptions::default() };
    for (name, value) in &case.factors {
        let value = Value::from_json(name, value).expect("numbers");
        options.variation_values.insert(name.clone(), value);
    }
    let start = case.start.iter().map(|(name, values)| (name.clone(), Value::vector(values)));
    options.start = Some(start.collect());
    env.reset(&Episode::new(EpisodeSeed::new(0), &options)).expect("a start");
    env.observe(&mut row.rows_mut());
    row.get::<u8>(PIXELS).expect("images were asked for").to_vec()
}

fn recorded(name: &str) -> Vec<u8> {
    let png = std::fs::read(golden(&format!("{name}.png"))).expect("the image is committed");
    let mut reader = png::Decoder::new(Cursor::new(png)).read_info().expect("a PNG header");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
    reader.next_frame(&mut pixels).expect("a PNG");
    pixels
}

#[test]
fn images_are_those_of_the_reference() {
    if !has_gl() {
        return;
    }
    let mut cheetah = cheetah();
    for (name, case) in &cases() {
        let (ours, theirs) = (render(&mut cheetah, case), recorded(name));
        assert_eq!(ours.len(), theirs.len(), "{name}");
        let differences = || ours.iter().zip(&theirs).map(|(a, b)| a.abs_diff(*b));
        let equal = ours.chunks_exact(3).zip(theirs.chunks_exact(3)).filter(|(a, b)| a == b).count();
        let mean = differences().map(f64::from).sum::<f64>() / ours.len() as f64;
        let worst = differences().max().unwrap();
        println!("{name}: {equal} of {} pixels equal, mean difference {mean:.4}, worst {worst}", SIDE * SIDE);
        assert!(mean < 1.0, "{name}: mean difference {mean} of 255");
    }
}

#[test]
fn images_do_not_depend_on_the_thread_or_on_other_environments() {
    if !has_gl() {
        return;
    }
    let cases = cases();
    let case = &cases["cheetah-0"];
    let first = render(&mut cheetah(), case);
    let threads: Vec<_> = (0..3).map(|_| cheetah()).collect();
    std::thread::scope(|scope| {
        for mut own in threads {
            let (cases, first) = (&cases, &first);
            scope.spawn(move || {
                render(&mut own, &cases["cheetah-floor.color"]);
                assert!(render(&mut own, case) == *first, "another image on another thread");
            });
        }
    });
}

#[test]
fn an_image_needs_a_camera_of_the_model() {
    for renderer in ["software", "gl"] {
        if renderer == "gl" && !has_gl() {
            continue;
        }
        let made = make(&[("renderer", renderer.into()), ("camera", 7.into())]);
        let message = made.err().unwrap().to_string();
        assert!(message.contains("no camera 7"), "{message}");
    }
}
