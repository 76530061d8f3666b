//! The expert of TwoRoom: to the nearest opening that is wide enough, straight through it, to the goal.
//!
//! The reference's expert walks to the middle of a door whatever stands in the way, and takes pixels for units of
//! action, so that it overshoots what is near: it catches on edges of doors, and fast agents jump over the goal for ever.
//! This one lines up in front of a door that it cannot see through, and stops where it wants to be.

use rand_distr::{Distribution as _, StandardNormal};
use swm_core::policy::write_action;
use swm_core::settings::Table;
use swm_core::{
    Actor, BatchError, PerEpisode, Policy, PolicyArgs, PolicyEntry, PolicyError, Settings as _, SliceMut,
    SlotView,
};

use super::physics::{Axis, FloorPlan, MAX_ACTION_NORM, Opening, Vec2, WALL_AT_PX};

/// `expert`.
pub(super) const EXPERT: PolicyEntry = PolicyEntry::new(
    "expert",
    "goes through the nearest door that is wide enough, then to the goal",
    |_, args| make(args, 0.0),
)
.settings(Arguments::SETTINGS);

/// `noisy-expert`.
pub(super) const NOISY_EXPERT: PolicyEntry = PolicyEntry::new(
    "noisy-expert",
    "the expert with normal noise on its actions (`noisy-expert:STD`), as the reference collects its data",
    |_, args| make(args, NOISY_STD),
)
.settings(NOISY_SETTINGS.as_slice());

const NOISY_STD: f64 = 1.3;
const NOISY_SETTINGS: &Table = &Table::of(&[Arguments::SETTINGS]).with_default("std", "1.3");
/// Rounding of actions leaves the agent this near to where it goes, pixels.
const CLOSE_PX: f64 = 1e-3;

swm_core::settings! {
    /// Arguments of the policy. Unknown names are refused.
    struct Arguments {
        /// Standard deviation of the noise on each component of the action.
        std: f64 = 0.0,
    }
}

fn make(args: &PolicyArgs, default_std: f64) -> Result<Box<dyn Policy>, PolicyError> {
    let mut args = args.clone();
    if args.positional.is_empty() {
        args.named.entry("std").or_insert(default_std.into());
    }
    let Arguments { std } = args.parse_with("std")?;
    args.check_not_negative("std", std)?;
    let description = if std == 0.0 { "expert".to_owned() } else { format!("{}:std={std}", args.name) };
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        Ok(Box::new(Expert { std, rooms: Rooms::of(view)? }) as Box<dyn Actor>)
    })))
}

/// The expert in one episode.
struct Expert {
    std: f64,
    rooms: Rooms,
}

/// What the expert knows of an episode.
struct Rooms {
    plan: FloorPlan,
    /// The openings that the agent fits through.
    openings: Vec<Opening>,
    radius: f64,
    /// Pixels per unit of action.
    speed: f64,
}

impl Rooms {
    fn of(view: &SlotView<'_>) -> Result<Rooms, BatchError> {
        let integers = |name: &str| view.row.get::<i64>(&format!("variation.{name}"));
        let real = |name: &str| view.row.get::<f32>(&format!("variation.{name}")).map(|r| f64::from(r[0]));
        let (radius, speed) = (real("agent.radius")?, real("agent.speed")?);
        let axis = if integers("wall.axis")?[0] == 0 { Axis::Horizontal } else { Axis::Vertical };
        let number = usize::try_from(integers("door.number")?[0]).unwrap_or(0);
        let (starts, lengths) = (integers("door.position")?, integers("door.size")?);
        let doors: Vec<_> = starts.iter().copied().zip(lengths.iter().copied()).take(number).collect();
        let plan = FloorPlan::new(axis, integers("wall.thickness")?[0], &doors);
        let openings = plan.openings().filter(|opening| opening.length() > 2.0 * radius).collect();
        Ok(Rooms { plan, openings, radius, speed })
    }

    /// Where to go next. `None`: nothing leads to the other room; only a push through the wall does, where that yields.
    fn waypoint(&self, agent: Vec2, goal: Vec2) -> Option<Vec2> {
        let axis = self.plan.axis;
        let side = |point: Vec2| axis.split(point).0 - WALL_AT_PX;
        // In front of the wall and behind it, the agent is clear of it; the goal may be nearer.
        let clear = self.plan.half_thickness + self.radius;
        let clear_behind = clear.min(side(goal).abs());
        let is_across = side(agent) * side(goal) < 0.0;
        let in_a_door = |opening: &&Opening| {
            side(agent).abs() < clear_behind - CLOSE_PX
                && (opening.from..=opening.to).contains(&axis.split(agent).1)
        };
        let gate = |opening: &Opening| axis.join(WALL_AT_PX, opening.middle());
        let distance = |opening: &&Opening| (gate(opening) - agent).norm();
        let opening = if is_across {
            self.openings.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?
        } else {
            match self.openings.iter().find(in_a_door) {
                Some(opening) => opening,
                None => return Some(goal),
            }
        };
        let [before, behind] = [-clear, clear_behind]
            .map(|step| axis.join(WALL_AT_PX + step.copysign(step * side(goal)), opening.middle()));
        let open_way = [goal, behind].into_iter().find(|&target| self.is_open(opening, agent, target));
        Some(open_way.unwrap_or(if is_across { before } else { behind }))
    }

    /// Whether the straight way from one room to the other stays clear of the opening's edges.
    fn is_open(&self, opening: &Opening, from: Vec2, to: Vec2) -> bool {
        let axis = self.plan.axis;
        let ((from_across, from_along), (to_across, to_along)) = (axis.split(from), axis.split(to));
        let clear = self.plan.half_thickness + self.radius;
        let slack = 0.25 * (opening.length() - 2.0 * self.radius);
        let free = opening.from + self.radius + slack..=opening.to - self.radius - slack;
        [WALL_AT_PX - clear, WALL_AT_PX + clear].into_iter().all(|plane| {
            let share = ((plane - from_across) / (to_across - from_across)).clamp(0.0, 1.0);
            free.contains(&(from_along + share * (to_along - from_along)))
        })
    }
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let place = |name: &str| -> Result<Vec2, PolicyError> {
            let values: &[f64] = view.row.get(name)?;
            Ok(Vec2::from([values[0], values[1]]))
        };
        let (agent, goal) = (place("pos_agent")?, place("pos_goal")?);
        let waypoint = self.rooms.waypoint(agent, goal);
        let mut way = (waypoint.unwrap_or(goal) - agent) * (1.0 / self.rooms.speed);
        let (length, longest) = (way.norm(), f64::from(MAX_ACTION_NORM));
        if length > longest || waypoint.is_none() && length > 0.0 {
            way = way * (longest / length);
        }
        let mut stream = view.episode.seed.indexed("policy expert noise", [view.episode.step, 0]);
        let noisy = way.to_array().map(|component| {
            let noise: f64 = StandardNormal.sample(&mut stream);
            (component + self.std * noise) as f32
        });
        write_action(&mut action, &noisy);
        Ok(())
    }
}
