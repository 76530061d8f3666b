//! A changing backdrop wherever the image has a key color. (The reference shows a video there; this program reads none, and
//! draws bands that move.)

use rand::RngExt as _;
use serde::{Deserialize, Serialize};
use swm_core::registry::Setting;
use swm_core::view::Frame;

use super::{Distractor, within};

/// Replaces pixels near the key color by diagonal bands, in colors that are drawn per episode.
#[derive(Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ChromaKey {
    red: u8,
    green: u8,
    blue: u8,
    tolerance: f64,
    band: usize,
    speed: u64,
}

impl Default for ChromaKey {
    fn default() -> Self {
        Self { red: 255, green: 255, blue: 255, tolerance: 0.0, band: 8, speed: 1 }
    }
}

impl Distractor for ChromaKey {
    const NAME: &'static str = "chroma_key";
    const SUMMARY: &'static str = "moving bands where the image has a key color";
    const SETTINGS: &'static [Setting] = &[
        Setting { name: "red", doc: "red of the key color", default: "255" },
        Setting { name: "green", doc: "green of the key color", default: "255" },
        Setting { name: "blue", doc: "blue of the key color", default: "255" },
        Setting { name: "tolerance", doc: "largest distance from it in RGB", default: "0.0" },
        Setting { name: "band", doc: "width of a band in pixels", default: "8" },
        Setting { name: "speed", doc: "pixels that bands move per step", default: "1" },
    ];

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
