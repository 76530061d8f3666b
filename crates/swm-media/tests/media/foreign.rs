//! Videos of other programs, by codec, profile, structure of groups, container and size, against what PyAV decodes of them:
//! `tests/golden/videos/make.py` made both. The same frames come in any order.

use std::fs;
use std::io::Cursor;
use std::path::PathBuf;

use serde_json::Value as Json;
use swm_media::MediaError;
use swm_media::mp4::Mp4Reader;

type Reader = Mp4Reader<Cursor<Vec<u8>>>;

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/videos")
}

fn open(name: &str) -> Result<Reader, MediaError> {
    Mp4Reader::new(Cursor::new(fs::read(folder().join(format!("{name}.mp4"))).unwrap()))
}

fn expected(kind: &str) -> Vec<(String, Json)> {
    let text = fs::read(folder().join("expected.json")).unwrap();
    let expected: Json = serde_json::from_slice(&text).unwrap();
    let all = expected[kind].as_object().unwrap().clone().into_iter();
    all.filter(|(name, _)| cfg!(feature = "av1") || !name.contains("av1")).collect()
}

/// CRC-32 (IEEE 802.3), as of zlib.
fn crc(bytes: &[u8]) -> u64 {
    let step = |crc: u32, &byte: &u8| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| crc >> 1 ^ (0xedb8_8320 & (crc & 1).wrapping_neg()))
    };
    u64::from(!bytes.iter().fold(!0, step))
}

/// The checksums of frames, read in one call.
fn read(reader: &mut Reader, frames: &[usize]) -> Vec<u64> {
    let (height, width) = reader.size();
    let mut out = vec![0; frames.len() * height * width * 3];
    reader.read_each(&|at| frames[at], &mut out).unwrap();
    out.chunks_exact(height * width * 3).map(crc).collect()
}

#[test]
fn frames_are_those_that_are_shown_in_any_order() {
    let mut all = 0;
    for (name, expected) in expected("videos") {
        let mut reader = open(&name).unwrap_or_else(|error| panic!("{name}: {error}"));
        let size = [reader.size().0, reader.size().1];
        assert_eq!(serde_json::json!(size), expected["size"], "{name}");
        let shown = expected["frames"].as_array().unwrap();
        let count = shown.len();
        assert_eq!(reader.frames(), count, "{name}");
        let sums: Vec<u64> = shown.iter().map(|frame| frame[1].as_u64().unwrap()).collect();
        for (frame, shown) in shown.iter().enumerate() {
            let (time, expected) = (reader.time(frame).unwrap(), shown[0].as_f64().unwrap());
            assert!((time - expected).abs() < 1e-5, "{name}, frame {frame}: {time} s, not {expected} s");
            assert_eq!(reader.nearest(expected + 0.03), Some(frame), "{name}");
        }
        let in_order: Vec<usize> = (0..count).collect();
        assert_eq!(read(&mut reader, &in_order), sums, "{name}");
        // One at a time: backward, by steps that jump over groups, and at random; the first ones by a reader that has read nothing.
        let orders: [Vec<usize>; 3] = [
            (0..count).rev().collect(),
            (0..count).map(|at| at * 7 % count).collect(),
            (0..count as u64).map(|at| ((at * 2_654_435_761) >> 7) as usize % count).collect(),
        ];
        for order in orders {
            let mut reader = open(&name).unwrap();
            for frame in order {
                assert_eq!(read(&mut reader, &[frame]), [sums[frame]], "{name}, frame {frame}");
            }
        }
        // Several in one call: forward and back, one twice.
        let some = [count - 1, 0, count / 2, count / 2, count / 2 + 1, 1, count - 1];
        assert_eq!(read(&mut reader, &some), some.map(|frame| sums[frame]), "{name}");
        assert!(reader.read(count - 1, 1, &mut vec![0; 2 * size[0] * size[1] * 3]).is_err(), "{name}");
        all += 1;
    }
    assert!(all >= 20, "{all} videos");
}

#[test]
fn what_is_valid_and_not_decoded_is_told_by_name() {
    for (name, expected) in expected("unsupported") {
        let reason = expected["reason"].as_str().unwrap();
        match open(&name) {
            Err(error @ MediaError::Unsupported { .. }) => {
                let message = error.to_string();
                assert!(message.contains(reason) && message.contains("ffmpeg -i"), "{name}: {message}");
            }
            Err(error) => panic!("{name}: {error}"),
            Ok(_) => panic!("{name} is decoded"),
        }
    }
}

/// As an encoder rounds odd sides up: what comes back is as large as the stored images.
#[test]
fn odd_sides_are_stored_as_even_ones() {
    let mut clip = swm_media::Clip::new(65, 63, 10.0);
    (0..3).for_each(|_| clip.push(&[90; 65 * 63 * 3]).unwrap());
    let reader = Mp4Reader::new(Cursor::new(clip.encode(swm_media::Format::Mp4).unwrap())).unwrap();
    assert_eq!((reader.size(), reader.frames()), ((66, 64), 3));
}

#[test]
fn damaged_foreign_videos_are_errors_or_other_images() {
    for name in ["h264_fragments", "h264_cut", "h264_open_gop"] {
        let bytes = fs::read(folder().join(format!("{name}.mp4"))).unwrap();
        let mut errors = 0;
        for number in 0..300usize {
            let mut bytes = bytes.clone();
            let at = number * 7919 % bytes.len();
            match number % 4 {
                0 => bytes[at] ^= 1 << (number % 8),
                1 => bytes.truncate(at),
                2 => bytes[at..].iter_mut().take(4).for_each(|byte| *byte = 0xff),
                _ => bytes[at..].iter_mut().take(4).for_each(|byte| *byte = 0),
            }
            let read = Mp4Reader::new(Cursor::new(bytes)).and_then(|mut reader| {
                let (height, width) = reader.size();
                let mut out = vec![0; height.min(4096) * width.min(4096) * 3];
                (0..reader.frames().min(36)).try_for_each(|frame| reader.read(frame, 1, &mut out))
            });
            errors += usize::from(read.is_err());
        }
        assert!(errors > 75, "{name}: {errors}");
    }
}
