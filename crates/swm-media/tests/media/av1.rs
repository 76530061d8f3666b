//! Videos in AV1: `square_av1.mp4` was encoded by SVT-AV1 4.1 through PyAV (CRF 20, a key frame every 8th frame, BT.709):
//! a red square that moves two pixels a frame before a gradient.

use std::io::Cursor;

use swm_media::mp4::Mp4Reader;

const VIDEO: &[u8] = include_bytes!("../golden/square_av1.mp4");
const FRAMES: usize = 20;
const HEIGHT: usize = 48;
const WIDTH: usize = 64;
const FRAME: usize = HEIGHT * WIDTH * 3;

/// What was encoded.
fn original(frame: usize) -> Vec<u8> {
    let mut pixels = Vec::with_capacity(FRAME);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let in_square = (10..26).contains(&y) && (2 * frame..2 * frame + 16).contains(&x);
            pixels.extend(if in_square { [220, 40, 40] } else { [3 * x as u8, 4 * y as u8, 60] });
        }
    }
    pixels
}

#[test]
fn any_frame_can_be_read_in_any_order() {
    let mut reader = Mp4Reader::new(Cursor::new(VIDEO)).unwrap();
    assert_eq!((reader.frames(), reader.size()), (FRAMES, (HEIGHT, WIDTH)));
    let mut all = vec![0; FRAMES * FRAME];
    reader.read(0, 1, &mut all).unwrap();
    for (at, found) in all.chunks_exact(FRAME).enumerate() {
        let squares: f64 =
            found.iter().zip(original(at)).map(|(&a, b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
        // libdav1d and PyAV's colors are 4.2 away from the original at most.
        let error = (squares / FRAME as f64).sqrt();
        assert!(error < 4.5, "frame {at}: {error}");
    }
    for (first, count, stride) in [(19, 1, 1), (3, 4, 1), (7, 4, 1), (0, 1, 1), (2, 5, 3)] {
        let mut some = vec![0; count * FRAME];
        reader.read(first, stride, &mut some).unwrap();
        for (at, found) in some.chunks_exact(FRAME).enumerate() {
            assert!(
                found == &all[(first + at * stride) * FRAME..][..FRAME],
                "{first} {count} {stride}: {at}"
            );
        }
    }
    assert!(reader.read(19, 1, &mut vec![0; 2 * FRAME]).is_err());
}

#[test]
fn damaged_videos_are_errors_or_other_images() {
    let mut errors = 0;
    for number in 0..150usize {
        let mut bytes = VIDEO.to_vec();
        let at = number * 7919 % bytes.len();
        match number % 3 {
            0 => bytes[at] ^= 1 << (number % 8),
            1 => bytes.truncate(at),
            _ => bytes[at..].iter_mut().take(4).for_each(|byte| *byte = 0xff),
        }
        let read = Mp4Reader::new(Cursor::new(bytes)).and_then(|mut reader| {
            let (height, width) = reader.size();
            let mut out = vec![0; height.min(4096) * width.min(4096) * 3];
            // In order: each frame is decoded once.
            (0..reader.frames().min(FRAMES)).try_for_each(|frame| reader.read(frame, 1, &mut out))
        });
        errors += usize::from(read.is_err());
    }
    assert!(errors > 50, "{errors}");
}
