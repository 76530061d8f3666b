//! Where the bodies are to be put.

use super::math::Vec2;
use super::world::PhysicsError;

/// Where the bodies are to be put. Positions are those of the origins of the bodies' coordinates, pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Placement {
    /// Agent position.
    pub agent: [f64; 2],
    /// Agent velocity, px/s.
    pub agent_velocity: [f64; 2],
    /// Agent angle, radians; `None` leaves it. Without effect on a disc.
    pub agent_angle: Option<f64>,
    /// Block position.
    pub block: [f64; 2],
    /// Block angle, radians.
    pub block_angle: f64,
}

impl From<[f64; 5]> for Placement {
    /// From the reference's state `[x, y, block x, block y, block angle]`, with the agent at rest.
    fn from([x, y, block_x, block_y, block_angle]: [f64; 5]) -> Placement {
        Placement { agent: [x, y], block: [block_x, block_y], block_angle, ..Placement::default() }
    }
}

impl From<[f64; 7]> for Placement {
    /// From the reference's state `[x, y, block x, block y, block angle, vx, vy]`.
    fn from([x, y, block_x, block_y, block_angle, vx, vy]: [f64; 7]) -> Placement {
        Placement { agent_velocity: [vx, vy], ..Placement::from([x, y, block_x, block_y, block_angle]) }
    }
}

impl Placement {
    /// [`PhysicsError::NotFinite`] if a number is NaN or infinite.
    pub(super) fn check(&self) -> Result<(), PhysicsError> {
        let finite = [
            ("the agent's position", Vec2::from(self.agent).is_finite()),
            ("the agent's velocity", Vec2::from(self.agent_velocity).is_finite()),
            ("the agent's angle", self.agent_angle.is_none_or(f64::is_finite)),
            ("the block's position", Vec2::from(self.block).is_finite()),
            ("the block's angle", self.block_angle.is_finite()),
        ];
        match finite.into_iter().find(|(_, finite)| !finite) {
            Some((what, _)) => Err(PhysicsError::NotFinite { what }),
            None => Ok(()),
        }
    }
}
