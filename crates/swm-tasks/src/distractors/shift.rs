//! Shifts by a few pixels, at every step another.

use rand::RngExt as _;
use swm_core::view::Frame;

use super::{Distractor, within};

swm_core::settings! {
    /// Pads the image by repeating its edges and crops one of its size.
    pub(super) struct RandomShift {
        /// Largest shift in pixels, in all directions.
        pad: usize = 4,
    }
}

impl Distractor for RandomShift {
    const NAME: &'static str = "random_shift";
    const SUMMARY: &'static str = "a shift by a few pixels, another at every step";

    fn check(&self) -> Result<(), String> {
        within("pad", self.pad as f64, 1.0, 1000.0)
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        let mut rng = frame.of_step("distractor random_shift");
        let [dy, dx] = [0, 0].map(|_: i32| rng.random_range(0..=2 * self.pad));
        let Frame { pixels, height, width, scratch, .. } = frame;
        let (height, width) = (*height, *width);
        scratch.bytes.clear();
        scratch.bytes.extend_from_slice(pixels);
        let from = |at: usize, shift: usize, len: usize| (at + shift).saturating_sub(self.pad).min(len - 1);
        for y in 0..height {
            for x in 0..width {
                let source = (from(y, dy, height) * width + from(x, dx, width)) * 3;
                pixels[(y * width + x) * 3..][..3].copy_from_slice(&scratch.bytes[source..source + 3]);
            }
        }
    }
}
