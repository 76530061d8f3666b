//! PNG files and contact sheets.

use std::io::Cursor;

use proptest::prelude::*;
use swm_media::{Clip, Format, contact_sheet, png, sheet};

use crate::scene;

fn decode(bytes: &[u8]) -> (usize, usize, Vec<u8>) {
    let mut reader = ::png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!((info.color_type, info.bit_depth), (::png::ColorType::Rgb, ::png::BitDepth::Eight));
    (info.height as usize, info.width as usize, pixels)
}

proptest! {
    #[test]
    fn a_png_returns_its_pixels(
        (height, width, pixels) in (1..40_usize, 1..40_usize).prop_flat_map(|(height, width)| {
            (Just(height), Just(width), prop::collection::vec(any::<u8>(), height * width * 3))
        })
    ) {
        let bytes = png::encode(height, width, &pixels).unwrap();
        prop_assert_eq!(decode(&bytes), (height, width, pixels));
    }
}

#[test]
fn a_file_holds_what_encode_returns() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.png");
    let clip = scene::drawn(48, 64, 1);
    let frame = clip.frames().next().unwrap();
    png::write(&path, 48, 64, frame).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), png::encode(48, 64, frame).unwrap());
}

#[test]
fn a_clip_of_one_frame_is_that_frame() {
    let clip = scene::drawn(48, 64, 1);
    let (height, width, pixels) = decode(&clip.encode(Format::Png).unwrap());
    assert_eq!((height, width, &pixels[..]), (48, 64, clip.frames().next().unwrap()));
}

#[test]
fn a_clip_of_many_frames_is_a_row() {
    let clip = scene::drawn(24, 32, 3);
    let (height, width, pixels) = decode(&clip.encode(Format::Png).unwrap());
    assert_eq!((height, width), (24, 3 * 32 + 2 * 4));
    for (i, frame) in clip.frames().enumerate() {
        for y in 0..24 {
            let start = (y * width + i * 36) * 3;
            assert_eq!(pixels[start..start + 96], frame[y * 96..(y + 1) * 96], "frame {i}, row {y}");
        }
    }
    assert_eq!(pixels[32 * 3..36 * 3], [255; 12], "the gap is white");
}

/// Frames of 1 x 1 pixel make every pixel of the sheet readable as text.
#[test]
fn a_sheet_leaves_missing_cells_blank() {
    let [a, b, c] = [[1_u8; 3], [2; 3], [3; 3]];
    let rows = [vec![&a[..], &b, &c], vec![&b], vec![&[], &c]];
    let (height, width, pixels) = sheet::contact_sheet_on([9; 3], &rows, 1, 1, 1).unwrap();
    assert_eq!((height, width), (5, 5));
    let text: Vec<String> =
        pixels.chunks(15).map(|row| row.chunks(3).map(|p| p[0].to_string()).collect()).collect();
    assert_eq!(text, ["19293", "99999", "29999", "99999", "99399"]);

    let (_, _, on_white) = contact_sheet(&rows, 1, 1, 1).unwrap();
    assert_eq!(on_white, pixels.iter().map(|&p| if p == 9 { 255 } else { p }).collect::<Vec<_>>());
}

#[test]
fn flat_scenes_are_small() {
    let clip: Clip = scene::drawn(224, 224, 1);
    let size = clip.encode(Format::Png).unwrap().len();
    assert!(size < 224 * 224 * 3 / 20, "{size} bytes");
}
