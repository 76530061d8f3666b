//! A disc in a maze: a force drives it, the floor brakes it, walls stop it. Rapier solves the contacts; nothing is
//! remembered between control steps but place and velocity.

use std::sync::Arc;

use rapier2d_f64::prelude::{ColliderBuilder, IVector, SharedShape, Vector};

use super::layout::{CELL, Layout, center};
use crate::rigid::{Blueprint, Motion, Stage};

/// Duration of a substep, seconds.
const SUBSTEP_S: f64 = 0.02;
/// Substeps per control step.
const SUBSTEPS: u32 = 5;
/// Duration of a control step, seconds.
pub(super) const STEP_S: f64 = SUBSTEP_S * SUBSTEPS as f64;

/// What moves, and how it answers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Disc {
    pub(super) radius: f64,
    pub(super) mass: f64,
    /// Rate at which velocity decays, 1/s.
    pub(super) damping: f64,
    /// Force of an action of 1.
    pub(super) gain: f64,
}

/// A maze in motion. A clone continues exactly as the original does.
pub(super) struct PointSim {
    constants: Arc<Constants>,
    motion: Motion,
    /// Scratch, made when first needed.
    stage: Option<Box<Stage>>,
}

struct Constants {
    disc: Disc,
    blueprint: Blueprint,
}

impl Clone for PointSim {
    fn clone(&self) -> PointSim {
        PointSim { constants: Arc::clone(&self.constants), motion: self.motion, stage: None }
    }
}

impl PointSim {
    /// A maze with a disc at rest in its first cell.
    pub(super) fn new(layout: &Layout, disc: Disc) -> PointSim {
        let mut blueprint = Blueprint::new(SUBSTEP_S, 1.0);
        let voxels: Vec<IVector> =
            layout.wall_cells().map(|[row, col]| IVector::new(col as _, row as _)).collect();
        let [x, y] = center([0, 0]).map(|c| c - CELL / 2.0);
        let walls = ColliderBuilder::new(SharedShape::voxels(Vector::splat(CELL), &voxels));
        blueprint.add_fixed(walls.translation(Vector::new(x, y)).friction(0.0));
        let ball = ColliderBuilder::new(SharedShape::ball(disc.radius)).friction(0.0);
        blueprint.add_moving(disc.mass, None, [ball]);
        PointSim {
            constants: Arc::new(Constants { disc, blueprint }),
            motion: Motion::default(),
            stage: None,
        }
    }

    /// Puts the disc somewhere.
    pub(super) fn place(&mut self, center: [f64; 2], velocity: [f64; 2]) {
        self.motion = Motion { center, velocity, ..Motion::default() };
    }

    /// One control step with an action, `[2]`, each component in [-1, 1].
    pub(super) fn control_step(&mut self, action: [f64; 2]) {
        let PointSim { constants, motion, stage } = self;
        let Constants { disc, blueprint } = &**constants;
        let stage = stage.get_or_insert_with(|| Box::new(Stage::new(blueprint)));
        stage.begin(blueprint, std::slice::from_ref(motion));
        for _ in 0..SUBSTEPS {
            // The drive explicitly, the brake implicitly, as rapier does it for its own forces.
            motion.velocity = [0, 1].map(|axis| {
                let driven = motion.velocity[axis] + SUBSTEP_S * disc.gain / disc.mass * action[axis];
                driven / (1.0 + SUBSTEP_S * disc.damping)
            });
            stage.set_velocity(blueprint, 0, motion);
            stage.step(blueprint, std::slice::from_mut(motion));
        }
    }

    /// Place of the disc's center.
    pub(super) fn position(&self) -> [f64; 2] {
        self.motion.center
    }

    /// Its velocity, length per second.
    pub(super) fn velocity(&self) -> [f64; 2] {
        self.motion.velocity
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::{LAYOUTS, cell_at};
    use super::*;
    use crate::shortest_path::distance;

    const DISC: Disc = Disc { radius: 0.7, mass: 1.0, damping: 2.0, gain: 10.0 };
    const FASTEST: Disc = Disc { radius: 0.3, mass: 0.5, damping: 1.0, gain: 16.0 };

    #[test]
    fn a_free_disc_follows_its_equation_of_motion() {
        let mut sim = PointSim::new(&LAYOUTS[3], DISC);
        let (mut x, mut v) = (0.0, 0.0);
        for _ in 0..20 {
            sim.control_step([0.5, 0.0]);
            for _ in 0..5 {
                v = (v + 0.02 * 10.0 * 0.5) / (1.0 + 0.02 * 2.0);
                x += 0.02 * v;
            }
            assert!((sim.position()[0] - x).abs() < 1e-9 && (sim.velocity()[0] - v).abs() < 1e-9);
            assert_eq!(sim.position()[1], 0.0);
        }
        assert!((v - 2.5).abs() < 0.1, "the terminal velocity is gain · action / (mass · damping): {v}");
    }

    #[test]
    fn walls_stop_even_the_fastest_disc() {
        for layout in LAYOUTS {
            for disc in [DISC, FASTEST] {
                let mut sim = PointSim::new(&layout, disc);
                for step in 0..600 {
                    let (sin, cos) = (f64::from(step / 40) * 1.1).sin_cos();
                    sim.control_step([sin.signum() * sin.abs().sqrt(), cos.signum() * cos.abs().sqrt()]);
                    let place = sim.position();
                    assert!(layout.is_free(cell_at(place)), "{}: {place:?} at step {step}", layout.name);
                    // The nearest point of the walls, over the cells around.
                    let [row, col] = cell_at(place);
                    for near in (-1..=1).flat_map(|r| (-1..=1).map(move |c| [row + r, col + c])) {
                        if !layout.is_free(near) {
                            let wall = center(near);
                            let nearest = [0, 1].map(|axis| {
                                place[axis].clamp(wall[axis] - CELL / 2.0, wall[axis] + CELL / 2.0)
                            });
                            let depth = disc.radius - distance(place, nearest);
                            assert!(depth < 0.1, "{}: {depth} deep at step {step}, {place:?}", layout.name);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn walls_are_smooth_where_cells_meet() {
        let mut sim = PointSim::new(&LAYOUTS[3], DISC);
        sim.place([0.0, -1.3], [0.0, 0.0]);
        for _ in 0..30 {
            let before = sim.velocity()[0];
            sim.control_step([1.0, -1.0]);
            assert!(sim.velocity()[0] > before, "slowed down at {:?}", sim.position());
            assert!(sim.velocity()[1].abs() < 0.1);
        }
        assert!(sim.position()[0] > 8.0);
    }

    #[test]
    fn copies_continue_alike_in_contact() {
        let mut sim = PointSim::new(&LAYOUTS[0], DISC);
        for step in 0..80 {
            let action = [(f64::from(step) * 0.21).sin(), (f64::from(step) * 0.13).cos()];
            let mut copy = sim.clone();
            sim.control_step(action);
            copy.control_step(action);
            assert_eq!(sim.motion, copy.motion, "step {step}");
        }
    }
}
