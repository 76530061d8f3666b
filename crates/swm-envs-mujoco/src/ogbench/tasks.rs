//! The five tasks of each table, as constants: where things start, and where they belong. Numbers of the reference.

use super::layout::Kind;

/// A task.
#[derive(Debug)]
pub(super) struct Task {
    /// Where things start, but for a little noise.
    pub(super) start: Arrangement,
    /// Where they belong.
    pub(super) goal: Arrangement,
}

/// Where everything is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrangement {
    /// Where the cubes are.
    pub(super) cubes: &'static [Spot],
    /// States of the buttons; 1 unlocks.
    pub(super) buttons: [u8; 2],
    /// Position of the drawer, m: -0.16 is open.
    pub(super) drawer: f64,
    /// Position of the window, m: 0.2 is open.
    pub(super) window: f64,
}

/// Where a cube is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spot {
    /// x, y, m.
    pub(super) at: [f64; 2],
    /// What it rests on.
    pub(super) on: Support,
}

/// What a cube rests on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Support {
    /// So many other cubes.
    Cubes(u8),
    /// The bottom of the drawer.
    Drawer,
}

impl Spot {
    /// The height of the middle of a cube with this half side, m.
    pub(super) fn height(self, half: f64) -> f64 {
        match self.on {
            Support::Cubes(below) => half + 2.0 * half * f64::from(below),
            Support::Drawer => DRAWER_BOTTOM + half,
        }
    }
}

/// The bottom of the drawer, m.
const DRAWER_BOTTOM: f64 = 0.045986;

/// The five tasks of a table.
pub(super) fn tasks(kind: Kind) -> &'static [Task; 5] {
    match kind {
        Kind::Cubes(1) => &SINGLE,
        Kind::Cubes(2) => &DOUBLE,
        Kind::Cubes(3) => &TRIPLE,
        Kind::Cubes(_) => &QUADRUPLE,
        Kind::Scene => &SCENE,
    }
}

const fn on(x: f64, y: f64) -> Spot {
    Spot { at: [x, y], on: Support::Cubes(0) }
}

const fn up(below: u8, x: f64, y: f64) -> Spot {
    Spot { at: [x, y], on: Support::Cubes(below) }
}

const fn cubes(start: &'static [Spot], goal: &'static [Spot]) -> Task {
    const fn only(cubes: &'static [Spot]) -> Arrangement {
        Arrangement { cubes, buttons: [0; 2], drawer: 0.0, window: 0.0 }
    }
    Task { start: only(start), goal: only(goal) }
}

/// Onto its side, away, back, and both diagonals.
static SINGLE: [Task; 5] = [
    cubes(&[on(0.425, 0.1)], &[on(0.425, -0.1)]),
    cubes(&[on(0.35, 0.0)], &[on(0.5, 0.0)]),
    cubes(&[on(0.5, 0.0)], &[on(0.35, 0.0)]),
    cubes(&[on(0.35, -0.2)], &[on(0.5, 0.2)]),
    cubes(&[on(0.35, 0.2)], &[on(0.5, -0.2)]),
];

/// One cube, two cubes twice, a swap, a stack.
static DOUBLE: [Task; 5] = [
    cubes(&[on(0.425, 0.0), on(0.425, -0.1)], &[on(0.425, 0.0), on(0.425, 0.1)]),
    cubes(&[on(0.35, -0.1), on(0.5, -0.1)], &[on(0.35, 0.1), on(0.5, 0.1)]),
    cubes(&[on(0.35, 0.0), on(0.5, 0.0)], &[on(0.425, -0.2), on(0.425, 0.2)]),
    cubes(&[on(0.425, -0.1), on(0.425, 0.1)], &[on(0.425, 0.1), on(0.425, -0.1)]),
    cubes(&[on(0.425, -0.2), on(0.425, 0.2)], &[on(0.425, 0.0), up(1, 0.425, 0.0)]),
];

/// One cube, three cubes, from a stack, around, a stack.
static TRIPLE: [Task; 5] = [
    cubes(&[on(0.35, -0.1), on(0.35, 0.1), on(0.5, -0.1)], &[on(0.35, -0.1), on(0.35, 0.1), on(0.5, 0.1)]),
    cubes(&[on(0.35, -0.2), on(0.35, 0.0), on(0.35, 0.2)], &[on(0.5, 0.0), on(0.5, 0.2), on(0.5, -0.2)]),
    cubes(
        &[on(0.425, 0.2), up(1, 0.425, 0.2), up(2, 0.425, 0.2)],
        &[on(0.35, -0.1), on(0.5, -0.2), on(0.5, 0.0)],
    ),
    cubes(&[on(0.35, 0.0), on(0.5, -0.1), on(0.5, 0.1)], &[on(0.5, -0.1), on(0.5, 0.1), on(0.35, 0.0)]),
    cubes(
        &[on(0.35, -0.1), on(0.5, -0.2), on(0.5, 0.0)],
        &[on(0.425, 0.2), up(1, 0.425, 0.2), up(2, 0.425, 0.2)],
    ),
];

