//! Pictures on their way into a batch: resized, and with the channels first, as far as asked for.

use swm_render::AntialiasBilinear;
use wide::u8x16;

use super::wrong;
use crate::error::DataError;

/// What is done to the pictures of one column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Convert {
    /// `[H, W]` in the dataset.
    pub(super) stored: [usize; 2],
    pub(super) channels: usize,
    /// `[H, W]` in the batch.
    pub(super) wanted: [usize; 2],
    /// `[C, H, W]` in the batch.
    pub(super) channels_first: bool,
}

/// Tables and memory of one thread for one column.
#[derive(Default)]
pub(super) struct Darkroom {
    resize: Option<AntialiasBilinear>,
    stored: Vec<u8>,
    resized: Vec<u8>,
}

impl Convert {
    /// Whether anything is to be done.
    pub(super) fn is_needed(&self) -> bool {
        self.stored != self.wanted || (self.channels_first && self.channels > 1)
    }

    /// Refuses resizes that there are not.
    pub(super) fn check(&self, column: &str) -> Result<(), DataError> {
        if self.stored == self.wanted {
            return Ok(());
        }
        if self.channels != 3 {
            return wrong(
                "image",
                format!("column `{column}` has {} channels; only 3 are resized", self.channels),
            );
        }
        self.resizer().map(drop)
    }

    /// The shape of one picture in the batch.
    pub(super) fn shape(&self) -> Vec<usize> {
        let [height, width] = self.wanted;
        match self.channels_first {
            true => vec![self.channels, height, width],
            false => vec![height, width, self.channels],
        }
    }

    fn resizer(&self) -> Result<AntialiasBilinear, DataError> {
        AntialiasBilinear::new(self.stored, self.wanted)
            .map_err(|error| DataError::Loader { setting: "image", reason: error.to_string() })
    }

    /// Fills `out`, some pictures as the batch wants them. `read` fills a slice with as many as the dataset stores them.
    pub(super) fn run(
        &self,
        darkroom: &mut Darkroom,
        out: &mut [u8],
        read: impl FnOnce(&mut [u8]) -> Result<(), DataError>,
    ) -> Result<(), DataError> {
        let Darkroom { resize, stored, resized } = darkroom;
        let bytes = |[height, width]: [usize; 2]| height * width * self.channels;
        let (from, into) = (bytes(self.stored), bytes(self.wanted));
        if into == 0 {
            return Ok(());
        }
        stored.resize(out.len() / into * from, 0);
        read(stored)?;
        let swap = self.channels_first && self.channels > 1;
        let pixels = self.wanted[0] * self.wanted[1];
        for (picture, out) in stored.chunks_exact(from).zip(out.chunks_exact_mut(into)) {
            if self.stored == self.wanted {
                channels_first(picture, pixels, self.channels, out);
                continue;
            }
            let resize = match resize {
                Some(resize) => resize,
                None => resize.insert(self.resizer()?),
            };
            resized.resize(into, 0);
            let target = if swap { resized.as_mut_slice() } else { &mut *out };
            resize
                .resize(picture, target)
                .map_err(|error| DataError::Loader { setting: "image", reason: error.to_string() })?;
            if swap {
                channels_first(resized, pixels, self.channels, out);
            }
        }
        Ok(())
    }
}

/// `[H × W, C]` → `[C, H × W]`.
fn channels_first(stored: &[u8], pixels: usize, channels: usize, out: &mut [u8]) {
    if channels == 3 {
        let (red, rest) = out.split_at_mut(pixels);
        let (green, blue) = rest.split_at_mut(pixels);
        split_colours(stored, red, green, blue);
        return;
    }
    for (channel, plane) in out.chunks_exact_mut(pixels).enumerate() {
        for (value, pixel) in plane.iter_mut().zip(stored.chunks_exact(channels)) {
            *value = pixel[channel];
        }
    }
}

/// `[N, 3]` → three times `[N]`, 16 pixels at a time. (In one function: it has to be inlined to be fast.)
fn split_colours(stored: &[u8], red: &mut [u8], green: &mut [u8], blue: &mut [u8]) {
    let (blocks, _) = stored.as_chunks::<48>();
    let reds = red.as_chunks_mut().0.iter_mut();
    let (greens, blues) = (green.as_chunks_mut().0.iter_mut(), blue.as_chunks_mut().0.iter_mut());
    for (((block, red), green), blue) in blocks.iter().zip(reds).zip(greens).zip(blues) {
        let lanes = |at: usize| {
            let mut lanes = [0; 16];
            lanes.copy_from_slice(&block[at..at + 16]);
            u8x16::new(lanes)
        };
        let upper = |lanes: u8x16| {
            let mut moved = [0; 16];
            moved[..8].copy_from_slice(&lanes.to_array()[8..]);
            u8x16::new(moved)
        };
        let (mut a, mut b, mut c) = (lanes(0), lanes(16), lanes(32));
        // Of 48 values, deals those of the first half and those of the second in turns, so that values `i` and `i + 24`
        // become neighbours. After four times, value `3 i + channel` stands at `16 channel + i`.
        for _ in 0..4 {
            (a, b, c) = (
                u8x16::unpack_low(a, upper(b)),
                u8x16::unpack_low(upper(a), c),
                u8x16::unpack_low(b, upper(c)),
            );
        }
        (*red, *green, *blue) = (a.to_array(), b.to_array(), c.to_array());
    }
    let whole = blocks.len() * 16;
    let rest = stored[3 * whole..].as_chunks::<3>().0.iter();
    for (((pixel, red), green), blue) in
        rest.zip(&mut red[whole..]).zip(&mut green[whole..]).zip(&mut blue[whole..])
    {
        [*red, *green, *blue] = *pixel;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_split_whatever_their_number() {
        for (pixels, channels) in [(1, 3), (15, 3), (16, 3), (17, 3), (400, 3), (33, 4), (5, 1)] {
            let stored: Vec<u8> = (0..pixels * channels).map(|i| (i * 7 + i / 11) as u8).collect();
            let mut out = vec![0; stored.len()];
            channels_first(&stored, pixels, channels, &mut out);
            for (at, value) in stored.iter().enumerate() {
                assert_eq!(out[at % channels * pixels + at / channels], *value, "{pixels} {channels}");
            }
        }
    }
}
