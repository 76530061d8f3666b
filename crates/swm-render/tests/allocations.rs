//! Drawing a frame allocates nothing once the renderer has seen frames like it. A binary of its own: it counts for the
//! whole process.

use std::alloc::System;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use swm_render::{Geometry, Painter, Renderer, Style};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

fn draw(p: &mut dyn Painter, time: f64) {
    let (x, y) = (256.0 + 150.0 * time.sin(), 256.0 + 150.0 * time.cos());
    p.polygon(&[[x, y], [x + 90.0, y + 20.0], [x + 60.0, y + 70.0], [x - 10.0, y + 40.0]], [200, 0, 0]);
    p.disc([y, x], 15.0, [0, 0, 200]);
    p.fat_segment([5.0, 5.0], [506.0, 5.0], [211; 3]);
    p.fat_segment([x, y], [y, x], [211; 3]);
    p.aa_line([y, y], [x, y], [231, 76, 60]);
}

#[test]
fn frames_and_backgrounds_do_not_allocate() {
    for (style, size) in [(Style::Exact, 224), (Style::Exact, 64), (Style::Fast, 64)] {
        let mut renderer = Renderer::new(style, Geometry::new(size, size)).expect("sizes are fine");
        let mut frame = vec![0; size * size * 3];
        let mut run = |frames: std::ops::Range<u8>| {
            for i in frames {
                renderer.set_background(|p| p.fill([i / 8; 3]));
                renderer.render(&mut frame, |p| draw(p, f64::from(i))).expect("the length fits");
            }
        };
        run(0..16);
        let region = Region::new(ALLOCATOR);
        run(16..80);
        let change = region.change();
        assert_eq!((change.allocations, change.reallocations), (0, 0), "{style:?} at {size}");
    }
}
