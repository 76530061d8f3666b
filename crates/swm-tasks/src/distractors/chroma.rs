//! A changing backdrop wherever the image has a key color. (The reference shows a video there; this program reads none, and
//! draws bands that move.)

use rand::RngExt as _;
use swm_core::view::Frame;

use super::{Distractor, within};

swm_core::settings! {
    /// Replaces pixels near the key color by diagonal bands, in colors that are sampled per episode.
    pub(super) struct ChromaKey {
        /// Red of the key color.
        red: u8 = 255,
        /// Green of the key color.
        green: u8 = 255,
        /// Blue of the key color.
        blue: u8 = 255,
        /// Largest distance from it in RGB.
        tolerance: f64 = 0.0,
        /// Width of a band in pixels.
        band: usize = 8,
        /// Pixels that bands move per step.
        speed: u64 = 1,
    }
}

impl Distractor for ChromaKey {
    const NAME: &'static str = "chroma_key";
    const SUMMARY: &'static str = "moving bands where the image has a key color";

    fn check(&self) -> Result<(), String> {
        within("tolerance", self.tolerance, 0.0, 442.0)?;
        within("band", self.band as f64, 1.0, 1000.0)
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        let mut rng = frame.of_episode("distractor chroma_key");
        let colors: [[u8; 3]; 2] = [rng.random(), rng.random()];
        let moved = (frame.step.wrapping_mul(self.speed) % (2 * self.band as u64)) as usize;
        let key = [self.red, self.green, self.blue].map(f64::from);
        for (index, pixel) in frame.pixels.chunks_exact_mut(3).enumerate() {
            let squares = pixel.iter().zip(key).map(|(&value, key)| (f64::from(value) - key).powi(2));
            if squares.sum::<f64>() <= self.tolerance * self.tolerance {
                let (y, x) = (index / frame.width, index % frame.width);
                pixel.copy_from_slice(&colors[(x + y + moved) / self.band % 2]);
            }
        }
    }
}
