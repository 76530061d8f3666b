//! Videos that play wherever images do.
//!
//! While all frames together have at most 256 colors, as drawn scenes do, the video is exact and has one palette.
//! Otherwise each frame gets a palette of its own: an exact one if it can, else the nearest 256 colors that
//! NeuQuant finds. A frame holds only the rectangle that differs from the frame before.

use std::borrow::Cow;
use std::collections::HashMap;

use gif::{DisposalMethod, Encoder, Frame, Repeat};

use crate::clip::{Clip, check_video};
use crate::error::MediaError;
use crate::format::Format;

/// The most colors of a palette.
const COLORS: usize = 256;

/// NeuQuant's speed: from 1, the best, to 30; 10 looks at every tenth pixel.
const QUANTIZER_SPEED: i32 = 10;

/// The least delay in hundredths of a second: viewers play shorter ones at a tenth of a second.
const MIN_DELAY: f64 = 2.0;

/// The bytes of a GIF file that loops for ever.
///
/// Delays are whole hundredths of a second, spread so that the video as a whole keeps its pace; above 50 frames per
/// second it plays at 50.
///
/// # Errors
///
/// An empty clip, a frame rate that is no rate, or frames beyond 65,535 pixels a side.
pub fn encode(clip: &Clip) -> Result<Vec<u8>, MediaError> {
    let refused = |error| MediaError::encode(Format::Gif, &error);
    let (size, sides) = ([clip.height(), clip.width()], [1, usize::from(u16::MAX)]);
    check_video(Format::Gif, size, clip.len(), clip.frames_per_second(), sides, "make smaller frames")?;
    let shared = Palette::of(clip);
    let colors = shared.as_ref().map_or(&[][..], |palette| &palette.colors);

    let whole = Rectangle { left: 0, top: 0, width: clip.width(), height: clip.height() };
    let mut encoder =
        Encoder::new(Vec::new(), whole.width as u16, whole.height as u16, colors).map_err(refused)?;
    encoder.set_repeat(Repeat::Infinite).map_err(refused)?;
    let mut before: Option<&[u8]> = None;
    for (i, pixels) in clip.frames().enumerate() {
        let area = before.map_or(whole, |before| Rectangle::changed(before, pixels, clip.width()));
        let cut = area.cut(pixels, clip.width());
        let mut frame = match &shared {
            Some(palette) => Frame { buffer: Cow::Owned(palette.indices(&cut)), ..Frame::default() },
            None => Frame::from_rgb_speed(area.width as u16, area.height as u16, &cut, QUANTIZER_SPEED),
        };
        frame.delay = delay(i, clip.frames_per_second());
        frame.dispose = DisposalMethod::Keep;
        frame.left = area.left as u16;
        frame.top = area.top as u16;
        frame.width = area.width as u16;
        frame.height = area.height as u16;
        encoder.write_frame(&frame).map_err(refused)?;
        before = Some(pixels);
    }
    encoder.into_inner().map_err(refused)
}

/// How long frame `i` stays, in hundredths of a second.
fn delay(i: usize, frames_per_second: f64) -> u16 {
    let period = (100.0 / frames_per_second).clamp(MIN_DELAY, f64::from(u16::MAX));
    // The difference of rounded times, not the rounded period: rounding must not add up.
    let shown_until = |frames: usize| (frames as f64 * period).round();
    (shown_until(i + 1) - shown_until(i)) as u16
}

/// The colors of a whole clip, in the order in which they appear.
struct Palette {
    /// `[N, 3]`
    colors: Vec<u8>,
    index: HashMap<[u8; 3], u8>,
}

impl Palette {
    /// `None` if there are too many colors.
    fn of(clip: &Clip) -> Option<Self> {
        let mut palette = Self { colors: Vec::new(), index: HashMap::new() };
        let mut last = None;
        for frame in clip.frames() {
            for color in frame.as_chunks::<3>().0 {
                // Drawn scenes are runs of one color; the map need not see the rest of a run.
                if last.replace(color) == Some(color) || palette.index.contains_key(color) {
                    continue;
                }
                if palette.index.len() == COLORS {
                    return None;
                }
                palette.index.insert(*color, palette.index.len() as u8);
                palette.colors.extend_from_slice(color);
            }
        }
        Some(palette)
    }

    /// The palette index of each pixel of `[N, 3]`, all of which are in the palette.
    fn indices(&self, pixels: &[u8]) -> Vec<u8> {
        let mut last = ([0; 3], self.index.get(&[0; 3]).copied().unwrap_or(0));
        let index = |color: &[u8; 3]| {
            if *color != last.0 {
                last = (*color, self.index[color]);
            }
            last.1
        };
        pixels.as_chunks::<3>().0.iter().map(index).collect()
    }
}

/// A part of a frame, in pixels.
#[derive(Clone, Copy)]
struct Rectangle {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Rectangle {
    /// The least one that holds all differences of two frames `[H, width, 3]`; one pixel if there is none, for a frame
    /// of the file cannot be empty.
    fn changed(before: &[u8], after: &[u8], width: usize) -> Self {
        let (mut top, mut bottom, mut left, mut right) = (None, 0, width, 0);
        for (y, (old, new)) in before.chunks_exact(width * 3).zip(after.chunks_exact(width * 3)).enumerate() {
            if old == new {
                continue;
            }
            top.get_or_insert(y);
            bottom = y + 1;
            let mut differs = old.chunks_exact(3).zip(new.chunks_exact(3)).map(|(a, b)| a != b);
            left = left.min(differs.clone().position(|d| d).unwrap_or(width));
            right = right.max(differs.rposition(|d| d).map_or(0, |x| x + 1));
        }
        match top {
            Some(top) => Self { left, top, width: right - left, height: bottom - top },
            None => Self { left: 0, top: 0, width: 1, height: 1 },
        }
    }

    /// Its pixels, out of a frame `[H, width, 3]`.
    fn cut(self, frame: &[u8], width: usize) -> Cow<'_, [u8]> {
        if self.width == width {
            return Cow::Borrowed(&frame[self.top * width * 3..(self.top + self.height) * width * 3]);
        }
        let rows = frame.chunks_exact(width * 3).skip(self.top).take(self.height);
        Cow::Owned(rows.flat_map(|row| &row[self.left * 3..(self.left + self.width) * 3]).copied().collect())
    }
}
