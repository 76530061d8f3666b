//! Clips of a dot on black, which tests learn from.

use crate::{ClipBatch, Images, Vectors};

pub(super) const SIDE: usize = 16;
pub(super) const BYTES: usize = SIDE * SIDE * 3;
pub(super) const CLIPS: usize = 32;

/// A dot of 3 × 3 pixels on black.
pub(super) fn image(at: [i32; 2]) -> Vec<u8> {
    let is_dot = |pixel: usize| {
        let place = [pixel % SIDE, pixel / SIDE];
        place.iter().zip(at).all(|(&place, at)| (place as i32 - at).abs() <= 1)
    };
    (0..SIDE * SIDE).flat_map(|pixel| [if is_dot(pixel) { 255 } else { 0 }; 3]).collect()
}

/// `[CLIPS, steps]` images.
pub(super) fn images(values: &[u8], steps: usize) -> Images<'_> {
    Images { values, rows: CLIPS, steps, height: SIDE, width: SIDE, channels_last: true }
}

/// Clips of so many steps, with `[CLIPS, steps, 2]` actions.
pub(super) fn clips<'a>(pixels: &'a [u8], actions: &'a [f32], steps: usize) -> ClipBatch<'a> {
    ClipBatch {
        pixels: images(pixels, steps),
        latents: None,
        canonical: None,
        action: Vectors { values: actions, rows: CLIPS, steps, dim: 2 },
        proprio: None,
        goal_pixels: None,
        goal_proprio: None,
    }
}

/// The images of one step of all clips.
pub(super) fn of_step(values: &[u8], steps: usize, step: usize) -> Vec<u8> {
    let clips = values.chunks(steps * BYTES);
    clips.flat_map(|clip| &clip[step * BYTES..][..BYTES]).copied().collect()
}
