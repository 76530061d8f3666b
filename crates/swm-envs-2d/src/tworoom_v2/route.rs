//! The way to the target: through which door, how long, and where to head now. For the expert, the task's cost, and the
//! factor `task.min_steps`. It knows nothing of noise or steps.
//!
//! Where an agent's center may be consists of rectangles: two rooms, and a passage for each door. Between two of them it
//! passes gates, segments of the lines where wall and rooms meet; the shortest way is pulled taut through these.

use super::room::{Door, Room, SUCCESS_PX, WALL_CENTER_PX, distance};

/// The way from a place to the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Way {
    /// Where to head, in a straight line.
    pub(super) next: [f64; 2],
    /// Pixels to the target, or to the place nearest to it and from there.
    pub(super) length: f64,
    /// Whether it ends near enough to the target for success.
    pub(super) succeeds: bool,
}

/// A way is planned this far from the edges of doors, so that rounding does not lead into the wall.
const CLEARANCE_PX: f64 = 0.25;
/// A way ends this far before the wall: a step that rounding carries into the wall is put back by more than that.
const SHORT_OF_WALL_PX: f64 = 1e-3;
/// A gate is passed when it is so near.
const AT_GATE_PX: f64 = 1e-3;
/// What success needs, less something for rounding.
const NEAR_PX: f64 = SUCCESS_PX - 0.1;
/// More rounds than this change the length of a taut way by less than a thousandth of a pixel.
const PULLS: usize = 4;

/// A convex part of the free space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// The room with the smaller coordinate across the wall.
    Low,
    /// The room with the larger one.
    High,
    /// The passage of door `i`.
    Passage(usize),
}

/// A place, as coordinates across and along the wall.
type Place = [f64; 2];

/// A segment along the wall that a way passes.
#[derive(Clone, Copy, Debug)]
struct Gate {
    across: f64,
    along: [f64; 2],
}

/// The shortest way from `from` to `target`. Where none leads near enough for success, one that ends as near as
/// possible; where the rooms are not connected, one that ignores it.
pub(super) fn way(room: &Room, from: [f64; 2], target: [f64; 2]) -> Way {
    let apart = distance(from, target);
    if apart < NEAR_PX {
        return Way { next: target, length: apart, succeeds: true };
    }
    let map = Map::new(room);
    let place = |position: [f64; 2]| [room.across(position), room.along(position)];
    let (from, target) = (place(from), place(target));
    let start = map.part_of(from);
    let mut best: Option<(f64, f64, [f64; 2])> = None;
    for end in map.parts() {
        let goal = map.nearest(end, target);
        let short_of = distance(goal, target);
        // All ends that are near enough are equally good.
        let miss = if short_of < NEAR_PX { 0.0 } else { short_of };
        map.for_each_path(start, end, |gates| {
            let (next, length) = pull(from, gates, goal);
            let length = length + short_of;
            if best.is_none_or(|(least, shortest, _)| (miss, length) < (least, shortest)) {
                best = Some((miss, length, next));
            }
        });
    }
    let (miss, length, [across, along]) = best.expect("the part that it starts in can be its end");
    Way { next: room.position(across, along), length, succeeds: miss == 0.0 }
}

/// The free space of a room.
struct Map {
    limits: [f64; 2],
    wall: [f64; 2],
    /// Where doors can be passed, along the wall; `None` for one out of reach.
    passages: [Option<[f64; 2]>; 3],
}

impl Map {
    fn new(room: &Room) -> Self {
        let limits @ [least, most] = room.limits();
        let passage = |door: &Door| {
            let [from, to] = door.opening();
            let passage = [(from + CLEARANCE_PX).max(least), (to - CLEARANCE_PX).min(most)];
            (passage[0] <= passage[1]).then_some(passage)
        };
        let mut passages = [None; 3];
        for (slot, door) in passages.iter_mut().zip(room.doors()) {
            *slot = passage(door);
        }
        Self { limits, wall: room.wall(), passages }
    }

    fn open(&self) -> impl Iterator<Item = (usize, [f64; 2])> {
        self.passages.iter().enumerate().filter_map(|(index, passage)| Some((index, (*passage)?)))
    }

    fn parts(&self) -> impl Iterator<Item = Part> {
        [Part::Low, Part::High].into_iter().chain(self.open().map(|(index, _)| Part::Passage(index)))
    }

