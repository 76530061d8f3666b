//! The arrow of the exact raster: its image, shrunk as `pygame.transform.smoothscale` does, and blended.

use super::raster::{Raster, Scratch};
use super::smooth::blend;
use crate::painter::Rgb;
use crate::turn_arrow::{SIZE, coverage};

impl Raster<'_> {
    /// The arrow in a square of `side` pixels about a center, in a canvas with y up; mirrored if the side is negative.
    pub(super) fn turn_arrow(&mut self, [cx, cy]: [i32; 2], side: i32, color: Rgb) {
        let size = side.unsigned_abs() as usize;
        if size == 0 || size > SIZE[0] {
            return;
        }
        let arrow = shrunk(self.scratch(), size);
        let corner = [cx - size as i32 / 2, cy - size as i32 / 2];
        for (index, &alpha) in arrow.iter().enumerate() {
            let (column, row) = (index % size, index / size);
            let column = if side < 0 { size - 1 - column } else { column };
            let [x, y] = [corner[0] + column as i32, corner[1] + (size - 1 - row) as i32];
            if alpha > 0
                && let Some(pixel) = self.pixel(x, y)
            {
                *pixel = blend(*pixel, color, u32::from(alpha));
            }
        }
        self.scratch().arrow = arrow;
    }
}

/// The arrow's coverage, `[size, size]`, in the scratch's memory: rows first, then columns.
fn shrunk(scratch: &mut Scratch, size: usize) -> Vec<u8> {
    let [height, width] = SIZE;
    let mut arrow = std::mem::take(&mut scratch.arrow);
    arrow.clear();
    // Later arrows may be larger: memory for the largest, once.
    arrow.reserve(2 * height * height);
    arrow.resize(size * size + height * size, 0);
    let (result, rows) = arrow.split_at_mut(size * size);
    for (source, row) in coverage().chunks_exact(width).zip(rows.chunks_exact_mut(size)) {
        average(source.iter().copied(), width, size, |i, value| row[i] = value);
    }
    for column in 0..size {
        let source = rows.iter().skip(column).step_by(size).copied();
        average(source, height, size, |i, value| result[i * size + column] = value);
    }
    arrow.truncate(size * size);
    arrow
}

/// Averages of `count` values over `size` equal intervals, in 16.16 fixed point.
fn average(source: impl Iterator<Item = u8>, count: usize, size: usize, mut write: impl FnMut(usize, u8)) {
    const ONE: u64 = 1 << 16;
    let step = ONE * count as u64 / size as u64;
    let per_step = (1 << 32) / step;
    let (mut left, mut sum, mut index) = (step, 0, 0);
    for value in source.map(u64::from) {
        if left > ONE {
            sum += value;
            left -= ONE;
        } else {
            if index < size {
                write(index, (((sum + ((value * left) >> 16)) * per_step) >> 16) as u8);
            }
            index += 1;
            sum = (value * (ONE - left)) >> 16;
            left = step - (ONE - left);
        }
    }
}