/// Two cubes, four cubes, from a square, around, a stack.
static QUADRUPLE: [Task; 5] = [
    cubes(
        &[on(0.35, -0.1), on(0.35, 0.1), on(0.5, -0.1), on(0.5, 0.1)],
        &[on(0.35, -0.25), on(0.35, 0.1), on(0.5, -0.1), on(0.5, 0.25)],
    ),
    cubes(
        &[on(0.325, -0.2), on(0.325, 0.2), on(0.525, -0.2), on(0.525, 0.2)],
        &[on(0.375, 0.1), on(0.475, 0.1), on(0.375, -0.1), on(0.475, -0.1)],
    ),
    cubes(
        &[on(0.425, -0.02), on(0.425, 0.02), up(1, 0.425, -0.02), up(1, 0.425, 0.02)],
        &[on(0.525, -0.2), on(0.325, 0.2), on(0.325, -0.2), on(0.525, 0.2)],
    ),
    cubes(
        &[on(0.525, -0.1), on(0.525, 0.1), on(0.325, 0.1), on(0.325, -0.1)],
        &[on(0.525, 0.1), on(0.325, 0.1), on(0.325, -0.1), on(0.525, -0.1)],
    ),
    cubes(
        &[on(0.5, -0.05), on(0.5, -0.2), on(0.35, -0.2), on(0.35, -0.05)],
        &[on(0.425, 0.2), up(1, 0.425, 0.2), up(2, 0.425, 0.2), up(3, 0.425, 0.2)],
    ),
];

const IN_DRAWER: Spot = Spot { at: [0.33, -0.356], on: Support::Drawer };

const OPEN_DRAWER: f64 = -0.16;
const OPEN_WINDOW: f64 = 0.2;

const fn scene(start: Arrangement, goal: Arrangement) -> Task {
    Task { start, goal }
}

/// Open both, unlock and close both, rearrange, put the cube into the drawer, everything.
static SCENE: [Task; 5] = [
    scene(
        Arrangement { cubes: &[on(0.35, 0.05)], buttons: [1, 1], drawer: 0.0, window: 0.0 },
        Arrangement { cubes: &[on(0.35, 0.05)], buttons: [1, 1], drawer: OPEN_DRAWER, window: OPEN_WINDOW },
    ),
    scene(
        Arrangement { cubes: &[on(0.35, -0.05)], buttons: [0, 0], drawer: OPEN_DRAWER, window: OPEN_WINDOW },
        Arrangement { cubes: &[on(0.35, -0.05)], buttons: [0, 0], drawer: 0.0, window: 0.0 },
    ),
    scene(
        Arrangement { cubes: &[on(0.4, -0.05)], buttons: [1, 0], drawer: 0.0, window: OPEN_WINDOW },
        Arrangement { cubes: &[on(0.4, 0.15)], buttons: [1, 1], drawer: OPEN_DRAWER, window: 0.0 },
    ),
    scene(
        Arrangement { cubes: &[on(0.35, 0.05)], buttons: [0, 0], drawer: 0.0, window: 0.0 },
        Arrangement { cubes: &[IN_DRAWER], buttons: [1, 0], drawer: 0.0, window: 0.0 },
    ),
    scene(
        Arrangement { cubes: &[on(0.35, 0.15)], buttons: [0, 0], drawer: 0.0, window: 0.0 },
        Arrangement { cubes: &[IN_DRAWER], buttons: [0, 0], drawer: 0.0, window: OPEN_WINDOW },
    ),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_places_every_cube() {
        for kind in [Kind::Cubes(1), Kind::Cubes(2), Kind::Cubes(3), Kind::Cubes(4), Kind::Scene] {
            for task in tasks(kind) {
                assert_eq!([task.start.cubes.len(), task.goal.cubes.len()], [kind.cubes(); 2]);
            }
        }
        assert_eq!(up(2, 0.0, 0.0).height(0.02), 0.1);
        assert!((IN_DRAWER.height(0.02) - 0.065986).abs() < 1e-12);
    }
}
