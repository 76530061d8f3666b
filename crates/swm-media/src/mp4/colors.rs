//! Luma and chroma planes as RGB frames, in 16.16 fixed point: the same bytes on every machine. The other way is
//! `planes`.

use super::decoders::Image;
use super::parameters::Colors;

const ONE: f64 = 65536.0;

/// The weights of one matrix and range, in 16.16 fixed point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Conversion {
    /// What black is in luma.
    black: i32,
    luma: i32,
    /// Red from the second chroma plane, green from both, blue from the first.
    red: i32,
    green: [i32; 2],
    blue: i32,
}

impl Conversion {
    pub(super) fn new(colors: Colors) -> Self {
        // The weights in luma, by the codes of ITU-T H.273, table 4.
        let (red, blue) = match colors.matrix {
            1 => (0.2126, 0.0722),
            4 => (0.30, 0.11),
            7 => (0.212, 0.087),
            9 | 10 => (0.2627, 0.0593),
            _ => (0.299, 0.114),
        };
        let green = 1.0 - red - blue;
        let (black, luma, chroma) =
            if colors.is_full_range { (0, 1.0, 1.0) } else { (16, 255.0 / 219.0, 255.0 / 224.0) };
        let fixed = |weight: f64| (weight * ONE).round() as i32;
        Self {
            black,
            luma: fixed(luma),
            red: fixed(2.0 * (1.0 - red) * chroma),
            green: [
                fixed(-2.0 * (1.0 - blue) * blue / green * chroma),
                fixed(-2.0 * (1.0 - red) * red / green * chroma),
            ],
            blue: fixed(2.0 * (1.0 - blue) * chroma),
        }
    }

    /// The upper left part of the image as `[H, W, 3]`.
    pub(super) fn rgb(
        &self,
        image: &Image<'_>,
        (height, width): (usize, usize),
        out: &mut [u8],
    ) -> Result<(), String> {
        let (strides, [luma, first, second]) = (image.strides, image.planes);
        let row = |plane: &'_ [u8], stride: usize, y: usize, width: usize| {
            plane.get(y * stride..).and_then(|rest| rest.get(..width)).is_some()
        };
        let half = width.div_ceil(2);
        let fits = row(luma, strides[0], height - 1, width)
            && (image.is_gray
                || row(first, strides[1], (height - 1) / 2, half)
                    && row(second, strides[2], (height - 1) / 2, half));
        if !fits {
            return Err("an image is smaller than the file says".to_owned());
        }
        let gray = |luma: u8| self.luma * (i32::from(luma) - self.black) + (1 << 15);
        for (y, out) in out.chunks_exact_mut(width * 3).enumerate() {
            let luma = &luma[y * strides[0]..][..width];
            if image.is_gray {
                for (pixel, &luma) in out.as_chunks_mut::<3>().0.iter_mut().zip(luma) {
                    *pixel = [(gray(luma) >> 16).clamp(0, 255) as u8; 3];
                }
                continue;
            }
            let first = &first[y / 2 * strides[1]..][..half];
            let second = &second[y / 2 * strides[2]..][..half];
            for (((out, luma), &first), &second) in
                out.chunks_mut(6).zip(luma.chunks(2)).zip(first).zip(second)
            {
                let [first, second] = [i32::from(first) - 128, i32::from(second) - 128];
                let chroma =
                    [self.red * second, self.green[0] * first + self.green[1] * second, self.blue * first];
                for (pixel, &luma) in out.chunks_exact_mut(3).zip(luma) {
                    let gray = gray(luma);
                    for (value, chroma) in pixel.iter_mut().zip(chroma) {
                        *value = ((gray + chroma) >> 16).clamp(0, 255) as u8;
                    }
                }
            }
        }
        Ok(())
    }
}
