//! Recorded trajectories of the reference, substep by substep; see `tests/golden/pusht/README.md`.

use super::super::*;
use ndarray::{Array1, Array2};
use ndarray_npy::{NpzReader, ReadableElement};
use std::fs::File;

const PIXELS: f64 = 1.0e-6;
const RADIANS: f64 = 1.0e-8;

struct Recording(NpzReader<File>);

impl Recording {
    fn open(name: &str) -> Recording {
        let path = format!("{}/../../tests/golden/pusht/{name}.npz", env!("CARGO_MANIFEST_DIR"));
        Recording(NpzReader::new(File::open(&path).expect(&path)).unwrap())
    }

    fn list<T: ReadableElement>(&mut self, sequence: usize, name: &str) -> Array1<T> {
        self.0.by_name(&format!("{sequence:02}_{name}")).unwrap()
    }

    fn table<T: ReadableElement>(&mut self, sequence: usize, name: &str) -> Array2<T> {
        self.0.by_name(&format!("{sequence:02}_{name}")).unwrap()
    }

    fn state(&mut self, sequence: usize, name: &str) -> [f64; 7] {
        self.list::<f64>(sequence, name).to_vec().try_into().unwrap()
    }
}

fn body(setup: &[f64]) -> BodySetup {
    BodySetup {
        shape: Shape::from_index(setup[0] as usize).unwrap(),
        scale: setup[1] as f32,
        position: [setup[2], setup[3]],
        angle: setup[4],
    }
}

/// Replays all sequences of a file and compares every substep.
fn check(name: &str, sequences: usize) {
    let mut recording = Recording::open(name);
    for sequence in 0..sequences {
        let setup = recording.list::<f64>(sequence, "setup").to_vec();
        let (agent, block) = (body(&setup[..5]), body(&setup[5..]));
        let mut sim = Sim::new(&Setup { agent, block, ..Setup::default() }).unwrap();

        sim.place(&Placement::from(recording.state(sequence, "goal_state"))).unwrap();
        sim.substep();
        let [(x, y), (bx, by)] = [agent, block].map(|body| (body.position[0], body.position[1]));
        sim.place(&Placement::from([x, y, bx, by, block.angle])).unwrap();
        sim.substep();
        let after = recording.state(sequence, "after_reset");
        let [agent, block] = [BodyId::Agent, BodyId::Block].map(|body| sim.position(body));
        for (ours, theirs) in [agent[0], agent[1], block[0], block[1]].iter().zip(after) {
            assert!((ours - theirs).abs() < PIXELS, "{name} {sequence}: reset gives {ours}, not {theirs}");
        }

        let actions = recording.table::<f32>(sequence, "actions");
        let substeps = recording.table::<f64>(sequence, "sub");
        let points = recording.list::<u8>(sequence, "sub_contacts");
        let counts = recording.list::<u8>(sequence, "n_contacts");
        let mut row = 0;
        for (step, action) in actions.rows().into_iter().enumerate() {
            let total =
                sim.control_step_with([action[0], action[1]], ActionMode::Relative, |sim, now| {
                    for (body, first) in [(BodyId::Agent, 0), (BodyId::Block, 6)] {
                        let ([x, y], angle) = (sim.position(body), sim.angle(body));
                        for (ours, column, tolerance) in [(x, 0, PIXELS), (y, 1, PIXELS), (angle, 2, RADIANS)]
                        {
                            let theirs = substeps[[row, first + column]];
                            assert!(
                                (ours - theirs).abs() < tolerance,
                                "{name} {sequence}, substep {row}, {body:?}, column {column}: {ours}, not {theirs}"
                            );
                        }
                        let ([vx, vy], w) = (sim.velocity(body), sim.angular_velocity(body));
                        for (ours, column) in [(vx, 3), (vy, 4), (w, 5)] {
                            let theirs = substeps[[row, first + column]];
                            assert!((ours - theirs).abs() < 1.0e-6, "{name} {sequence}, substep {row}: velocity");
                        }
                    }
                    assert_eq!(now, u32::from(points[row]), "{name} {sequence}, substep {row}: contact points");
                    row += 1;
                });
            assert_eq!(
                contact_count(total),
                u32::from(counts[step]),
                "{name} {sequence}, step {step}: contacts"
            );
        }
        assert_eq!(row, substeps.nrows());
    }
}

#[test]
fn the_disc_and_the_t_follow_the_reference() {
    check("disc_t", 20);
}

#[test]
fn all_shapes_follow_the_reference() {
    check("shapes", 23);
}
