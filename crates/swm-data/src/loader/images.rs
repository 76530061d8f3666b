//! Images on their way into a batch: resized, and with the channels first, as far as asked for.

use swm_media::planar::split_colors;
use swm_render::AntialiasBilinear;

use super::wrong;
use crate::error::DataError;

/// What is done to the images of one column.
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

    /// The shape of one image in the batch.
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

    /// Fills `out`, some images as the batch wants them. `read` fills a slice with as many as the dataset stores them.
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
        for (image, out) in stored.chunks_exact(from).zip(out.chunks_exact_mut(into)) {
            if self.stored == self.wanted {
                channels_first(image, pixels, self.channels, out);
                continue;
            }
            let resize = match resize {
                Some(resize) => resize,
                None => resize.insert(self.resizer()?),
            };
            resized.resize(into, 0);
            let target = if swap { resized.as_mut_slice() } else { &mut *out };
            resize
                .resize(image, target)
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
        split_colors(stored, [red, green, blue]);
        return;
    }
    for (channel, plane) in out.chunks_exact_mut(pixels).enumerate() {
        for (value, pixel) in plane.iter_mut().zip(stored.chunks_exact(channels)) {
            *value = pixel[channel];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_split_whatever_their_number() {
        for (pixels, channels) in [(1, 3), (31, 3), (32, 3), (33, 3), (400, 3), (33, 4), (5, 1)] {
            let stored: Vec<u8> = (0..pixels * channels).map(|i| (i * 7 + i / 11) as u8).collect();
            let mut out = vec![0; stored.len()];
            channels_first(&stored, pixels, channels, &mut out);
            for (at, value) in stored.iter().enumerate() {
                assert_eq!(out[at % channels * pixels + at / channels], *value, "{pixels} {channels}");
            }
        }
    }
}
