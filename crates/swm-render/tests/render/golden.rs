//! Golden images: the exact style is the reference's, to the byte; the fast style is close to it.
//!
//! `SWM_GOLDEN_DIR` names a larger set in the layout of `tests/golden/render`.

use std::fs::File;

use crate::scenes::{committed_dir, decode_png, golden_dir, golden_scenes};
use ndarray::Array1;
use ndarray_npy::NpzReader;
use swm_render::{AntialiasBilinear, Canvas, ExactRenderer, FixedBilinear, Geometry, Renderer, Style};

/// How many pixels differ, and by how many levels at most.
fn difference(ours: &[u8], theirs: &[u8]) -> (usize, u8) {
    assert_eq!(ours.len(), theirs.len());
    let pixels = ours.chunks_exact(3).zip(theirs.chunks_exact(3)).filter(|(a, b)| a != b);
    let levels = ours.iter().zip(theirs).map(|(a, b)| a.abs_diff(*b));
    (pixels.count(), levels.max().unwrap_or(0))
}

#[test]
fn exact_scenes_are_the_references() {
    let scenes = golden_scenes();
    let (mut equal_canvases, mut equal_images) = (0, 0);
    for (index, golden) in scenes.iter().enumerate() {
        let mut renderer = ExactRenderer::new(Geometry::new(224, 224)).expect("sizes are fine");
        let mut frame = vec![0; 224 * 224 * 3];
        renderer.set_background(|p| golden.scene.draw_background(p));
        renderer.render(&mut frame, |p| golden.scene.draw_rest(p)).expect("the length fits");
        let (canvas_pixels, canvas_levels) = difference(&renderer.canvas().to_rgb(), &golden.canvas);
        let (image_pixels, image_levels) = difference(&frame, &golden.image);
        // Contact lines: a few blended pixels come out one level off, by a rounding that is not known.
        let allowed = if golden.scene.segs.is_empty() { (0, 0) } else { (4, 1) };
        assert!(
            canvas_pixels <= allowed.0 && canvas_levels <= allowed.1,
            "scene {index}: {canvas_pixels} canvas pixels differ, by up to {canvas_levels}"
        );
        assert!(
            image_pixels <= allowed.0 && image_levels <= allowed.1,
            "scene {index}: {image_pixels} image pixels differ, by up to {image_levels}"
        );
        if canvas_pixels + image_pixels > 0 {
            println!(
                "scene {index}: {canvas_pixels} canvas, {image_pixels} image pixels differ by one level"
            );
        }
        equal_canvases += usize::from(canvas_pixels == 0);
        equal_images += usize::from(image_pixels == 0);
    }
    let count = scenes.len();
    println!("identical: {equal_canvases} of {count} canvases, {equal_images} of {count} images");
    let lines = scenes.iter().filter(|golden| !golden.scene.segs.is_empty()).count();
    let differ = count - equal_images;
    assert!(2 * differ < lines, "{differ} images differ, of {lines} with contact lines");
}

#[test]
fn resizes_are_the_references() {
    let mut cases = 0;
    for entry in std::fs::read_dir(golden_dir().join("image")).expect("the folder is readable") {
        let path = entry.expect("the folder is readable").path();
        if path.extension().is_none_or(|extension| extension != "npz") {
            continue;
        }
        let mut npz = NpzReader::new(File::open(&path).expect("readable")).expect("an npz file");
        let mut decoded = |name: &str| {
            let bytes: Array1<u8> = npz.by_name(name).expect("an array of bytes");
            decode_png(&bytes.to_vec())
        };
        let canvas = decoded("canvas512_png");
        let image = decoded("render224_png");
        let canvas = Canvas::from_rgb(512, 512, &canvas.rgb).expect("a 512-px canvas");
        let mut ours = vec![0; 224 * 224 * 3];
        FixedBilinear::new(512, 224)
            .and_then(|mut resize| resize.resize(&canvas, &mut ours))
            .expect("sizes and lengths fit");
        assert_eq!(difference(&ours, &image.rgb), (0, 0), "{}: 512 to 224", path.display());
        for size in ["32", "64", "84", "96", "128", "256", "48x64_hw"] {
            let theirs = decoded(&format!("pil_bilinear_{size}_png"));
            let ours = resized(&image.rgb, [224, 224], [theirs.height, theirs.width]);
            assert_eq!(difference(&ours, &theirs.rgb), (0, 0), "{}: 224 to {size}", path.display());
            cases += 1;
        }
    }
    println!("{cases} antialiased resizes identical");
    assert!(cases >= 28, "only {cases} cases found");
}

#[test]
fn resizes_of_noise_are_pillows() {
    let dir = committed_dir().join("pillow");
    let source = decode_png(&std::fs::read(dir.join("source.png")).expect("readable"));
    for (height, width) in
        [(17, 91), (40, 20), (64, 56), (1, 1), (100, 33), (7, 5), (39, 57), (80, 112), (20, 28)]
    {
        let file = dir.join(format!("{height}x{width}.png"));
        let theirs = decode_png(&std::fs::read(&file).expect("readable"));
        let ours = resized(&source.rgb, [source.height, source.width], [height, width]);
        assert_eq!(difference(&ours, &theirs.rgb), (0, 0), "{}", file.display());
    }
}

fn resized(image: &[u8], source: [usize; 2], target: [usize; 2]) -> Vec<u8> {
    let mut out = vec![0; target[0] * target[1] * 3];
    AntialiasBilinear::new(source, target)
        .and_then(|mut resize| resize.resize(image, &mut out))
        .expect("sizes and lengths fit");
    out
}

#[test]
fn fast_is_close_to_exact() {
    let scenes = golden_scenes();
    for (height, width) in [(64, 64), (96, 96), (128, 128), (224, 224), (48, 64), (32, 32), (256, 256)] {
        let geometry = Geometry::new(height, width);
        let (mut sum, mut worst) = (0.0_f64, 0.0_f64);
        for (index, golden) in scenes.iter().enumerate() {
            let frames = [Style::Exact, Style::Fast].map(|style| {
                let mut renderer = Renderer::new(style, geometry).expect("sizes are fine");
                let mut frame = vec![0; geometry.frame_len()];
                renderer.set_background(|p| golden.scene.draw_background(p));
                renderer.render(&mut frame, |p| golden.scene.draw_rest(p)).expect("the length fits");
                frame
            });
            let total: u64 = frames[0].iter().zip(&frames[1]).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
            let mean = total as f64 / frames[0].len() as f64;
            assert!(mean < 3.0, "scene {index} at {height} x {width}: mean difference {mean:.3} of 255");
            sum += mean;
            worst = worst.max(mean);
        }
        let mean = sum / scenes.len() as f64;
        println!("{height} x {width}: mean difference {mean:.3}, worst scene {worst:.3} (of 255)");
    }
}
