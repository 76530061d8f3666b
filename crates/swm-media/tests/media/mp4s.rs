//! MP4 files: the boxes, read by a small in-house reader, and the images, read by OpenH264's decoder.

use std::ops::Range;

use openh264::decoder::Decoder;
use openh264::formats::YUVSource;
use swm_media::{Clip, Format};

use crate::scene;

/// A file and the parts of it that a player reads first.
struct Video {
    bytes: Vec<u8>,
}

impl Video {
    fn of(clip: &Clip) -> Self {
        Self { bytes: clip.encode(Format::Mp4).unwrap() }
    }

    fn number(&self, at: usize) -> usize {
        u32::from_be_bytes(self.bytes[at..at + 4].try_into().unwrap()) as usize
    }

    /// The boxes in a range, as name and payload. They must fill it.
    fn boxes(&self, range: Range<usize>) -> Vec<(String, Range<usize>)> {
        let (mut at, mut boxes) = (range.start, vec![]);
        while at < range.end {
            let end = at + self.number(at);
            assert!(end >= at + 8 && end <= range.end, "box at {at}");
            boxes.push((String::from_utf8_lossy(&self.bytes[at + 4..at + 8]).into_owned(), at + 8..end));
            at = end;
        }
        boxes
    }

    fn names(&self) -> Vec<String> {
        self.boxes(0..self.bytes.len()).into_iter().map(|(name, _)| name).collect()
    }

    /// The payload at the end of a path of box names.
    fn at(&self, path: &str) -> Range<usize> {
        path.split('/').fold(0..self.bytes.len(), |range, name| {
            let found: Vec<_> = self.boxes(range).into_iter().filter(|(n, _)| n == name).collect();
            assert_eq!(found.len(), 1, "{name} of {path}");
            found[0].1.clone()
        })
    }

    fn table(&self, name: &str) -> usize {
        self.at(&format!("moov/trak/mdia/minf/stbl/{name}")).start
    }

    /// Duration of each frame in seconds, from `stts`.
    fn durations(&self) -> Vec<f64> {
        let scale = self.number(self.at("moov/trak/mdia/mdhd").start + 12) as f64;
        let stts = self.table("stts");
        (0..self.number(stts + 4))
            .flat_map(|i| {
                let [count, ticks] = [8, 12].map(|field| self.number(stts + field + 8 * i));
                vec![ticks as f64 / scale; count]
            })
            .collect()
    }

    /// Frames that a player may start at, from 0.
    fn key_frames(&self) -> Vec<usize> {
        let stss = self.table("stss");
        (0..self.number(stss + 4)).map(|i| self.number(stss + 8 + 4 * i) - 1).collect()
    }

    /// Each frame as the encoder wrote it, with start codes, found by `stco` and `stsz` alone.
    fn samples(&self) -> Vec<Vec<u8>> {
        let [stsz, stco] = ["stsz", "stco"].map(|name| self.table(name));
        assert_eq!(self.number(stsz + 4), 0, "sizes differ");
        assert_eq!(self.number(stco + 4), 1, "one chunk");
        let mut at = self.number(stco + 8);
        let media = self.at("mdat");
        assert_eq!(at, media.start);
        let samples = (0..self.number(stsz + 8))
            .map(|i| {
                let end = at + self.number(stsz + 12 + 4 * i);
                let mut sample = vec![];
                while at < end {
                    let unit = at + 4..at + 4 + self.number(at);
                    at = unit.end;
                    sample.extend_from_slice(&[0, 0, 0, 1]);
                    sample.extend_from_slice(&self.bytes[unit]);
                }
                assert_eq!(at, end);
                sample
            })
            .collect();
        assert_eq!(at, media.end, "nothing but frames");
        samples
    }

    /// The images `[H, W, 3]` with their size.
    fn play(&self) -> Vec<(usize, usize, Vec<u8>)> {
        let mut decoder = Decoder::new().unwrap();
        self.samples()
            .iter()
            .map(|sample| {
                let image = decoder.decode(sample).unwrap().expect("an image for every sample");
                let (width, height) = image.dimensions();
                (height, width, rgb(&image))
            })
            .collect()
    }
}

