//! GIF files.

use swm_media::{Clip, Format};

use crate::scene;

struct Video {
    repeat: gif::Repeat,
    /// Frames with a palette of their own.
    palettes: usize,
    /// The images on the screen, `[H, W, 3]`.
    frames: Vec<Vec<u8>>,
    delays: Vec<u16>,
    /// Pixels stored for each frame.
    stored: Vec<usize>,
}

/// Plays the file as a viewer does: each stored rectangle over what stood there before.
fn play(bytes: &[u8]) -> Video {
    let mut decoder = gif::DecodeOptions::new().read_info(bytes).unwrap();
    let width = usize::from(decoder.width());
    let mut screen = vec![0; usize::from(decoder.height()) * width * 3];
    let shared = decoder.global_palette().map(<[u8]>::to_vec);
    let (mut frames, mut delays, mut stored, mut palettes) = (vec![], vec![], vec![], 0);
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        let palette = frame.palette.as_ref().or(shared.as_ref()).expect("a palette");
        palettes += usize::from(frame.palette.is_some());
        assert_eq!(frame.transparent, None);
        for (i, &index) in frame.buffer.iter().enumerate() {
            let columns = usize::from(frame.width);
            let [y, x] = [usize::from(frame.top) + i / columns, usize::from(frame.left) + i % columns];
            let color = &palette[usize::from(index) * 3..][..3];
            screen[(y * width + x) * 3..][..3].copy_from_slice(color);
        }
        frames.push(screen.clone());
        delays.push(frame.delay);
        stored.push(frame.buffer.len());
    }
    Video { repeat: decoder.repeat(), palettes, frames, delays, stored }
}

fn encode(clip: &Clip) -> Video {
    play(&clip.encode(Format::Gif).unwrap())
}

#[test]
fn a_drawn_video_is_exact() {
    let clip = scene::drawn(48, 65, 12);
    let video = encode(&clip);
    assert_eq!(video.palettes, 0);
    assert_eq!(video.repeat, gif::Repeat::Infinite);
    assert!(video.frames.iter().map(|f| &f[..]).eq(clip.frames()));
    assert_eq!(video.delays, [10; 12]);
    assert!(video.stored[1..].iter().all(|&pixels| pixels < 48 * 65 / 2), "{:?}", video.stored);
}

/// 256 colors in each of two frames, none in common: two exact palettes.
#[test]
fn each_frame_may_have_256_colors_of_its_own() {
    let mut clip = Clip::new(16, 16, 5.0);
    for blue in [0, 200] {
        let frame: Vec<u8> = (0..=255).flat_map(|i| [i, 255 - i, blue]).collect();
        clip.push(&frame).unwrap();
    }
    let video = encode(&clip);
    assert_eq!(video.palettes, 2);
    assert!(video.frames.iter().map(|f| &f[..]).eq(clip.frames()));
}

#[test]
fn exactly_256_colors_share_a_palette() {
    let mut clip = Clip::new(16, 16, 5.0);
    let frame: Vec<u8> = (0..=255).flat_map(|i| [i, 255 - i, 7]).collect();
    clip.push(&frame).unwrap();
    let turned: Vec<u8> = frame.chunks(3).rev().flatten().copied().collect();
    clip.push(&turned).unwrap();
    let video = encode(&clip);
    assert_eq!(video.palettes, 0);
    assert!(video.frames.iter().map(|f| &f[..]).eq(clip.frames()));
}

#[test]
fn many_colors_are_matched_closely() {
    let clip = scene::gradient(64, 64, 3);
    let video = encode(&clip);
    assert_eq!(video.frames.len(), 3);
    for (frame, original) in video.frames.iter().zip(clip.frames()) {
        let psnr = scene::psnr(frame, original);
        assert!(psnr > 25.0, "{psnr} dB");
    }
}

#[test]
fn a_frame_that_repeats_costs_one_pixel() {
    let mut clip = scene::drawn(32, 32, 1);
    let frame = clip.frames().next().unwrap().to_vec();
    clip.push(&frame).unwrap();
    let video = encode(&clip);
    assert_eq!(video.stored, [32 * 32, 1]);
    assert_eq!(video.frames, [frame.clone(), frame]);
}

#[test]
fn delays_keep_the_pace() {
    let total = |frames_per_second: f64, frames: usize| -> u32 {
        let mut clip = Clip::new(1, 1, frames_per_second);
        for i in 0..frames {
            clip.push(&[i as u8; 3]).unwrap();
        }
        encode(&clip).delays.iter().map(|&d| u32::from(d)).sum()
    };
    assert_eq!(total(30.0, 90), 300);
    assert_eq!(total(7.0, 70), 1000);
    assert_eq!(total(1000.0, 10), 20, "viewers slow down delays below two hundredths");
    assert_eq!(total(1e-9, 1), 65_535, "the longest delay of the format");
}
