//! The recordings of the reference, replayed with the noise that it drew.

use std::fs::File;
use std::io::Cursor;

use ndarray::{Array2, ArrayD, IxDyn, OwnedRepr, s};
use ndarray_npy::{NpzReader, ReadableElement};
use swm_core::env::{PIXELS, ResetOptions};
use swm_core::{Batch, Env, EnvConfig, Episode, EpisodeSeed, ImageSize, Schema, Value};
use swm_fov::FactorEnv;

use super::super::env::RocketLanding;
use super::super::state::State;

/// Free flight.
const FLIGHT: f64 = 1e-9;
/// Restoring the state after its goal image disturbs the reference's first step.
const DISTURBED: f64 = 1e-5;
/// Heights after a contact, whose solvers differ, m.
const CONTACT_M: f64 = 5e-3;

/// Columns of the physics, and those of the observation that equal them: position, ignition, fins, gimbal, throttle, fuel.
const OBSERVED: [(usize, usize); 12] = [
    (0, 10),
    (1, 11),
    (2, 12),
    (17, 16),
    (21, 20),
    (22, 21),
    (23, 22),
    (24, 23),
    (25, 27),
    (26, 28),
    (27, 26),
    (28, 25),
];

struct Recordings {
    npz: NpzReader<File>,
    names: Vec<String>,
}

impl Recordings {
    fn open() -> Self {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/golden/rocket/PFRocketLanding.npz");
        let mut npz = NpzReader::new(File::open(path).expect(path)).unwrap();
        let names = npz.names().unwrap();
        Self { npz, names: names.iter().map(|name| name.trim_end_matches(".npy").to_owned()).collect() }
    }

    fn runs(&self, kind: &str) -> Vec<String> {
        let actions = self.names.iter().filter_map(|name| name.strip_suffix("/actions"));
        actions.filter(|run| run.starts_with(kind)).map(str::to_owned).collect()
    }

    fn array<T: ReadableElement>(&mut self, run: &str, name: &str) -> ArrayD<T> {
        self.npz.by_name::<OwnedRepr<T>, IxDyn>(&format!("{run}/{name}")).unwrap()
    }

    fn list<T: ReadableElement + Clone>(&mut self, run: &str, name: &str) -> Vec<T> {
        self.array::<T>(run, name).iter().cloned().collect()
    }

    fn table<T: ReadableElement>(&mut self, run: &str, name: &str) -> Array2<T> {
        self.array::<T>(run, name).into_dimensionality().unwrap()
    }

    /// The state of the physics by rows: what the observation does not have of it is recorded beside.
    fn physics(&mut self, run: &str) -> Array2<f64> {
        let (motion, observed) = (self.table::<f64>(run, "motion"), self.table::<f64>(run, "obs"));
        let mut physics = Array2::zeros((motion.nrows(), 29));
        physics.slice_mut(s![.., 3..13]).assign(&motion);
        for (to, from) in OBSERVED {
            physics.column_mut(to).assign(&observed.slice(s![..motion.nrows(), from]));
        }
        physics
    }

    /// The factors in force.
    fn options(&mut self, run: &str) -> ResetOptions {
        let mut options = ResetOptions::default().vary(["none"]);
        let prefix = format!("{run}/fov.");
        let set = self.names.iter().filter_map(|name| name.strip_prefix(&prefix)).map(str::to_owned);
        for factor in set.filter(|name| name != "environment.sky_color").collect::<Vec<_>>() {
            let name = format!("fov.{factor}");
            options = match factor.as_str() {
                color if color.ends_with("color") => {
                    options.set(&factor, Value::vector(&self.list::<u8>(run, &name)))
                }
                "environment.start_height_ratio" => {
                    options.set(&factor, Value::scalar(self.list::<f64>(run, &name)[0]))
                }
                _ => options.set(&factor, Value::vector(&self.list::<f32>(run, &name))),
            };
        }
        options
    }
}

/// The state of a row of the recorded physics, in the lagging attitude of another row.
fn state(row: &[f64], before: &[f64]) -> State {
    let mut state = State::at_rest(array(&row[..3]), array(&row[3..7]), row[28]);
    state.velocity = array(&row[7..10]);
    state.spin = array(&row[10..13]);
    state.fins = array(&row[21..25]);
    state.gimbal = array(&row[25..27]);
    state.throttle = row[27];
    state.lagging_attitude = array(&before[3..7]);
    state
}

