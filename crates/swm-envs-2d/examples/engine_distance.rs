//! How far `swm/PushTRapier-v0` is from `swm/PushT-v1`: the golden action sequences from the same starts on both
//! engines, and how far the blocks are apart after 10, 25, 50 and 100 control steps. The page of the environment quotes
//! what this prints: `cargo run --release -p swm-envs-2d --example engine_distance`.

use std::error::Error;
use std::fs::File;

use ndarray::{Array1, Array2};
use ndarray_npy::NpzReader;
use swm_envs_2d::pusht::physics::{ActionMode, BodyId, BodySetup, Placement, RapierSim, Setup, Shape, Sim};
use swm_envs_2d::pusht::{Engine, angle_error};

/// Control steps after which the engines are compared.
const STEPS: [usize; 4] = [10, 25, 50, 100];

/// One golden sequence.
struct Sequence {
    setup: Setup,
    start: [f64; 7],
    actions: Vec<[f32; 2]>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut sequences = read("disc_t", 20)?;
    sequences.extend(read("shapes", 23)?);
    for (name, wanted) in [("disc agent", true), ("polygon agent", false)] {
        let chosen: Vec<&Sequence> =
            sequences.iter().filter(|s| (s.setup.agent.shape == Shape::Disc) == wanted).collect();
        println!("{name}, {} sequences", chosen.len());
        println!(
            "| friction | steps | sequences | block path, px | median, px | 90 %, px | median, deg | 90 %, deg |"
        );
        println!("|---|---|---|---|---|---|---|---|");
        for friction in [RapierSim::FRICTION, 0.0] {
            report(&chosen, friction)?;
        }
    }
    Ok(())
}

/// Prints a row per number of steps: how far the block went on PushT-v1, and how far apart the engines are.
fn report(sequences: &[&Sequence], friction: f64) -> Result<(), Box<dyn Error>> {
    let mut rows: [[Vec<f64>; 3]; STEPS.len()] = Default::default();
    for sequence in sequences {
        let plain = run::<Sim>(sequence, 0.0)?;
        let other = run::<RapierSim>(sequence, friction)?;
        for (row, &step) in rows.iter_mut().zip(&STEPS) {
            let (Some(a), Some(b)) = (plain.get(step), other.get(step)) else { continue };
            let way = distance(&plain[0], a);
            let angle = angle_error(sequence.setup.block.shape, a[2], b[2]).to_degrees();
            for (column, value) in row.iter_mut().zip([way, distance(a, b), angle]) {
                column.push(value);
            }
        }
    }
    for (row, step) in rows.iter_mut().zip(STEPS) {
        let [way, px, degrees] = row;
        if !way.is_empty() {
            println!(
                "| {friction} | {step} | {} | {:.1} | {:.2} | {:.1} | {:.2} | {:.1} |",
                way.len(),
                quantile(way, 0.5),
                quantile(px, 0.5),
                quantile(px, 0.9),
                quantile(degrees, 0.5),
                quantile(degrees, 0.9),
            );
        }
    }
    Ok(())
}

/// Block x, y and angle after every control step, the start first.
fn run<E: Engine>(sequence: &Sequence, friction: f64) -> Result<Vec<[f64; 3]>, Box<dyn Error>> {
    let mut sim = E::new(&Setup { friction, ..sequence.setup })?;
    let agent_angle = Some(sequence.setup.agent.angle);
    sim.place_exactly(&Placement { agent_angle, ..Placement::from(sequence.start) })?;
    let pose = |sim: &E| {
        let [x, y] = sim.position(BodyId::Block);
        [x, y, sim.angle(BodyId::Block)]
    };
    let mut poses = vec![pose(&sim)];
    for &action in &sequence.actions {
        sim.control_step(action, ActionMode::Relative);
        poses.push(pose(&sim));
    }
    Ok(poses)
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}

fn read(name: &str, count: usize) -> Result<Vec<Sequence>, Box<dyn Error>> {
    let path = format!("{}/../../tests/golden/pusht/{name}.npz", env!("CARGO_MANIFEST_DIR"));
    let mut file = NpzReader::new(File::open(path)?)?;
    let body = |values: &[f64]| BodySetup {
        shape: Shape::from_index(values[0] as usize).unwrap_or(Shape::T),
        scale: values[1] as f32,
        position: [values[2], values[3]],
        angle: values[4],
    };
    (0..count)
        .map(|index| {
            let setup: Array1<f64> = file.by_name(&format!("{index:02}_setup"))?;
            let start: Array1<f64> = file.by_name(&format!("{index:02}_after_reset"))?;
            let actions: Array2<f32> = file.by_name(&format!("{index:02}_actions"))?;
            let setup = setup.to_vec();
            Ok(Sequence {
                setup: Setup { agent: body(&setup[..5]), block: body(&setup[5..]), ..Setup::default() },
                start: start.to_vec().try_into().map_err(|_| "a start has seven values")?,
                actions: actions.rows().into_iter().map(|row| [row[0], row[1]]).collect(),
            })
        })
        .collect()
}
