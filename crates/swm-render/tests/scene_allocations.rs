//! Drawing a 3D scene allocates nothing after the first frame. A binary of its own: it counts for the whole process.
#![cfg(feature = "scene")]

#[path = "scene/stage.rs"]
mod stage;

use std::alloc::System;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use swm_render::Geometry;
use swm_render::scene::{Quality, SceneRenderer};

use stage::Stage;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const HEIGHT: usize = 48;
const WIDTH: usize = 64;

#[test]
fn frames_do_not_allocate() {
    let mut stage = Stage::new();
    let geometry = Geometry::new(HEIGHT, WIDTH);
    let mut renderer = SceneRenderer::new(geometry, Quality::default()).expect("sizes are fine");
    let mut frame = vec![0; HEIGHT * WIDTH * 3];
    let (mut depth, mut segments) = (vec![0.0; HEIGHT * WIDTH], vec![0; HEIGHT * WIDTH]);
    let mut run = |frames: std::ops::Range<u8>| {
        for time in frames {
            stage.turn(f64::from(time));
            renderer.render(&stage.scene, &stage.assets, &mut frame).expect("a sound scene");
            renderer.depth_of_last(&stage.scene, &stage.assets, &mut depth).expect("of its size");
            renderer.segmentation_of_last(&stage.scene, &stage.assets, &mut segments).expect("of its size");
        }
    };
    run(0..1);
    let region = Region::new(ALLOCATOR);
    run(1..40);
    let change = region.change();
    assert_eq!((change.allocations, change.reallocations), (0, 0));
}