fn array<const N: usize>(values: &[f64]) -> [f64; N] {
    values.try_into().unwrap()
}

/// The largest difference between a state and a row of the recorded physics.
fn difference(state: &State, row: &[f64]) -> f64 {
    let recorded = self::state(row, row);
    let sign: f64 = state.attitude.iter().zip(recorded.attitude).map(|(a, b)| a * b).sum::<f64>().signum();
    let mut ours = *state;
    ours.attitude = ours.attitude.map(|part| part * sign);
    let values = |state: &State| {
        let State { position, attitude, velocity, spin, fins, gimbal, throttle, fuel, .. } = *state;
        [&position[..], &attitude, &velocity, &spin, &fins, &gimbal, &[throttle, fuel]].concat()
    };
    largest(&values(&ours), &values(&recorded))
}

fn largest(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

struct Bench {
    env: FactorEnv<RocketLanding>,
    row: Batch,
}

impl Bench {
    fn new(image: Option<ImageSize>) -> Self {
        let env = FactorEnv::<RocketLanding>::new(&EnvConfig { image, ..EnvConfig::default() }).unwrap();
        let row = Batch::new(Schema::new(env.spec().fields.clone()).unwrap(), 1);
        Self { env, row }
    }

    fn reset(&mut self, options: &ResetOptions) {
        self.env.reset(&Episode::new(EpisodeSeed::new(0), options)).unwrap();
        self.env.write_episode(&mut self.row.rows_mut());
        self.env.observe(&mut self.row.rows_mut());
    }

    fn values(&mut self, column: &str) -> Vec<f64> {
        self.env.observe(&mut self.row.rows_mut());
        self.row.get::<f64>(column).unwrap().to_vec()
    }

    fn flags(&self) -> Vec<bool> {
        let flag = |column: &str| self.row.get::<bool>(column).unwrap()[0];
        ["out_of_bounds", "fatal_collision", "env_complete"].map(flag).to_vec()
    }
}

/// What a replay differed by: the state and the observation, the reward; before and after the first contact.
#[derive(Debug, Default)]
struct Differences {
    flight: f64,
    reward: f64,
    height_in_contact: f64,
}

/// Replays a run from its first row on and checks its flags.
fn replay(recordings: &mut Recordings, run: &str) -> Differences {
    let physics = recordings.physics(run);
    let reset: Array2<f64> = recordings.table(run, "physics_reset");
    let actions: Array2<f64> = recordings.table(run, "actions");
    let observations: Array2<f64> = recordings.table(run, "obs");
    let info: Array2<bool> = recordings.table(run, "info_out_fatal_complete");
    let rewards = recordings.list::<f64>(run, "reward");
    let [terminated, truncated] = ["terminated", "truncated"].map(|name| recordings.list::<bool>(run, name));
    let mut noise = recordings.list::<f64>(run, "noise");
    noise.resize(6 * actions.nrows(), 0.0);
    let mut bench = Bench::new(None);
    bench.reset(&recordings.options(run));
    let row = |table: &Array2<f64>, index: usize| table.row(index).to_vec();
    bench.env.parts_mut().1.state = state(&row(&physics, 0), &row(&reset, 1));
    let mut found = Differences::default();
    let mut touched = false;
    for t in 0..actions.nrows() {
        let (scene, moving) = bench.env.parts_mut();
        let reward = scene.step_with(moving, &array(&row(&actions, t)), &array(&noise[6 * t..6 * t + 6]));
        let ours = bench.env.parts_mut().1.state;
        let observed = bench.values("observation");
        let recorded = row(&observations, t + 1);
        touched |= info.row(t).iter().any(|flag| *flag) && ours.position[2] < 4.0;
        if touched {
            found.height_in_contact = found.height_in_contact.max((observed[12] - recorded[12]).abs());
        } else {
            found.flight = found.flight.max(largest(&observed, &recorded));
            found.reward = found.reward.max((reward - rewards[t]).abs());
            if t + 1 < physics.nrows() {
                found.flight = found.flight.max(difference(&ours, &row(&physics, t + 1)));
            }
        }
        assert_eq!(bench.flags(), info.row(t).to_vec(), "{run}, step {t}");
        let ends = (bench.flags()[0] || bench.flags()[1], bench.env.is_truncated());
        assert_eq!(ends, (terminated[t], truncated[t]), "{run}, step {t}");
    }
    println!("{run}: {} steps, {found:?}", actions.nrows());
    found
}

#[test]
fn recorded_flights_are_replayed() {
    let mut recordings = Recordings::open();
    let mut count = 0;
    for kind in ["quiet", "default", "varied", "landing"] {
        for run in recordings.runs(kind) {
            let tolerance =
                if ["varied_seed0", "varied_seed1"].contains(&run.as_str()) { DISTURBED } else { FLIGHT };
            let found = replay(&mut recordings, &run);
            assert!(found.flight <= tolerance, "{run}: {found:?}");
            // Ten times a distance, and speeds times four.
            assert!(found.reward <= 100.0 * tolerance, "{run}: {found:?}");
            assert!(found.height_in_contact <= CONTACT_M, "{run}: {found:?}");
            count += 1;
        }
    }
    assert!(count >= 14, "{count} runs");
}

#[test]
fn recorded_contacts_end_in_the_same_step() {
    let mut recordings = Recordings::open();
    let runs = recordings.runs("contact");
    assert!(runs.len() >= 3, "{runs:?}");
    for run in runs {
        let found = replay(&mut recordings, &run);
        assert!(found.flight <= FLIGHT && found.height_in_contact <= CONTACT_M, "{run}: {found:?}");
    }
}

#[test]
fn recorded_starts_follow_from_their_factors() {
    let mut recordings = Recordings::open();
    let mut bench = Bench::new(None);
    for run in [recordings.runs("default"), recordings.runs("varied")].concat() {
        bench.reset(&recordings.options(&run));
        let reset: Array2<f64> = recordings.table(&run, "physics_reset");
        let [before, last] = [1, 2].map(|index| reset.row(index).to_vec());
        let ours = bench.env.parts_mut().1.state;
        let found = difference(&ours, &last);
        assert!(found <= FLIGHT, "{run}: {found:e}, {ours:?} instead of {last:?}");
        let lag = largest(&ours.lagging_attitude, &state(&last, &before).lagging_attitude);
        assert!(lag <= FLIGHT, "{run}: the lagging attitude is off by {lag:e}");
    }
}

/// Means of squares of `side` pixels of a 480 × 480 image.
fn coarse(rgb: &[u8], side: usize) -> Vec<f64> {
    let cells = 480 / side;
    let mut sums = vec![0.0; cells * cells * 3];
    for (at, value) in rgb.iter().enumerate() {
        let (row, column, channel) = (at / 1440 / side, at % 1440 / 3 / side, at % 3);
        sums[(row * cells + column) * 3 + channel] += f64::from(*value) / (side * side) as f64;
    }
    sums
}

fn mean_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>() / a.len() as f64
}