    /// The part that an agent is in; inside the wall, the room that a step puts it into.
    fn part_of(&self, [across, along]: Place) -> Part {
        let [low, high] = self.wall;
        // A place on the border may lie beyond it by a rounding.
        let along = along.clamp(self.limits[0], self.limits[1]);
        let passage = || self.open().find(|(_, [from, to])| (*from..=*to).contains(&along));
        match across {
            x if x <= low => Part::Low,
            x if x >= high => Part::High,
            x => match passage() {
                Some((index, _)) => Part::Passage(index),
                None if x < WALL_CENTER_PX => Part::Low,
                None => Part::High,
            },
        }
    }

    /// The place of a part that is nearest to `target`.
    fn nearest(&self, part: Part, [across, along]: Place) -> Place {
        let ([least, most], [low, high]) = (self.limits, self.wall);
        match part {
            Part::Low => [across.clamp(least, low - SHORT_OF_WALL_PX), along.clamp(least, most)],
            Part::High => [across.clamp(high + SHORT_OF_WALL_PX, most), along.clamp(least, most)],
            Part::Passage(index) => {
                let [from, to] = self.passages[index].unwrap_or([along, along]);
                [across.clamp(low, high), along.clamp(from, to)]
            }
        }
    }

    /// Calls `path` with the gates of every way from one part to another that is worth a look.
    fn for_each_path(&self, start: Part, end: Part, mut path: impl FnMut(&[Gate])) {
        let [low, high] = self.wall;
        let gate = |across: f64, index: usize| self.passages[index].map(|along| Gate { across, along });
        let mut through = |gates: [Option<Gate>; 2]| match gates {
            [Some(first), Some(second)] => path(&[first, second]),
            [Some(only), None] => path(&[only]),
            _ => {}
        };
        match (start, end) {
            _ if start == end => path(&[]),
            (Part::Passage(from), Part::Passage(to)) => {
                through([gate(low, from), gate(low, to)]);
                through([gate(high, from), gate(high, to)]);
            }
            (Part::Low, Part::Passage(door)) | (Part::Passage(door), Part::Low) => {
                through([gate(low, door), None]);
            }
            (Part::High, Part::Passage(door)) | (Part::Passage(door), Part::High) => {
                through([gate(high, door), None]);
            }
            (Part::Low, _) => (0..3).for_each(|door| through([gate(low, door), gate(high, door)])),
            (Part::High, _) => (0..3).for_each(|door| through([gate(high, door), gate(low, door)])),
        }
    }
}

/// Pulls a way taut: where to head first, and its length.
fn pull(from: Place, gates: &[Gate], goal: Place) -> (Place, f64) {
    let mut places = [from, from, from, goal];
    let last = gates.len() + 1;
    places[last] = goal;
    for (index, gate) in gates.iter().enumerate() {
        places[index + 1] = [gate.across, goal[1].clamp(gate.along[0], gate.along[1])];
    }
    for _ in 0..if gates.len() > 1 { PULLS } else { 1 } {
        for (index, gate) in gates.iter().enumerate() {
            let along = gate.crossing(places[index], places[index + 2]);
            places[index + 1][1] = along.clamp(gate.along[0], gate.along[1]);
        }
    }
    let length = places[..=last].windows(2).map(|pair| distance(pair[0], pair[1])).sum();
    // The first corner: a gate that the straight line to the next place does not pass, and that is still ahead.
    let is_passed = |index: &usize| {
        let gate = &gates[*index];
        let (here, beyond) = (from, places[index + 2]);
        let crosses = (here[0] - gate.across) * (beyond[0] - gate.across) <= 0.0;
        let along = gate.crossing(here, beyond);
        distance(from, places[index + 1]) < AT_GATE_PX
            || crosses && (gate.along[0]..=gate.along[1]).contains(&along)
    };
    let corner = (0..gates.len()).find(|index| !is_passed(index)).unwrap_or(gates.len());
    (places[corner + 1], length)
}

impl Gate {
    /// Where the shortest line from `a` to `b` by way of the gate's whole line meets it: straight, or mirrored if both
    /// lie on one side.
    fn crossing(&self, a: Place, b: Place) -> f64 {
        let (from_a, from_b) = ((a[0] - self.across).abs(), (b[0] - self.across).abs());
        if from_a + from_b == 0.0 { b[1] } else { a[1] + (b[1] - a[1]) * from_a / (from_a + from_b) }
    }
}
