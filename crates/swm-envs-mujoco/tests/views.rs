//! Columns of images: cameras, depth, segmentation, quality.

use serde_json::{Value as Json, json};
use swm_core::{
    Batch, Dtype, Env, EnvConfig, EnvEntry, EnvError, Episode, EpisodeSeed, ImageSize, ResetOptions, Schema,
    Value,
};
use swm_envs_mujoco::{CHEETAH, OGB_CUBE, OGB_SCENE};
use swm_render::scene::NO_SEGMENT;

const HEIGHT: usize = 48;
const WIDTH: usize = 64;

fn make(settings: Json) -> Result<Box<dyn Env>, EnvError> {
    make_of(&CHEETAH, settings)
}

fn make_of(entry: &EnvEntry, settings: Json) -> Result<Box<dyn Env>, EnvError> {
    let Json::Object(settings) = settings else { panic!("settings are an object") };
    entry.make(&EnvConfig { image: Some(ImageSize { height: HEIGHT, width: WIDTH }), settings })
}

fn row(settings: Json) -> Batch {
    row_of(&CHEETAH, settings, &ResetOptions::default())
}

fn row_of(entry: &EnvEntry, settings: Json, options: &ResetOptions) -> Batch {
    let mut env = make_of(entry, settings).expect("it was set up");
    let mut row = Batch::new(Schema::new(env.spec().fields.clone()).expect("distinct names"), 1);
    env.reset(&Episode::new(EpisodeSeed::new(4), options)).expect("a start");
    env.write_episode(&mut row.rows_mut());
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
    let (image, plane): (&[usize], &[usize]) = (&[HEIGHT, WIDTH, 3], &[HEIGHT, WIDTH]);
    assert_eq!(
        shapes,
        [
            ("pixels", Dtype::U8, image),
            ("pixels_depth", Dtype::F32, plane),
            ("pixels_segmentation", Dtype::I32, plane),
            ("pixels.back", Dtype::U8, image),
            ("pixels_depth.back", Dtype::F32, plane),
            ("pixels_segmentation.back", Dtype::I32, plane),
        ]
    );
    // Each is what an environment shows that looks through that camera only.
    let (side, back) = (row(json!({})), row(json!({"camera": "back"})));
    let pixels = |row: &Batch, name: &str| row.get::<u8>(name).expect("images").to_vec();
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
fn tables_have_the_same_columns() {
    let pixels = |row: &Batch, name: &str| row.get::<u8>(name).expect("images").to_vec();
    // All cameras show another floor, and the goal does.
    let floor = Value { shape: vec![2, 3], ..Value::vector(&[0.9, 0.1, 0.1, 0.1, 0.1, 0.9]) };
    let options = ResetOptions::default().set("floor.color", floor);
    for entry in [&OGB_CUBE, &OGB_SCENE] {
        let row = |settings| row_of(entry, settings, &options);
        let all = row(json!({"cameras": "side_pixels", "depth": true, "segmentation": true}));
        let names: Vec<&str> = all.schema().fields().iter().map(|field| field.name.as_str()).collect();
        assert_eq!(
            names[names.len() - 7..],
            [
                "goal",
                "pixels",
                "pixels_depth",
                "pixels_segmentation",
                "pixels.side_pixels",
                "pixels_depth.side_pixels",
                "pixels_segmentation.side_pixels",
            ]
        );
        let (front, side) = (row(json!({})), row(json!({"camera": "side_pixels"})));
        assert!(pixels(&all, "goal") == pixels(&front, "goal"));
        assert!(pixels(&all, "pixels") == pixels(&front, "pixels"));
        assert!(pixels(&all, "pixels.side_pixels") == pixels(&side, "pixels"));
        let plain = row_of(entry, json!({"cameras": "side_pixels"}), &ResetOptions::default());
        for name in ["goal", "pixels", "pixels.side_pixels"] {
            let differing =
                pixels(&all, name).iter().zip(pixels(&plain, name)).filter(|(a, b)| **a != *b).count();
            assert!(4 * differing > HEIGHT * WIDTH * 3, "{} {name}: {differing}", entry.id);
        }
        let segments = all.get::<i32>("pixels_segmentation.side_pixels").expect("segments");
        assert!(segments.iter().any(|segment| *segment > 0));
        assert!(pixels(&row(json!({"shadows": false})), "pixels") != pixels(&front, "pixels"));
    }
}

#[test]
fn quality_shows() {
    let pixels = |settings: Json| row(settings).get::<u8>("pixels").expect("images").to_vec();
    let best = pixels(json!({}));
    for name in ["antialias", "shadows", "reflections"] {
        assert!(pixels(json!({name: false})) != best, "{name}");
    }
}

#[test]
fn what_cannot_be_shown_is_refused_with_the_fix() {
    let message = refused(json!({"cameras": "bakc"}));
    assert!(message.contains("bakc") && message.contains("`back`"), "{message}");
    let message = refused(json!({"camreas": "back"}));
    assert!(message.contains("camreas") && message.contains("cameras, depth"), "{message}");
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
    let blind = CHEETAH.make(&EnvConfig::default()).expect("it was set up");
    assert_eq!(blind.renderer(), None);
}