/// BT.601 in studio range to RGB, by the standard's equations.
fn rgb(image: &impl YUVSource) -> Vec<u8> {
    let (width, height) = image.dimensions();
    let (luma_stride, chroma_stride, _) = image.strides();
    let mut pixels = Vec::with_capacity(height * width * 3);
    for y in 0..height {
        for x in 0..width {
            let luma = (f64::from(image.y()[y * luma_stride + x]) - 16.0) / 219.0;
            let at = y / 2 * chroma_stride + x / 2;
            let [blue, red] = [image.u()[at], image.v()[at]].map(|c| (f64::from(c) - 128.0) / 224.0);
            let r = luma + 1.402 * red;
            let b = luma + 1.772 * blue;
            let g = (luma - 0.299 * r - 0.114 * b) / 0.587;
            pixels.extend([r, g, b].map(|v| (v * 255.0).round().clamp(0.0, 255.0) as u8));
        }
    }
    pixels
}

#[test]
fn a_drawn_video_looks_like_the_original() {
    let clip = scene::drawn(224, 224, 15);
    let video = Video::of(&clip);
    let images = video.play();
    assert_eq!(images.len(), 15);
    let mut worst = f64::INFINITY;
    for ((height, width, image), original) in images.iter().zip(clip.frames()) {
        assert_eq!((*height, *width), (224, 224));
        worst = worst.min(scene::psnr(image, original));
    }
    println!("{} bytes, worst frame {worst:.1} dB", video.bytes.len());
    assert!(worst > 35.0, "{worst} dB");
}

#[test]
fn flat_colors_stay() {
    for color in [[255, 0, 0], [0, 255, 0], [0, 0, 255], [65, 105, 225], [255, 255, 255], [0, 0, 0]] {
        let mut clip = Clip::new(32, 32, 10.0);
        clip.push(&color.repeat(32 * 32)).unwrap();
        clip.push(&color.repeat(32 * 32)).unwrap();
        for (_, _, image) in Video::of(&clip).play() {
            let off = image.iter().zip(color.iter().cycle()).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(off <= Some(3), "{color:?} is off by {off:?}");
        }
    }
}

#[test]
fn the_boxes_are_those_of_a_video() {
    let mut clip = Clip::new(48, 64, 25.0);
    for frame in scene::drawn(48, 64, 25).frames() {
        clip.push(frame).unwrap();
    }
    let video = Video::of(&clip);
    assert_eq!(video.names(), ["ftyp", "moov", "mdat"], "the index comes first");
    assert_eq!(video.samples().len(), 25);
    assert_eq!(video.durations(), [0.04; 25]);
    assert_eq!(video.key_frames(), [0, 10, 20]);
    let header = video.at("moov/trak/tkhd");
    assert_eq!([8, 4].map(|back| video.number(header.end - back) >> 16), [64, 48], "width and height");
    let clock = video.at("moov/mvhd").start;
    assert_eq!([4, 8].map(|at| video.number(clock + at)), [0, 0], "no date");
}

#[test]
fn odd_sides_grow_by_a_copy_of_the_edge() {
    let clip = scene::gradient(33, 47, 2);
    for ((height, width, image), original) in Video::of(&clip).play().into_iter().zip(clip.frames()) {
        assert_eq!((height, width), (34, 48));
        let inside: Vec<u8> = image.chunks(48 * 3).take(33).flat_map(|row| &row[..47 * 3]).copied().collect();
        assert!(scene::psnr(&inside, original) > 35.0);
        let edge: Vec<u8> = image.chunks(48 * 3).flat_map(|row| &row[47 * 3..]).copied().collect();
        let beside: Vec<u8> = image.chunks(48 * 3).flat_map(|row| &row[46 * 3..47 * 3]).copied().collect();
        assert!(scene::psnr(&edge, &beside) > 35.0);
    }
}

#[test]
fn one_frame_lasts_its_time() {
    let clip = scene::drawn(224, 224, 1);
    let video = Video::of(&clip);
    let seconds: f64 = video.durations().iter().sum();
    assert!((seconds - 0.1).abs() < 1e-4, "{seconds} s");
    assert!(
        video.play().iter().all(|(_, _, image)| scene::psnr(image, clip.frames().next().unwrap()) > 35.0)
    );
}

#[test]
fn the_smallest_frames_work() {
    assert_eq!(Video::of(&scene::drawn(16, 16, 3)).play().len(), 3);
}
