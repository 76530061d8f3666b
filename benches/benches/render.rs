//! The renderer alone: frames of a scene like PushT's in both styles, and the two resizes of the exact one.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use swm_render::{AntialiasBilinear, Canvas, FixedBilinear, Geometry, Painter, Renderer, Style};

/// A goal below, a disc and a T of two outlined boxes above, as PushT draws them.
struct Scene {
    agent: [f64; 2],
    block: [f64; 2],
    angle: f64,
}

const T_PARTS: [[f64; 4]; 2] = [[-60.0, 0.0, 60.0, 30.0], [-15.0, 30.0, 15.0, 120.0]];

impl Scene {
    /// Frame `frame` of a video in which the agent always moves, and the block too if `pushed`.
    fn at(frame: u32, pushed: bool) -> Self {
        let time = f64::from(frame) * 0.1;
        let moved = if pushed { time } else { 0.0 };
        Self {
            agent: [256.0 + 180.0 * time.cos(), 256.0 + 180.0 * (1.3 * time).sin()],
            block: [250.0 + 40.0 * moved.sin(), 260.0],
            angle: 0.5 * moved,
        }
    }

    fn draw_goal(painter: &mut dyn Painter) {
        painter.fill([255, 255, 255]);
        for part in T_PARTS {
            painter.polygon(&corners(part, [256.0, 256.0], std::f64::consts::FRAC_PI_4), [144, 238, 144]);
        }
    }

    fn draw(&self, painter: &mut dyn Painter) {
        for part in T_PARTS {
            let corners = corners(part, self.block, self.angle);
            painter.polygon(&corners, [138, 152, 174]);
            for (index, &from) in corners.iter().enumerate() {
                painter.fat_segment(from, corners[(index + 1) % 4], [115, 127, 145]);
            }
        }
        painter.disc(self.agent, 15.0, [65, 105, 225]);
        painter.disc(self.agent, 11.0, [78, 126, 255]);
    }
}

fn corners([x0, y0, x1, y1]: [f64; 4], [cx, cy]: [f64; 2], angle: f64) -> [[f64; 2]; 4] {
    let (sin, cos) = angle.sin_cos();
    [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(|[x, y]| [cx + cos * x - sin * y, cy + sin * x + cos * y])
}

/// Frames by style and size: all drawn anew, the agent and the block moved, the agent alone moved.
fn frames(c: &mut Criterion) {
    let mut group = c.benchmark_group("frame");
    group.throughput(Throughput::Elements(1));
    for (style, style_name) in [(Style::Exact, "exact"), (Style::Fast, "fast")] {
        for side in [64, 224] {
            let mut out = vec![0; side * side * 3];
            for (what, full, pushed) in
                [("full", true, true), ("pushing", false, true), ("moving", false, false)]
            {
                let mut renderer =
                    Renderer::new(style, Geometry::new(side, side)).expect("the sizes are valid");
                renderer.set_background(Scene::draw_goal);
                let mut frame = 0;
                group.bench_function(format!("{style_name}/{side}/{what}"), |b| {
                    b.iter(|| {
                        frame += 1;
                        if full {
                            // A different background, as at a reset, leaves nothing of the last frame.
                            let shade = 250 + (frame % 2) as u8;
                            renderer.set_background(|painter| painter.fill([shade; 3]));
                        }
                        let scene = Scene::at(frame, pushed);
                        renderer.render(&mut out, |painter| scene.draw(painter)).expect("the frame fits");
                    });
                });
            }
        }
    }
    group.finish();
}

/// The two filters of the exact style on whole images.
fn resizes(c: &mut Criterion) {
    let mut group = c.benchmark_group("resize");
    let noise: Vec<u8> =
        (0..512_u32 * 512 * 3).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let canvas = Canvas::from_rgb(512, 512, &noise).expect("the size fits");
    let mut image = vec![0; 224 * 224 * 3];
    let mut fixed = FixedBilinear::new(512, 224).expect("the sizes are valid");
    group.bench_function("fixed/512_to_224", |b| {
        b.iter(|| fixed.resize(&canvas, &mut image).expect("the size fits"));
    });
    for side in [64, 96] {
        let mut small = vec![0; side * side * 3];
        let mut antialias = AntialiasBilinear::new([224; 2], [side; 2]).expect("the sizes are valid");
        group.bench_function(format!("antialias/224_to_{side}"), |b| {
            b.iter(|| antialias.resize(&image, &mut small).expect("the size fits"));
        });
    }
    group.finish();
}

criterion_group!(benches, frames, resizes);
criterion_main!(benches);
