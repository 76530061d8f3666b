//! Whole images of 3D scenes: that they are the same bytes everywhere, and that settings do what they say.
#![cfg(feature = "scene")]

mod stage;

use swm_render::Geometry;
use swm_render::scene::{NO_SEGMENT, Quality, SceneRenderer};

use stage::Stage;

const HEIGHT: usize = 48;
const WIDTH: usize = 64;

fn renderer(quality: Quality) -> SceneRenderer {
    SceneRenderer::new(Geometry::new(HEIGHT, WIDTH), quality).expect("sizes are fine")
}

fn image(renderer: &mut SceneRenderer, stage: &Stage) -> Vec<u8> {
    let mut frame = vec![0; HEIGHT * WIDTH * 3];
    renderer.render(&stage.scene, &stage.assets, &mut frame).expect("a sound scene");
    frame
}

/// FNV-1a.
fn hash(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// Every shape, light, mapping and pass is in this image. Its bytes are the same on every CPU: where this fails on
/// one and nowhere else, something depends on the machine. Where images are meant to change, so does this number.
#[test]
fn an_image_has_the_same_bytes_on_every_machine() {
    let mut stage = Stage::new();
    let mut video = Vec::new();
    let mut first = renderer(Quality::default());
    for frame in 0..3 {
        stage.turn(f64::from(frame));
        video.extend(image(&mut first, &stage));
        assert!(
            image(&mut renderer(Quality::default()), &stage) == video[video.len() - HEIGHT * WIDTH * 3..]
        );
    }
    assert_eq!(hash(&video), 0x93d3_442a_730c_33f7, "{:#018x}", hash(&video));
}

#[test]
fn qualities_show_where_they_should() {
    let mut stage = Stage::new();
    stage.turn(0.0);
    let plain = Quality { antialias: false, shadows: false, reflections: false };
    let mut base = renderer(plain);
    let without = image(&mut base, &stage);
    let mut segments = vec![0; HEIGHT * WIDTH];
    base.segmentation_of_last(&stage.scene, &stage.assets, &mut segments).expect("of its size");
    let changed = |quality: Quality| -> Vec<i32> {
        let with = image(&mut renderer(quality), &stage);
        let pairs = with.chunks_exact(3).zip(without.chunks_exact(3)).zip(&segments);
        pairs.filter(|((a, b), _)| a != b).map(|(_, segment)| *segment).collect()
    };
    let mirrored = changed(Quality { reflections: true, ..plain });
    let is_mirror = |segment: &i32| [stage::FLOOR, stage::VEIL].contains(segment);
    assert!(mirrored.len() > 20 && mirrored.iter().all(is_mirror), "{mirrored:?}");
    let shaded = changed(Quality { shadows: true, ..plain });
    assert!(shaded.len() > 50 && shaded.iter().all(|&segment| segment != NO_SEGMENT), "{shaded:?}");
    let smooth = changed(Quality { antialias: true, ..plain });
    assert!(smooth.len() > 100 && smooth.len() < HEIGHT * WIDTH / 2, "{}", smooth.len());
}

#[test]
fn veils_are_seen_through_and_labeled() {
    let mut stage = Stage::new();
    stage.turn(0.0);
    let mut renderer = renderer(Quality::default());
    let mut labels = |stage: &Stage| {
        let (mut depth, mut segments) = (vec![0.0; HEIGHT * WIDTH], vec![0; HEIGHT * WIDTH]);
        renderer.render_depth(&stage.scene, &stage.assets, &mut depth).expect("a sound scene");
        renderer.render_segmentation(&stage.scene, &stage.assets, &mut segments).expect("a sound scene");
        (depth, segments)
    };
    let (depth, segments) = labels(&stage);
    assert!(segments.contains(&stage::VEIL));
    stage.scene.instances.retain(|instance| instance.segment != stage::VEIL);
    let (behind, others) = labels(&stage);
    for at in 0..segments.len() {
        if segments[at] == stage::VEIL {
            assert!(depth[at] < behind[at]);
        } else {
            assert_eq!((segments[at], depth[at]), (others[at], behind[at]));
        }
    }
}

/// Renderers of one thread work in the same memory: none sees what another left there.
#[test]
fn renderers_of_a_thread_take_turns() {
    let (mut stage, mut later) = (Stage::new(), Stage::new());
    stage.turn(0.0);
    later.turn(5.0);
    let labels = |renderer: &mut SceneRenderer, stage: &Stage| {
        let (mut depth, mut segments) = (vec![0.0; HEIGHT * WIDTH], vec![0; HEIGHT * WIDTH]);
        renderer.depth_of_last(&stage.scene, &stage.assets, &mut depth).expect("of its size");
        renderer.segmentation_of_last(&stage.scene, &stage.assets, &mut segments).expect("of its size");
        (depth, segments)
    };
    let mut alone = renderer(Quality::default());
    let expected = (image(&mut alone, &stage), labels(&mut alone, &stage));
    let mut large =
        SceneRenderer::new(Geometry::new(2 * HEIGHT, WIDTH), Quality::default()).expect("sizes are fine");
    let (mut first, mut second) = (renderer(Quality::default()), renderer(Quality::default()));
    let mut frame = vec![0; 2 * HEIGHT * WIDTH * 3];
    for _ in 0..2 {
        let found = image(&mut first, &stage);
        large.render(&later.scene, &later.assets, &mut frame).expect("a sound scene");
        assert!(image(&mut second, &later) != found);
        assert!((found, labels(&mut first, &stage)) == expected);
    }
}
