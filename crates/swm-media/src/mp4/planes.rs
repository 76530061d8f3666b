//! RGB frames as the luma and chroma planes that a video encoder reads.
//!
//! ITU-R BT.601, 8 bits, studio range (luma 16 to 235, chroma 16 to 240), chroma at half resolution as the mean of
//! 2 x 2 pixels, in 16.16 fixed point: the same bytes on every machine.

use openh264::formats::YUVSlices;

use crate::planar::split_colors;

/// The weights of red and blue in luma; green has the rest.
const RED: f64 = 0.299;
const BLUE: f64 = 0.114;

/// Bits behind the point.
const BITS: u32 = 16;
const ONE: f64 = (1 << BITS) as f64;

/// Luma from red, green and blue. The three sum to the full range, so that white is exactly 235.
const LUMA: [i32; 3] = {
    let full = (219.0 / 255.0 * ONE + 0.5) as i32;
    let (red, blue) = (scaled(219.0 * RED), scaled(219.0 * BLUE));
    [red, full - red - blue, blue]
};

/// The two chroma planes from red, green and blue. Each sums to 0, so that gray is exactly 128.
const CHROMA: [[i32; 3]; 2] = {
    let half = scaled(112.0);
    let blue_red = -scaled(112.0 * RED / (1.0 - BLUE));
    let red_blue = -scaled(112.0 * BLUE / (1.0 - RED));
    [[blue_red, -half - blue_red, half], [half, -half - red_blue, red_blue]]
};

const fn scaled(per_unit: f64) -> i32 {
    (per_unit / 255.0 * ONE + 0.5) as i32
}

/// The planes of one frame, reused for all frames of a video.
pub(super) struct Planes {
    frame_height: usize,
    frame_width: usize,
    height: usize,
    width: usize,
    /// `[H, W]`, then twice `[H / 2, W / 2]`.
    luma: Vec<u8>,
    chroma: [Vec<u8>; 2],
    /// The colors of two rows, `[W]` each: side by side, they are many to an instruction.
    rows: [[Vec<u8>; 3]; 2],
    /// Of each color, the sums of 2 x 2 pixels, `[W / 2]`.
    sums: [Vec<u16>; 3],
}

impl Planes {
    /// Planes for frames of the given size; odd sides grow by one.
    pub(super) fn new(frame_height: usize, frame_width: usize) -> Self {
        let [height, width] = [frame_height, frame_width].map(|side| side.next_multiple_of(2));
        let quarter = vec![0; height * width / 4];
        Self {
            frame_height,
            frame_width,
            height,
            width,
            luma: vec![0; height * width],
            chroma: [quarter.clone(), quarter],
            rows: [(); 2].map(|()| [(); 3].map(|()| vec![0; width])),
            sums: [(); 3].map(|()| vec![0; width / 2]),
        }
    }

    /// Takes the frame `[H, W, 3]`; a row or column that it lacks copies its last one.
    pub(super) fn fill(&mut self, frame: &[u8]) {
        let (last, width) = (self.frame_height - 1, self.frame_width);
        let half = self.width / 2;
        let [first, second] = &mut self.chroma;
        let chroma = first.chunks_exact_mut(half).zip(second.chunks_exact_mut(half));
        for (pair, (luma, (first, second))) in
            self.luma.chunks_exact_mut(2 * self.width).zip(chroma).enumerate()
        {
            let rows = luma.chunks_exact_mut(self.width).zip(&mut self.rows).enumerate();
            for (y, (luma, [red, green, blue])) in rows {
                let row = &frame[(2 * pair + y).min(last) * 3 * width..][..3 * width];
                split_colors(row, [&mut red[..width], &mut green[..width], &mut blue[..width]]);
                // A column that the frame lacks.
                for color in [&mut *red, &mut *green, &mut *blue] {
                    color[self.width - 1] = color[width - 1];
                }
                luma_of([red, green, blue], luma);
            }
            let [above, below] = &self.rows;
            let sums = &mut self.sums;
            for ((sums, above), below) in sums.iter_mut().zip(above).zip(below) {
                let pairs = above.as_chunks::<2>().0.iter().zip(below.as_chunks::<2>().0);
                for (sum, (&[a, b], &[c, d])) in sums.iter_mut().zip(pairs) {
                    *sum = u16::from(a) + u16::from(b) + u16::from(c) + u16::from(d);
                }
            }
            chroma_of(&self.sums, CHROMA[0], first);
            chroma_of(&self.sums, CHROMA[1], second);
        }
    }