#[test]
fn images_look_like_the_references() {
    let mut recordings = Recordings::open();
    let names: Vec<String> = recordings.names.iter().filter(|name| name.ends_with("_png")).cloned().collect();
    assert!(names.len() >= 7, "{names:?}");
    let mut bench = Bench::new(Some(ImageSize { height: 480, width: 480 }));
    for name in names {
        let (run, image) = name.split_once('/').unwrap();
        let step: usize = image.trim_start_matches("img_").trim_end_matches("_png").parse().unwrap();
        bench.reset(&recordings.options(run));
        let physics = recordings.physics(run);
        let row = physics.row(step).to_vec();
        let ours = &mut bench.env.parts_mut().1.state;
        *ours = state(&row, &row);
        ours.action[3] = row[17];
        if step == 0 {
            // The reference's camera lags behind the motion, but for its first image.
            ours.velocity = [0.0; 3];
        }
        bench.env.observe(&mut bench.row.rows_mut());
        let pixels = bench.row.get::<u8>(PIXELS).unwrap();
        let png: Vec<u8> = recordings.list(run, image);
        let mut reader = png::Decoder::new(Cursor::new(png)).read_info().unwrap();
        let mut recorded = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut recorded).unwrap();
        // Squares as small as pixels are dots in the reference's image: there, means of 8 by 8 pixels.
        let side = if image == "img_400_png" { 8 } else { 1 };
        let [ours, theirs] = [pixels, &recorded].map(|rgb| coarse(rgb, side));
        let mean = mean_difference(&ours, &theirs);
        println!("{name}: mean difference {mean:.2}");
        assert!(mean < 5.0, "{name}: mean difference {mean}");
    }
}
