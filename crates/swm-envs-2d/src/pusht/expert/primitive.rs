//! Push primitives: three values that say a whole approach and push, and how they are sampled and varied.

use std::f64::consts::PI;

use rand_distr::{Distribution as _, StandardNormal, StandardUniform};
use swm_core::seed::Stream;

use super::scene::Scene;

/// Go somewhere beside the block, then push in one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Primitive {
    pub(super) start: Start,
    /// Direction of the push: from the inward normal of the outline, or, where there is none, from the x axis.
    pub(super) turn_rad: f64,
    /// Strength of the push, up to 1.
    pub(super) strength: f64,
    /// Control steps of the push; `None`: until the block is nearest to its goal.
    pub(super) duration: Option<u32>,
    /// Whether the push turns with the block and stays at its place of the outline.
    pub(super) follow: bool,
}

/// Where a push begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Start {
    /// Where the agent is.
    Here,
    /// At a spot of the block's outline.
    At(Spot),
}

/// Where agent and block are to touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spot {
    /// Position on the block's outline.
    pub(super) arc_px: f64,
    /// Which side of a polygon agent touches there: 0 its one end across the normal, 1 the other.
    pub(super) side: f64,
}

/// Std of the direction about the normal, radians.
const TURN_STD: f64 = 0.5;
/// One in so many primitives begins where the agent is.
const HERE_SHARE: f64 = 0.12;
/// Share of pushes that turn with the block.
const FOLLOW_SHARE: f64 = 0.5;
/// Std of variations: arc position, direction, strength.
const VARIATION: [f64; 3] = [10.0, 0.2, 0.15];
const SIDE_VARIATION: f64 = 0.15;

impl Primitive {
    /// Samples any primitive.
    pub(super) fn sample(scene: &Scene, stream: &mut Stream) -> Primitive {
        let weakest = scene.limits.weakest;
        let strength = weakest + (1.0 - weakest) * uniform(stream);
        if uniform(stream) < HERE_SHARE {
            let turn_rad = PI * (2.0 * uniform(stream) - 1.0);
            return Primitive { start: Start::Here, turn_rad, strength, duration: None, follow: false };
        }
        let start =
            Start::At(Spot { arc_px: scene.outline.length() * uniform(stream), side: uniform(stream) });
        let follow = uniform(stream) < FOLLOW_SHARE;
        Primitive { start, turn_rad: TURN_STD * normal(stream), strength, duration: None, follow }
    }

    /// Samples a primitive that ends at a random step: a detour.
    pub(super) fn sample_detour(scene: &Scene, stream: &mut Stream) -> Primitive {
        let longest = f64::from(scene.limits.push);
        let duration = 1 + (longest * uniform(stream)) as u32;
        Primitive { duration: Some(duration), ..Primitive::sample(scene, stream) }
    }

    /// Samples a primitive near this one; `scale` says how near.
    pub(super) fn vary(&self, scene: &Scene, scale: f64, stream: &mut Stream) -> Primitive {
        let [arc, turn, strength] = VARIATION.map(|std| std * scale);
        let start = match self.start {
            Start::Here => Start::Here,
            Start::At(Spot { arc_px, side }) => Start::At(Spot {
                arc_px: arc_px + arc * normal(stream),
                side: (side + SIDE_VARIATION * scale * normal(stream)).clamp(0.0, 1.0),
            }),
        };
        Primitive {
            start,
            turn_rad: self.turn_rad + turn * normal(stream),
            strength: (self.strength + strength * normal(stream)).clamp(scene.limits.weakest, 1.0),
            duration: self.duration,
            follow: self.follow,
        }
    }
}

pub(super) fn uniform(stream: &mut Stream) -> f64 {
    StandardUniform.sample(stream)
}

pub(super) fn normal(stream: &mut Stream) -> f64 {
    StandardNormal.sample(stream)
}