    /// What the encoder reads.
    pub(super) fn source(&self) -> YUVSlices<'_> {
        let half = self.width / 2;
        let planes = (&self.luma[..], &self.chroma[0][..], &self.chroma[1][..]);
        YUVSlices::new(planes, (self.width, self.height), (self.width, half, half))
    }
}

/// Luma of a row.
fn luma_of([red, green, blue]: [&[u8]; 3], out: &mut [u8]) {
    for (((out, &red), &green), &blue) in out.iter_mut().zip(red).zip(green).zip(blue) {
        *out = fixed(dot(LUMA, [i32::from(red), i32::from(green), i32::from(blue)]), BITS, 16);
    }
}

/// A row of a chroma plane from the sums of four pixels each.
fn chroma_of([red, green, blue]: &[Vec<u16>; 3], weights: [i32; 3], out: &mut [u8]) {
    for (((out, &red), &green), &blue) in out.iter_mut().zip(red).zip(green).zip(blue) {
        // Two more bits: the sum of four pixels.
        *out = fixed(dot(weights, [i32::from(red), i32::from(green), i32::from(blue)]), BITS + 2, 128);
    }
}

fn dot(a: [i32; 3], b: [i32; 3]) -> i32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `offset` plus the fixed-point `value` rounded to a whole number.
fn fixed(value: i32, bits: u32, offset: i32) -> u8 {
    // In 16..=240 by the weights above.
    (((value + (1 << (bits - 1))) >> bits) + offset) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planes_of(height: usize, width: usize, frame: &[u8]) -> Planes {
        let mut planes = Planes::new(height, width);
        planes.fill(frame);
        planes
    }

    /// Values of the color bars of ITU-R BT.601 at full amplitude, from the standard's equations by hand.
    #[test]
    fn known_colors() {
        let cases = [
            ([0, 0, 0], [16, 128, 128]),
            ([255, 255, 255], [235, 128, 128]),
            ([255, 0, 0], [81, 90, 240]),
            ([0, 255, 0], [145, 54, 34]),
            ([0, 0, 255], [41, 240, 110]),
            ([255, 255, 0], [210, 16, 146]),
        ];
        for (rgb, [y, u, v]) in cases {
            let planes = planes_of(2, 2, &rgb.repeat(4));
            assert_eq!((&planes.luma, &planes.chroma), (&vec![y; 4], &[vec![u], vec![v]]), "{rgb:?}");
        }
    }

    #[test]
    fn every_gray_is_without_color() {
        for level in 0..=255 {
            let planes = planes_of(2, 2, &[level; 12]);
            assert_eq!(planes.chroma, [vec![128], vec![128]]);
            let exact = 16.0 + 219.0 * f64::from(level) / 255.0;
            assert!((f64::from(planes.luma[0]) - exact).abs() <= 0.501, "{level}");
        }
    }

    #[test]
    fn odd_sides_repeat_the_last_row_and_column() {
        let gray: Vec<u8> = (0..9).map(|i| i * 20).collect();
        let rgb: Vec<u8> = gray.iter().flat_map(|&g| [g; 3]).collect();
        let planes = planes_of(3, 3, &rgb);
        assert_eq!((planes.height, planes.width), (4, 4));
        let row = |y: usize| &planes.luma[y * 4..(y + 1) * 4];
        assert_eq!(row(3), row(2));
        for y in 0..4 {
            assert_eq!(row(y)[3], row(y)[2]);
        }
        assert_ne!(row(0), row(1));
    }
}
