//! Many frames in one image.

use crate::clip::check_frame;
use crate::error::MediaError;

/// The color between and in place of frames.
const WHITE: [u8; 3] = [255; 3];
/// The color of the frame of a goal, and its width in pixels.
const GOAL_COLOR: [u8; 3] = [220, 120, 0];
const GOAL_FRAME: usize = 3;

/// A grid of frames on white: `rows` of frames `[H, W, 3]`, with `gap` pixels between them.
///
/// A row may be shorter than the others, and an empty slice leaves its cell blank. Returns the height, the width and
/// the pixels `[H', W', 3]` of the image, to hand to [`png::write`](crate::png::write).
///
/// # Errors
///
/// A frame of another size, or no cell at all.
pub fn contact_sheet(
    rows: &[Vec<&[u8]>],
    height: usize,
    width: usize,
    gap: usize,
) -> Result<(usize, usize, Vec<u8>), MediaError> {
    contact_sheet_on(WHITE, rows, height, width, gap)
}

/// [`contact_sheet`] on another color.
///
/// # Errors
///
/// As [`contact_sheet`].
pub fn contact_sheet_on(
    background: [u8; 3],
    rows: &[Vec<&[u8]>],
    height: usize,
    width: usize,
    gap: usize,
) -> Result<(usize, usize, Vec<u8>), MediaError> {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    if columns == 0 || height == 0 || width == 0 {
        return Err(MediaError::EmptySheet);
    }
    let sheet_height = rows.len() * (height + gap) - gap;
    let sheet_width = columns * (width + gap) - gap;
    let mut sheet = background.repeat(sheet_height * sheet_width);
    for (i, row) in rows.iter().enumerate() {
        for (j, frame) in row.iter().enumerate().filter(|(_, frame)| !frame.is_empty()) {
            check_frame(frame, height, width)?;
            let corner = i * (height + gap) * sheet_width + j * (width + gap);
            for (y, pixels) in frame.chunks_exact(width * 3).enumerate() {
                let start = (corner + y * sheet_width) * 3;
                sheet[start..start + width * 3].copy_from_slice(pixels);
            }
        }
    }
    Ok((sheet_height, sheet_width, sheet))
}

/// A goal image `[H, W, 3]` as sheets show it: in an orange frame.
pub fn framed(goal: &[u8], width: usize) -> Vec<u8> {
    let mut framed = goal.to_vec();
    let height = goal.len() / 3 / width;
    for (index, pixel) in framed.chunks_exact_mut(3).enumerate() {
        let (y, x) = (index / width, index % width);
        if x.min(width - 1 - x).min(y).min(height - 1 - y) < GOAL_FRAME {
            pixel.copy_from_slice(&GOAL_COLOR);
        }
    }
    framed
}
