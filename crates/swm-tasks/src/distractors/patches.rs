//! Rectangles in one color: fixed for an episode, sampled at every step, or moving.

use std::f64::consts::TAU;

use rand::RngExt as _;
use swm_core::seed::Stream;
use swm_core::view::Frame;

use super::{Distractor, within};

const MOST: f64 = 1000.0;

swm_core::settings! {
    /// How many rectangles, how large, how bright.
    pub(super) struct Occlusion {
        /// Number of rectangles.
        patches: usize = 1,
        /// Smallest side, as a fraction of the image's.
        smallest: f64 = 0.1,
        /// Largest side.
        largest: f64 = 0.3,
        /// Brightness, 0 to 255.
        color: u8 = 0,
    }
}

impl Distractor for Occlusion {
    const NAME: &'static str = "occlusion";
    const SUMMARY: &'static str = "rectangles that hide parts of the image, others in every episode";

    fn check(&self) -> Result<(), String> {
        check(self.patches, self.smallest, self.largest)
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        let mut rng = frame.of_episode("distractor occlusion");
        self.fill(&mut rng, frame);
    }
}

impl Occlusion {
    fn fill(&self, rng: &mut Stream, frame: &mut Frame<'_>) {
        for _ in 0..self.patches {
            let [height, width] = sides(rng, frame, self.smallest, self.largest);
            let y = rng.random_range(0..=frame.height - height);
            let x = rng.random_range(0..=frame.width - width);
            fill(frame, [y, x], [height, width], self.color);
        }
    }
}

swm_core::settings! {
    /// As occlusion, sampled anew at every step.
    pub(super) struct Cutout {
        /// Number of rectangles.
        patches: usize = 1,
        /// Smallest side, as a fraction of the image's.
        smallest: f64 = 0.1,
        /// Largest side.
        largest: f64 = 0.2,
        /// Brightness, 0 to 255.
        color: u8 = 0,
    }
}

impl Distractor for Cutout {
    const NAME: &'static str = "cutout";
    const SUMMARY: &'static str = "rectangles that hide parts of the image, others at every step";

    fn check(&self) -> Result<(), String> {
        check(self.patches, self.smallest, self.largest)
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        let Self { patches, smallest, largest, color } = *self;
        let mut rng = frame.of_step("distractor cutout");
        Occlusion { patches, smallest, largest, color }.fill(&mut rng, frame);
    }
}

swm_core::settings! {
    /// Rectangles that move in a straight line and bounce off the edges of the image.
    pub(super) struct MovingPatch {
        /// Number of rectangles.
        patches: usize = 1,
        /// Smallest side, as a fraction of the image's.
        smallest: f64 = 0.1,
        /// Largest side.
        largest: f64 = 0.2,
        /// Brightness, 0 to 255.
        color: u8 = 255,
        /// Pixels per step.
        speed: f64 = 2.0,
    }
}

impl Distractor for MovingPatch {
    const NAME: &'static str = "moving_patch";
    const SUMMARY: &'static str = "rectangles that move through the image and bounce off its edges";

    fn check(&self) -> Result<(), String> {
        check(self.patches, self.smallest, self.largest)?;
        within("speed", self.speed, 0.0, 1000.0)
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        let mut rng = frame.of_episode("distractor moving_patch");
        for _ in 0..self.patches {
            let [height, width] = sides(&mut rng, frame, self.smallest, self.largest);
            let room = [frame.height - height, frame.width - width].map(|room| room as f64);
            let start = room.map(|room| room * rng.random::<f64>());
            let angle = TAU * rng.random::<f64>();
            let traveled = self.speed * frame.step as f64;
            let at = [start[0] + traveled * angle.sin(), start[1] + traveled * angle.cos()];
            let place = |axis: usize| bounced(at[axis], room[axis]).floor() as usize;
            fill(frame, [place(0), place(1)], [height, width], self.color);
        }
    }
}

/// `at`, reflected at 0 and `room` as often as needed: in closed form, so that a step does not depend on those before.
fn bounced(at: f64, room: f64) -> f64 {
    if room <= 0.0 {
        return 0.0;
    }
    let place = at.rem_euclid(2.0 * room);
    place.min(2.0 * room - place)
}

fn check(patches: usize, smallest: f64, largest: f64) -> Result<(), String> {
    within("patches", patches as f64, 1.0, MOST)?;
    within("smallest", smallest, 0.0, 1.0)?;
    within("largest", largest, smallest, 1.0)
}

/// Height and width of a rectangle.
fn sides(rng: &mut Stream, frame: &Frame<'_>, smallest: f64, largest: f64) -> [usize; 2] {
    [frame.height, frame.width].map(|side| {
        let part = smallest + (largest - smallest) * rng.random::<f64>();
        ((part * side as f64) as usize).clamp(1, side)
    })
}

fn fill(frame: &mut Frame<'_>, [top, left]: [usize; 2], [height, width]: [usize; 2], color: u8) {
    for row in top..(top + height).min(frame.height) {
        let right = (left + width).min(frame.width);
        frame.pixels[(row * frame.width + left) * 3..(row * frame.width + right) * 3].fill(color);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patches_bounce_at_both_ends() {
        let places: Vec<f64> = (0..8).map(|step| bounced(3.0 + 2.0 * f64::from(step), 6.0)).collect();
        assert_eq!(places, [3.0, 5.0, 5.0, 3.0, 1.0, 1.0, 3.0, 5.0]);
        assert_eq!(bounced(-2.0, 6.0), 2.0);
        assert_eq!(bounced(5.0, 0.0), 0.0);
    }
}
