//! RGB frames as the luma and chroma planes that a video encoder reads.
//!
//! ITU-R BT.709, 8 bits, studio range (luma 16 to 235, chroma 16 to 240), chroma at half resolution as the mean of
//! 2 x 2 pixels, in 16.16 fixed point: the same bytes on every machine.

use openh264::formats::YUVSlices;

/// The weights of red and blue in luma; green has the rest.
const RED: f64 = 0.2126;
const BLUE: f64 = 0.0722;

/// Bits behind the point.
const BITS: u32 = 16;
const ONE: f64 = (1 << BITS) as f64;

/// Luma from red, green and blue. The three sum to the full range, so that white is exactly 235.
const LUMA: [i32; 3] = {
    let full = (219.0 / 255.0 * ONE + 0.5) as i32;
    let (red, blue) = (scaled(219.0 * RED), scaled(219.0 * BLUE));
    [red, full - red - blue, blue]
};

/// The two chroma planes from red, green and blue. Each sums to 0, so that grey is exactly 128.
const CHROMA: [[i32; 3]; 2] = {
    let half = scaled(112.0);
    let blue_red = -scaled(112.0 * RED / (1.0 - BLUE));
    let red_blue = -scaled(112.0 * BLUE / (1.0 - RED));
    [[blue_red, -half - blue_red, half], [half, -half - red_blue, red_blue]]
};

const fn scaled(per_unit: f64) -> i32 {
    (per_unit / 255.0 * ONE + 0.5) as i32
}

/// The planes of one frame, reused for all frames of a film.
pub(super) struct Planes {
    frame_height: usize,
    frame_width: usize,
    height: usize,
    width: usize,
    /// `[H, W]`, then twice `[H / 2, W / 2]`.
    luma: Vec<u8>,
    chroma: [Vec<u8>; 2],
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
        }
    }

    /// Height and width of the luma plane; both are even.
    pub(super) const fn size(&self) -> (usize, usize) {
        (self.height, self.width)
    }

    /// Takes the frame `[H, W, 3]`; a row or column that it lacks copies its last one.
    pub(super) fn fill(&mut self, frame: &[u8]) {
        let [last_row, last_column] = [self.frame_height - 1, self.frame_width - 1];
        for y in (0..self.height).step_by(2) {
            let rows = [y, (y + 1).min(last_row)]
                .map(|y| &frame[y * self.frame_width * 3..][..self.frame_width * 3]);
            for x in (0..self.width).step_by(2) {
                let columns = [x, (x + 1).min(last_column)];
                let mut sum = [0; 3];
                for (dy, row) in rows.iter().enumerate() {
                    for (dx, &column) in columns.iter().enumerate() {
                        let rgb = [0, 1, 2].map(|channel| i32::from(row[column * 3 + channel]));
                        self.luma[(y + dy) * self.width + x + dx] = fixed(dot(LUMA, rgb), BITS, 16);
                        sum = [sum[0] + rgb[0], sum[1] + rgb[1], sum[2] + rgb[2]];
                    }
                }
                for (plane, weights) in self.chroma.iter_mut().zip(CHROMA) {
                    // Two more bits: `sum` is that of four pixels.
                    plane[y / 2 * (self.width / 2) + x / 2] = fixed(dot(weights, sum), BITS + 2, 128);
                }
            }
        }
    }

    /// What the encoder reads.
    pub(super) fn source(&self) -> YUVSlices<'_> {
        let half = self.width / 2;
        let planes = (&self.luma[..], &self.chroma[0][..], &self.chroma[1][..]);
        YUVSlices::new(planes, (self.width, self.height), (self.width, half, half))
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

    /// Values of the colour bars of ITU-R BT.709 at full amplitude, from the standard's equations by hand.
    #[test]
    fn known_colours() {
        let cases = [
            ([0, 0, 0], [16, 128, 128]),
            ([255, 255, 255], [235, 128, 128]),
            ([255, 0, 0], [63, 102, 240]),
            ([0, 255, 0], [173, 42, 26]),
            ([0, 0, 255], [32, 240, 118]),
            ([255, 255, 0], [219, 16, 138]),
        ];
        for (rgb, [y, u, v]) in cases {
            let planes = planes_of(2, 2, &rgb.repeat(4));
            assert_eq!((&planes.luma, &planes.chroma), (&vec![y; 4], &[vec![u], vec![v]]), "{rgb:?}");
        }
    }

    #[test]
    fn every_grey_is_without_colour() {
        for level in 0..=255 {
            let planes = planes_of(2, 2, &[level; 12]);
            assert_eq!(planes.chroma, [vec![128], vec![128]]);
            let exact = 16.0 + 219.0 * f64::from(level) / 255.0;
            assert!((f64::from(planes.luma[0]) - exact).abs() <= 0.501, "{level}");
        }
    }

    #[test]
    fn odd_sides_repeat_the_last_row_and_column() {
        let grey: Vec<u8> = (0..9).map(|i| i * 20).collect();
        let rgb: Vec<u8> = grey.iter().flat_map(|&g| [g; 3]).collect();
        let planes = planes_of(3, 3, &rgb);
        assert_eq!(planes.size(), (4, 4));
        let row = |y: usize| &planes.luma[y * 4..(y + 1) * 4];
        assert_eq!(row(3), row(2));
        for y in 0..4 {
            assert_eq!(row(y)[3], row(y)[2]);
        }
        assert_ne!(row(0), row(1));
    }
}
