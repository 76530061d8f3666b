//! Images and videos read back.

use std::io::Cursor;

use swm_media::mp4::{Mp4Options, Mp4Reader, encode_frames};
use swm_media::{Clip, MediaError, jpeg, png};

use crate::scene::{drawn, gradient, psnr};

fn video(clip: &Clip, options: &Mp4Options) -> Vec<u8> {
    encode_frames(clip.frames(), clip.height(), clip.width(), options).unwrap()
}

#[test]
fn any_frame_of_a_video_can_be_read_in_any_order() {
    let clip = drawn(48, 64, 35);
    let mut reader = Mp4Reader::new(Cursor::new(video(&clip, &Mp4Options::default()))).unwrap();
    assert_eq!((reader.frames(), reader.size()), (35, (48, 64)));
    assert!((reader.frames_per_second() - 25.0).abs() < 0.5, "{}", reader.frames_per_second());
    let frame = 48 * 64 * 3;
    let mut all = vec![0; 35 * frame];
    reader.read(0, 1, &mut all).unwrap();
    for (at, original) in clip.frames().enumerate() {
        let quality = psnr(original, &all[at * frame..][..frame]);
        assert!(quality > 30.0, "frame {at}: {quality} dB");
    }
    for (first, count, stride) in
        [(34, 1, 1), (3, 4, 1), (7, 4, 1), (9, 2, 25), (0, 1, 1), (20, 5, 3), (21, 2, 1)]
    {
        let mut some = vec![0; count * frame];
        reader.read(first, stride, &mut some).unwrap();
        for (at, found) in some.chunks_exact(frame).enumerate() {
            assert!(
                found == &all[(first + at * stride) * frame..][..frame],
                "{first} {count} {stride}: {at}"
            );
        }
    }
    let message = reader.read(34, 1, &mut vec![0; 2 * frame]).unwrap_err().to_string();
    assert!(message.contains("35 frames"), "{message}");
    reader.read(34, 1, &mut vec![0; frame]).unwrap();
}

#[test]
fn quality_and_key_frames_are_as_asked() {
    let clip = gradient(64, 64, 20);
    let sized = |quantizer, key_frame_period| {
        video(&clip, &Mp4Options { quantizer, key_frame_period, ..Mp4Options::default() })
    };
    let quality = |bytes: Vec<u8>| {
        let mut out = vec![0; 20 * 64 * 64 * 3];
        Mp4Reader::new(Cursor::new(bytes)).unwrap().read(0, 1, &mut out).unwrap();
        psnr(&clip.frames().flatten().copied().collect::<Vec<_>>(), &out)
    };
    let [fine, coarse] = [sized(10, 10), sized(40, 10)];
    assert!(fine.len() > 2 * coarse.len(), "{} and {} bytes", fine.len(), coarse.len());
    assert!(sized(18, 1).len() > sized(18, 20).len());
    let [fine, coarse] = [quality(fine), quality(coarse)];
    assert!(fine > coarse + 5.0, "{fine} and {coarse} dB");
}

/// Written by x264 in the High profile with B-frames. The sums were taken by PyAV's decoder.
#[test]
fn a_video_of_the_reference() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/golden/datasets/pusht_up_64_video/pixels/ep_0.mp4");
    let mut reader = Mp4Reader::new(std::fs::File::open(path).unwrap()).unwrap();
    assert_eq!((reader.frames(), reader.size()), (21, (64, 64)));
    let mut all = vec![0; 21 * 64 * 64 * 3];
    reader.read(0, 1, &mut all).unwrap();
    for first in (0..21).rev() {
        let mut one = vec![0; 64 * 64 * 3];
        reader.read(first, 1, &mut one).unwrap();
        assert!(one == all[first * one.len()..][..one.len()], "frame {first}");
    }
}

#[test]
fn cut_and_flipped_videos_are_errors_or_other_images() {
    let clip = drawn(32, 32, 12);
    let bytes = video(&clip, &Mp4Options::default());
    let mut out = vec![0; 12 * 32 * 32 * 3];
    let mut play = |bytes: Vec<u8>| -> Result<(), MediaError> {
        let mut reader = Mp4Reader::new(Cursor::new(bytes))?;
        let frames = reader.frames().min(12);
        if reader.size() == (32, 32) { reader.read(0, 1, &mut out[..frames * 32 * 32 * 3]) } else { Ok(()) }
    };
    for length in 0..bytes.len() {
        assert!(play(bytes[..length].to_vec()).is_err(), "{length} of {} bytes", bytes.len());
    }
    let mut errors = 0;
    for at in 0..bytes.len() {
        let mut bytes = bytes.clone();
        bytes[at] ^= 0x81;
        errors += usize::from(play(bytes).is_err());
    }
    assert!(errors > 100, "{errors} flips of {} were noticed", bytes.len());
}

#[test]
fn jpegs_look_like_the_original_and_gray_stays_gray() {
    let clip = gradient(40, 56, 1);
    let rgb = clip.frames().next().unwrap();
    let bytes = jpeg::encode(40, 56, 3, rgb, 95).unwrap();
    assert!(bytes.len() > jpeg::encode(40, 56, 3, rgb, 30).unwrap().len());
    assert_eq!(jpeg::shape(&bytes).unwrap(), [40, 56, 3]);
    let mut out = vec![0; rgb.len()];
    jpeg::decode_into(&bytes, [40, 56, 3], &mut out).unwrap();
    assert!(psnr(rgb, &out) > 38.0, "{}", psnr(rgb, &out));
    let gray: Vec<u8> = rgb.iter().step_by(3).copied().collect();
    let bytes = jpeg::encode(40, 56, 1, &gray, 95).unwrap();
    assert_eq!(jpeg::shape(&bytes).unwrap(), [40, 56, 1]);
    let mut out = vec![0; gray.len()];
    jpeg::decode_into(&bytes, [40, 56, 1], &mut out).unwrap();
    assert!(psnr(&gray, &out) > 38.0);
    assert!(jpeg::decode_into(&bytes, [40, 55, 1], &mut out).unwrap_err().to_string().contains("40 x 56"));
    for length in 0..bytes.len() - 4 {
        assert!(
            jpeg::decode_into(&bytes[..length], [40, 56, 1], &mut out).is_err() || length > 300,
            "{length}"
        );
    }
}

#[test]
fn a_png_comes_back_exactly() {
    let clip = gradient(9, 7, 1);
    let rgb = clip.frames().next().unwrap();
    let bytes = png::encode(9, 7, rgb).unwrap();
    let mut out = vec![0; rgb.len()];
    png::decode_into(&bytes, [9, 7, 3], &mut out).unwrap();
    assert_eq!(out, rgb);
    assert!(png::decode_into(&bytes, [7, 9, 3], &mut out).unwrap_err().to_string().contains("[9, 7, 3]"));
    for length in 0..bytes.len() - 12 {
        assert!(png::decode_into(&bytes[..length], [9, 7, 3], &mut out).is_err(), "{length}");
    }
}
