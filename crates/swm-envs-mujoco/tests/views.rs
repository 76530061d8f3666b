//! Columns of pictures: cameras, depth, segmentation, quality.

use serde_json::{Value as Json, json};
use swm_core::{
    Batch, Dtype, Env, EnvConfig, EnvError, Episode, EpisodeSeed, ImageSize, ResetOptions, Schema,
};
use swm_envs_mujoco::CHEETAH;
use swm_render::scene::NO_SEGMENT;

const HEIGHT: usize = 48;
const WIDTH: usize = 64;

fn make(settings: Json) -> Result<Box<dyn Env>, EnvError> {
    let Json::Object(settings) = settings else { panic!("settings are an object") };
    (CHEETAH.make)(&EnvConfig { image: Some(ImageSize { height: HEIGHT, width: WIDTH }), settings })
}

fn row(settings: Json) -> Batch {
    let mut env = make(settings).expect("it was set up");
    let mut row = Batch::new(Schema::new(env.spec().fields.clone()).expect("distinct names"), 1);
    let options = ResetOptions::default();
    env.reset(&Episode { seed: EpisodeSeed::new(4), options: &options }).expect("a start");
    env.observe(&mut row.rows_mut());
    row
}

fn refused(settings: Json) -> String {
    make(settings).err().expect("it is refused").to_string()
}

#[test]
fn cameras_and_labels_are_columns() {
    let all = row(json!({"cameras": ["back"], "depth": true, "segmentation": true}));
    let shapes: Vec<(&str, Dtype, &[usize])> = all
        .schema()
        .fields()
        .iter()
        .filter(|field| field.name.starts_with("pixels"))
        .map(|field| (field.name.as_str(), field.dtype, field.shape.as_slice()))
        .collect();
    let (picture, plane): (&[usize], &[usize]) = (&[HEIGHT, WIDTH, 3], &[HEIGHT, WIDTH]);
    assert_eq!(
        shapes,
        [
            ("pixels", Dtype::U8, picture),
            ("pixels_depth", Dtype::F32, plane),
            ("pixels_segmentation", Dtype::I32, plane),
            ("pixels.back", Dtype::U8, picture),
            ("pixels_depth.back", Dtype::F32, plane),
            ("pixels_segmentation.back", Dtype::I32, plane),
        ]
    );
    // Each is what an environment shows that looks through that camera only.
    let (side, back) = (row(json!({})), row(json!({"camera": "back"})));
    let pixels = |row: &Batch, name: &str| row.get::<u8>(name).expect("pictures").to_vec();
    assert!(pixels(&all, "pixels") == pixels(&side, "pixels"));
    assert!(pixels(&all, "pixels.back") == pixels(&back, "pixels"));
    assert!(pixels(&all, "pixels") != pixels(&all, "pixels.back"));
    for camera in ["", ".back"] {
        let depth = all.get::<f32>(&format!("pixels_depth{camera}")).expect("depth");
        let segments = all.get::<i32>(&format!("pixels_segmentation{camera}")).expect("segments");
        let nearest = depth.iter().copied().fold(f32::INFINITY, f32::min);
        let farthest = depth.iter().copied().fold(0.0, f32::max);
        assert!(nearest > 0.5 && nearest < 5.0 && farthest > 50.0, "{nearest} {farthest}");
        for (depth, segment) in depth.iter().zip(segments) {
            assert_eq!(*segment == NO_SEGMENT, *depth == farthest, "the sky is farthest, and shows nothing");
        }
        assert!(segments.contains(&0) && segments.iter().any(|&segment| segment > 1));
    }
}

#[test]
fn quality_shows() {
    let pixels = |settings: Json| row(settings).get::<u8>("pixels").expect("pictures").to_vec();
    let best = pixels(json!({}));
    for name in ["antialias", "shadows", "reflections"] {
        assert!(pixels(json!({name: false})) != best, "{name}");
    }
}

#[test]
fn what_cannot_be_shown_is_refused_with_the_way_out() {
    let message = refused(json!({"cameras": "bakc"}));
    assert!(message.contains("bakc") && message.contains("`back`"), "{message}");
    assert!(refused(json!({"cameras": [1, "back"]})).contains("named twice"));
    assert!(refused(json!({"cameras": [9]})).contains("no camera 9"));
    let message = refused(json!({"renderer": "gl", "depth": true}));
    assert!(message.contains("renderer=software"), "{message}");
}

#[test]
fn the_renderer_is_named() {
    assert_eq!(
        make(json!({})).expect("it was set up").renderer().as_deref(),
        Some("swm-render 0.1.0 (software)")
    );
    let blind = (CHEETAH.make)(&EnvConfig::default()).expect("it was set up");
    assert_eq!(blind.renderer(), None);
}
