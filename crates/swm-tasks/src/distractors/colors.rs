//! Changes of color: jitter, sampled per episode, and grayscale.

use rand::RngExt as _;
use serde::{Deserialize, Serialize};
use swm_core::view::Frame;
use swm_core::{Setting, Settings};

use super::{Distractor, byte, within};

swm_core::settings! {
    /// Brightness, contrast, saturation and hue, each changed by its own factor or turn.
    pub(super) struct ColorJitter {
        /// Largest relative change of brightness.
        brightness: f64 = 0.2,
        /// Largest relative change of contrast.
        contrast: f64 = 0.2,
        /// Largest relative change of saturation.
        saturation: f64 = 0.2,
        /// Largest turn of the hue, as a fraction of a full one.
        hue: f64 = 0.05,
        /// Truncate to bytes instead of rounding, as the reference does.
        truncate: bool = false,
    }
}

impl Distractor for ColorJitter {
    const NAME: &'static str = "color_jitter";
    const SUMMARY: &'static str = "other brightness, contrast, saturation and hue in every episode";

    fn check(&self) -> Result<(), String> {
        for (name, value) in
            [("brightness", self.brightness), ("contrast", self.contrast), ("saturation", self.saturation)]
        {
            within(name, value, 0.0, 10.0)?;
        }
        within("hue", self.hue, 0.0, 0.5)
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        let mut rng = frame.of_episode("distractor color_jitter");
        let mut factor = |p: f64| {
            let u: f64 = rng.random();
            let low = (1.0 - p).max(0.0);
            (low + (1.0 + p - low) * u) as f32
        };
        let [brightness, contrast, saturation] =
            [factor(self.brightness), factor(self.contrast), factor(self.saturation)];
        let turn = (self.hue * (2.0 * rng.random::<f64>() - 1.0)) as f32;
        let count = (frame.height * frame.width) as f32;
        let mut mean = [0.0_f32; 3];
        for (channel, mean) in mean.iter_mut().enumerate() {
            let sum: u64 = frame.pixels.iter().skip(channel).step_by(3).map(|&value| u64::from(value)).sum();
            *mean = sum as f32 * brightness / count;
        }
        for pixel in frame.pixels.chunks_exact_mut(3) {
            for (value, mean) in pixel.iter_mut().zip(mean) {
                *value = byte((f32::from(*value) * brightness - mean) * contrast + mean, self.truncate);
            }
            let [h, s, v] = hsv([pixel[0], pixel[1], pixel[2]]);
            let color = rgb([(h + turn).rem_euclid(1.0), (s * saturation).min(1.0), v]);
            for (value, color) in pixel.iter_mut().zip(color) {
                *value = byte(color, self.truncate);
            }
        }
    }
}

/// Hue and saturation in 0..=1, value in bytes. Source: A. R. Smith, "Color gamut transform pairs", SIGGRAPH 1978.
fn hsv(pixel: [u8; 3]) -> [f32; 3] {
    let [r, g, b] = pixel.map(f32::from);
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let range = most - least;
    if range <= 0.0 {
        return [0.0, 0.0, most];
    }
    let sixth = if most == r {
        ((g - b) / range).rem_euclid(6.0)
    } else if most == g {
        (b - r) / range + 2.0
    } else {
        (r - g) / range + 4.0
    };
    [sixth / 6.0, range / most, most]
}

fn rgb([h, s, v]: [f32; 3]) -> [f32; 3] {
    let channel = |n: f32| {
        let k = (n + 6.0 * h).rem_euclid(6.0);
        v - v * s * k.min(4.0 - k).clamp(0.0, 1.0)
    };
    [channel(5.0), channel(3.0), channel(1.0)]
}

/// Luma in all channels.
#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Grayscale {}

impl Settings for Grayscale {
    const SETTINGS: &'static [Setting] = &[];
}

impl Distractor for Grayscale {
    const NAME: &'static str = "grayscale";
    const SUMMARY: &'static str = "no colors: the luma in all channels";

    fn check(&self) -> Result<(), String> {
        Ok(())
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        for pixel in frame.pixels.chunks_exact_mut(3) {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(u32::from);
            // ITU-R BT.601 in thousandths, rounded.
            pixel.fill(((299 * r + 587 * g + 114 * b + 500) / 1000) as u8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hue_saturation_and_value_lead_back() {
        for pixel in [[0, 0, 0], [255, 255, 255], [200, 30, 40], [10, 250, 3], [17, 99, 250], [90, 90, 91]] {
            let back = rgb(hsv(pixel));
            assert!(
                back.iter().zip(pixel).all(|(a, b)| (a - f32::from(b)).abs() < 0.01),
                "{pixel:?} {back:?}"
            );
        }
        assert_eq!(hsv([0, 255, 0])[0], 1.0 / 3.0);
    }
}
