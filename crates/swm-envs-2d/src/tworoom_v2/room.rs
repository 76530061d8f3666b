//! The two rooms as an agent meets them: walls, doors, and how a step moves it. Positions are `[x, y]` in pixels of the
//! 224-px image, y down. Where to go is `route.rs`.

use swm_core::Outcome;
use swm_fov::Fov;

use crate::dot_room::Dots;

/// Height and width of the image, and of the world.
pub(crate) const IMAGE_PX: usize = 224;
/// The same as a length.
pub(crate) const SIDE: f32 = IMAGE_PX as f32;
/// The rooms begin this far from the image's edge.
pub(crate) const BORDER_PX: f64 = 14.0;
/// Where the middle of the wall is.
pub(super) const WALL_CENTER_PX: f64 = 112.0;
/// The target is reached nearer than this.
pub(crate) const SUCCESS_PX: f64 = 16.0;
/// A door is passable this far beyond its half extent.
const DOOR_MARGIN_PX: f64 = 1.75;
/// An agent that runs into the wall is put this far before it.
const PUSHBACK_PX: f64 = 0.5;

/// A door: where on the wall, and how far it reaches to either side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Door {
    pub(super) center: f64,
    pub(super) half_extent: f64,
}

impl Door {
    /// Whether an agent at this place along the wall is in the door.
    pub(super) fn holds(&self, along: f64) -> bool {
        let reach = self.half_extent;
        (self.center - reach - DOOR_MARGIN_PX..=self.center + reach + DOOR_MARGIN_PX).contains(&along)
    }

    /// The places along the wall that it holds.
    pub(super) fn opening(&self) -> [f64; 2] {
        let reach = self.half_extent + DOOR_MARGIN_PX;
        [self.center - reach, self.center + reach]
    }
}

/// What of an assignment of factors matters for moving.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Room {
    /// The coordinate that the wall divides: 0 for x (a vertical wall), 1 for y.
    pub(super) divided: usize,
    /// Half of the wall's thickness, rounded down.
    pub(super) wall_half: f64,
    /// The agent's radius.
    pub(super) radius: f64,
    /// Pixels per step and axis at full action.
    pub(super) speed: f32,
    doors: [Door; 3],
    door_count: usize,
}

impl Room {
    /// The rooms of an episode.
    pub(super) fn new(fov: &Fov) -> Self {
        let (centers, half_extents) =
            (fov.vector::<i64, 3>("door.position"), fov.vector::<i64, 3>("door.size"));
        let door = |i: usize| Door { center: centers[i] as f64, half_extent: half_extents[i] as f64 };
        Self {
            divided: usize::from(fov.i64("wall.axis") == 0),
            wall_half: (fov.i64("wall.thickness") / 2) as f64,
            radius: f64::from(fov.f32("agent.radius")),
            speed: fov.f32("agent.speed"),
            doors: [0, 1, 2].map(door),
            door_count: fov.i64("door.number") as usize,
        }
    }

    /// The doors that exist.
    pub(super) fn doors(&self) -> &[Door] {
        &self.doors[..self.door_count]
    }

    /// The coordinate that the wall divides.
    pub(super) fn across<T: Copy>(&self, position: [T; 2]) -> T {
        position[self.divided]
    }

    /// The coordinate along the wall.
    pub(super) fn along<T: Copy>(&self, position: [T; 2]) -> T {
        position[1 - self.divided]
    }

    /// A position from its coordinates across and along the wall.
    pub(super) fn position<T: Copy>(&self, across: T, along: T) -> [T; 2] {
        if self.divided == 0 { [across, along] } else { [along, across] }
    }

    /// Where an agent's center may be, on both axes.
    pub(super) fn limits(&self) -> [f64; 2] {
        [BORDER_PX + self.radius, IMAGE_PX as f64 - BORDER_PX - self.radius]
    }

    /// Between these coordinates an agent's center is in the wall, ends excluded.
    pub(super) fn wall(&self) -> [f64; 2] {
        let reach = self.wall_half + self.radius;
        [WALL_CENTER_PX - reach, WALL_CENTER_PX + reach]
    }

    /// Where one control step leads: at most `speed` px per axis, stopped by borders and wall.
    ///
    /// The reference's arithmetic to the bit: positions and movement in f32, limits in f64, and only the new position is
    /// asked whether it is in a door.
    pub(super) fn step(&self, from: [f32; 2], action: [f32; 2]) -> [f32; 2] {
        let [least, most] = self.limits();
        let mut next = [0, 1].map(|axis| {
            let moved = from[axis] + action[axis].clamp(-1.0, 1.0) * self.speed;
            f64::from(moved).clamp(least, most) as f32
        });
        let (across, along) = (f64::from(self.across(next)), f64::from(self.along(next)));
        let [low, high] = self.wall();
        let comes_from_low = f64::from(self.across(from)) < WALL_CENTER_PX;
        let hits = if comes_from_low { across > low } else { across < high };
        if hits && !self.doors().iter().any(|door| door.holds(along)) {
            let stopped = if comes_from_low { low - PUSHBACK_PX } else { high + PUSHBACK_PX };
            next[self.divided] = stopped as f32;
        }
        next
    }
}

/// The distance of two positions, px.
pub(super) fn distance([ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> f64 {
    ((ax - bx) * (ax - bx) + (ay - by) * (ay - by)).sqrt()
}

/// Pixels from the agent to the target, as the crow flies.
pub(crate) fn to_target(state: &Dots) -> f64 {
    f64::from(distance_f32(state.agent, state.target))
}

/// Near the target is success, and ends the episode; nothing is rewarded.
pub(crate) fn outcome(state: &Dots) -> Outcome {
    let success = to_target(state) < SUCCESS_PX;
    Outcome { reward: 0.0, terminated: success, success: Some(success) }
}

/// The distance of two positions as the reference computes it: in f32, where the second square is added without having
/// been rounded first.
pub(crate) fn distance_f32([ax, ay]: [f32; 2], [bx, by]: [f32; 2]) -> f32 {
    let (dx, dy) = (ax - bx, ay - by);
    let first = dx * dx;
    ((f64::from(first) + f64::from(dy) * f64::from(dy)) as f32).sqrt()
}
