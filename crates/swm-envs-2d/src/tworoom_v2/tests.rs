//! TwoRoom-v2: what steps do at walls and doors, targets, messages, images, and what the expert reaches. Recorded
//! trajectories of the reference are replayed by `cargo xtask golden --check`.

use std::collections::BTreeMap;

use proptest::prelude::*;
use swm_core::{
    Batch, Env, EnvConfig, EnvError, Episode, EpisodeSeed, Evaluation, ImageSize, PolicyContext, Registry,
    ResetOptions, Rollout, Schema, Slice, Value, World, WorldOptions,
};
use swm_fov::FactorEnv;

use super::dot::Dot;
use super::room::{IMAGE_PX, Room, distance};
use super::{TWO_ROOM_V2, TwoRoom, factors, route};
use crate::artist::Sprite as _;

/// An environment with a row to look at.
struct Bench {
    env: FactorEnv<TwoRoom>,
    row: Batch,
}

impl Bench {
    fn new(image: Option<ImageSize>, settings: &serde_json::Value) -> Self {
        let config = EnvConfig { image, settings: settings.as_object().unwrap().clone() };
        let env = FactorEnv::<TwoRoom>::new(&config).unwrap();
        let row = Batch::new(Schema::new(env.spec().fields.clone()).unwrap(), 1);
        Self { env, row }
    }

    fn plain() -> Self {
        Self::new(None, &serde_json::json!({}))
    }

    fn reset(&mut self, seed: u64, options: &ResetOptions) -> Result<(), EnvError> {
        self.env.reset(&Episode::new(EpisodeSeed::new(seed), options))?;
        self.env.write_episode(&mut self.row.rows_mut());
        self.env.observe(&mut self.row.rows_mut());
        Ok(())
    }

    fn step(&mut self, action: [f32; 2]) -> [f32; 2] {
        self.env.step(Slice::F32(&action)).unwrap();
        self.env.observe(&mut self.row.rows_mut());
        self.pair("state")
    }

    fn pair(&self, field: &str) -> [f32; 2] {
        self.row.get::<f32>(field).unwrap().try_into().unwrap()
    }
}

/// Nothing sampled; agent and target where they are put.
fn placed(agent: [f32; 2], target: [f32; 2]) -> ResetOptions {
    ResetOptions::default()
        .vary(["none"])
        .set("agent.position", Value::vector(&agent))
        .set("target.position", Value::vector(&target))
}

#[test]
fn walls_stop_and_doors_do_not() {
    let mut bench = Bench::plain();
    // The wall begins at 107; an agent of radius 7 that runs into it is put half a pixel before 100.
    bench.reset(0, &placed([90.0, 150.0], [200.0, 200.0])).unwrap();
    for _ in 0..5 {
        bench.step([1.0, 0.0]);
    }
    assert_eq!(bench.pair("state"), [99.5, 150.0]);
    bench.reset(0, &placed([90.0, 49.0], [200.0, 200.0])).unwrap();
    for _ in 0..10 {
        bench.step([1.0, 0.0]);
    }
    assert_eq!(bench.pair("state"), [140.0, 49.0]);
    // Who leaves a door sideways is put before the wall, on the side that the step began on.
    bench.reset(0, &placed([99.0, 60.0], [200.0, 200.0])).unwrap();
    assert_eq!([[1.0, 0.0], [1.0, 1.0]].map(|action| bench.step(action)), [[104.0, 60.0], [99.5, 65.0]]);
    // Actions are clipped, and borders stop.
    bench.reset(0, &placed([30.0, 30.0], [200.0, 200.0])).unwrap();
    assert_eq!(bench.step([-7.0, 0.5]), [25.0, 32.5]);
    assert_eq!(bench.step([-1.0, 0.0]), [21.0, 32.5]);
}

#[test]
fn observations_hold_the_doors_that_exist() {
    let mut bench = Bench::plain();
    let options = placed([60.0, 60.0], [150.0, 120.0])
        .set("wall.axis", Value::scalar(0i64))
        .set("door.number", Value::scalar(2i64))
        .set("door.position", Value::vector(&[30i64, 180, 90]));
    bench.reset(0, &options).unwrap();
    let observation: &[f32] = bench.row.get("observation").unwrap();
    assert_eq!(observation, [60.0, 60.0, 150.0, 120.0, 30.0, 112.0, 180.0, 112.0, 0.0, 0.0]);
    assert_eq!(bench.row.get::<f64>("distance_to_target").unwrap(), [f64::from(11_700.0_f32.sqrt())]);
}

#[test]
fn min_steps_moves_near_targets_and_no_others() {
    let mut bench = Bench::plain();
    let steps_to_target = |bench: &Bench| {
        let room = &Room::new(&factors().defaults());
        let [agent, target] = ["state", "goal_state"].map(|field| bench.pair(field).map(f64::from));
        route::way(room, agent, target).length / f64::from(room.speed)
    };
    let least =
        |steps: i64| ResetOptions::default().vary(["none"]).set("task.min_steps", Value::scalar(steps));
    bench.reset(1, &ResetOptions::default().vary(["none"])).unwrap();
    assert_eq!(bench.pair("goal_state"), [164.0, 112.0]);
    bench.reset(1, &least(20)).unwrap();
    assert_eq!(bench.pair("goal_state"), [164.0, 112.0], "it is more than 20 steps away");
    for seed in 0..20 {
        bench.reset(seed, &least(40)).unwrap();
        assert!(steps_to_target(&bench) >= 40.0, "seed {seed}: {:?}", bench.pair("goal_state"));
        assert_eq!(bench.pair("variation.target.position"), [164.0, 112.0]);
    }
    bench.reset(1, &least(114)).unwrap();
    assert!(steps_to_target(&bench) > 47.0, "the farthest of a thousand: {:?}", bench.pair("goal_state"));
    bench.reset(1, &least(114).set("target.position", Value::vector(&[100.0, 30.0]))).unwrap();
    assert_eq!(bench.pair("goal_state"), [100.0, 30.0], "who sets the target gets it");
}

#[test]
fn start_and_goal_come_from_recorded_rows() {
    let mut bench = Bench::plain();
    let row = |column: &str, position: [f64; 2]| {
        Some(BTreeMap::from([(column.to_owned(), Value::vector(&position))]))
    };
    let mut options = ResetOptions::default();
    (options.start, options.goal) = (row("state", [112.0, 49.0]), row("proprio", [30.5, 40.25]));
    bench.reset(0, &options).unwrap();
    assert_eq!((bench.pair("state"), bench.pair("goal_state")), ([112.0, 49.0], [30.5, 40.25]));
    options.start = row("qpos", [1.0, 2.0]);
    let message = bench.reset(0, &options).unwrap_err().to_string();
    assert!(message.contains("need the column `state` or `proprio`"), "{message}");
    options.start = row("state", [300.0, 20.0]);
    let message = bench.reset(0, &options).unwrap_err().to_string();
    assert!(message.contains("`state`: the position [300.0, 20.0] is not between 0 and 224"), "{message}");
}

#[test]
fn impossible_combinations_name_constraint_and_factors() {
    let mut bench = Bench::plain();
    let mut message = |options: &ResetOptions| match bench.reset(0, options) {
        Err(error @ EnvError::Constraint { .. }) => error.to_string(),
        other => panic!("{other:?}"),
    };
    let nothing = || ResetOptions::default().vary(["none"]);
    let narrow = message(&nothing().set("door.size", Value::vector(&[7i64, 21, 21])));
    for part in ["`door.size` must be at least 1.1 times agent.radius", "door.number = 1", "agent.radius = 7"]
    {
        assert!(narrow.contains(part), "{narrow}");
    }
    let inside = message(&nothing().set("agent.position", Value::vector(&[112.0, 49.0])));
    for part in ["`agent.position` must be clear of the wall", "wall.thickness = 10", "[112.0,49.0]"] {
        assert!(inside.contains(part), "{inside}");
    }
    let turned = message(&nothing().set("wall.axis", Value::scalar(0i64)));
    assert!(turned.contains("its default does not meet: sample or set it too"), "{turned}");
    let wide = message(&nothing().set("agent.radius", Value::scalar(14.0)));
    assert!(wide.contains("`door.size` must be") && wide.contains("agent.radius = 14"), "{wide}");
}

/// A dot over a whole image, pixel by pixel, with nothing left out.
fn blend_everywhere(dot: &Dot, image: &mut [u8]) {
    let spread = (2.0 * f64::from(dot.radius) * f64::from(dot.radius)) as f32;
    let weight = |index: usize| {
        let [dx, dy] =
            [(index % IMAGE_PX, 0), (index / IMAGE_PX, 1)].map(|(i, axis)| i as f32 - dot.center[axis]);
        f64::from(-(dx * dx + dy * dy) / spread).exp() as f32
    };
    let largest = (0..IMAGE_PX * IMAGE_PX).map(weight).fold(0.0, f32::max);
    for (index, pixel) in image.chunks_exact_mut(3).enumerate() {
        let weight = weight(index) / largest;
        for (byte, color) in pixel.iter_mut().zip(dot.color) {
            *byte = (f32::from(*byte) * (1.0 - weight) + f32::from(color) * weight) as u8;
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn what_a_dot_leaves_out_would_not_change(
        center in prop::array::uniform2(0.0_f32..224.0),
        radius in 7.0_f32..14.0,
        color in any::<[u8; 3]>(),
        background in any::<[u8; 3]>(),
    ) {
        let dot = Dot { center, radius, color };
        let mut image = background.repeat(IMAGE_PX * IMAGE_PX);
        let mut expected = image.clone();
        let bounds = dot.blend_exactly(&mut image);
        blend_everywhere(&dot, &mut expected);
        let differ = image.iter().zip(&expected).filter(|(a, b)| a != b).count();
        prop_assert!(differ <= 15, "{differ} bytes differ, one in ten thousand may");
        prop_assert!(image.iter().zip(&expected).all(|(a, b)| a.abs_diff(*b) <= 1));
        for (index, pixel) in image.chunks_exact(3).enumerate() {
            let (x, y) = ((index % IMAGE_PX) as i32, (index / IMAGE_PX) as i32);
            let inside = (bounds.x0..bounds.x1).contains(&x) && (bounds.y0..bounds.y1).contains(&y);
            prop_assert!(inside || pixel == background, "a pixel outside of the bounds changed");
        }
    }
}

proptest! {
    /// Straight lines are shortest; and whoever heads where a way says gets there.
    #[test]
    fn ways_lead_to_their_target(seed in 0_u64..1 << 40) {
        leads_to_its_target(seed)?;
    }
}

/// The target is in the wall; from beside the wall it is just near enough.
#[test]
fn a_way_ends_before_the_wall() {
    leads_to_its_target(802_401_738_348).unwrap();
}

/// The door is at the border, where rounding puts the agent a little beyond it.
#[test]
fn a_way_leads_through_a_door_along_the_border() {
    leads_to_its_target(447_832_088_856).unwrap();
}

fn leads_to_its_target(seed: u64) -> Result<(), TestCaseError> {
    let options = ResetOptions::default().vary(["all"]);
    let fov = factors().sample("test", &Episode::new(EpisodeSeed::new(seed), &options)).unwrap();
    let room = Room::new(&fov);
    let target = fov.vector::<f32, 2>("target.position").map(f64::from);
    let mut agent: [f32; 2] = fov.vector("agent.position");
    let first = route::way(&room, agent.map(f64::from), target);
    prop_assert!(first.length >= distance(agent.map(f64::from), target) - 1e-9);
    prop_assume!(first.succeeds);
    for _ in 0..400 {
        let here = agent.map(f64::from);
        if distance(here, target) < 16.0 {
            return Ok(());
        }
        let next = route::way(&room, here, target).next;
        let reach = f64::from(room.speed).max(distance(here, next));
        agent = room.step(agent, [0, 1].map(|axis| ((next[axis] - here[axis]) / reach) as f32));
    }
    prop_assert!(false, "400 steps do not lead from {first:?} to {target:?}; the agent is at {agent:?}");
    Ok(())
}

#[test]
fn fast_images_look_like_exact_ones() {
    for (height, width) in [(64, 64), (224, 224), (96, 300)] {
        let size = ImageSize { height, width };
        let [mut exact, mut fast] =
            ["exact", "fast"].map(|render| Bench::new(Some(size), &serde_json::json!({ "render": render })));
        for seed in 0..6 {
            let options = ResetOptions::default().vary(["all"]);
            for bench in [&mut exact, &mut fast] {
                bench.reset(seed, &options).unwrap();
                bench.step([1.0, -0.3]);
            }
            for field in ["pixels", "goal"] {
                let [a, b] = [&exact, &fast].map(|bench| bench.row.get::<u8>(field).unwrap());
                let differences = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b));
                let mean = differences.clone().map(f64::from).sum::<f64>() / a.len() as f64;
                let largest = differences.max().unwrap();
                assert!(
                    mean < 0.6 && largest <= 12,
                    "{width} px, seed {seed}: mean {mean}, largest {largest}"
                );
            }
        }
    }
}

#[test]
fn border_lines_have_a_color_of_their_own_on_request() {
    let mut bench = Bench::new(Some(ImageSize { height: 224, width: 224 }), &serde_json::json!({}));
    let wall = |options: ResetOptions| options.set("wall.color", Value::vector(&[1u8, 2, 3]));
    let pixel = |bench: &Bench, x: usize, y: usize| -> [u8; 3] {
        bench.row.get::<u8>("pixels").unwrap()[(y * 224 + x) * 3..][..3].try_into().unwrap()
    };
    bench.reset(0, &wall(placed([40.0, 40.0], [60.0, 180.0]))).unwrap();
    assert_eq!([pixel(&bench, 210, 200), pixel(&bench, 112, 150)], [[1, 2, 3]; 2]);
    let options = wall(placed([40.0, 40.0], [60.0, 180.0]));
    bench.reset(0, &options.set("wall.border_color", Value::vector(&[9u8, 9, 9]))).unwrap();
    assert_eq!([pixel(&bench, 210, 200), pixel(&bench, 112, 150)], [[9; 3], [1, 2, 3]]);
}

const SEED: u64 = 7;

fn evaluate(policy: &str, options: &ResetOptions, episodes: u64, budget: u64) -> Evaluation {
    let options_of_world = WorldOptions::new(4).max_episode_steps(budget);
    let mut world = World::new(&TWO_ROOM_V2, options_of_world).unwrap();
    world.set_policy(Registry::new().policy(policy, &world).unwrap()).unwrap();
    let rollout = Rollout::new(0..episodes).seed(SEED).options(options.clone());
    world.evaluate(&rollout).unwrap()
}

#[test]
fn the_expert_solves_default_episodes() {
    let evaluation = evaluate("expert", &ResetOptions::default(), 100, 100);
    assert!(evaluation.success_rate >= 98.0, "{evaluation:?}");
    let noisy = evaluate("noisy-expert:0.5", &ResetOptions::default(), 40, 100);
    assert!(noisy.success_rate >= 90.0, "{noisy:?}");
    assert_eq!(noisy.setup.policy, "noisy-expert:noise=0.5");
}

/// Solvable: some place that the agent can get to is within 16 px of the target.
#[test]
fn the_expert_solves_what_can_be_solved_under_all_factors() {
    let options = ResetOptions::default().vary(["all"]);
    let evaluation = evaluate("expert", &options, 150, 300);
    let mut bench = Bench::plain();
    let (mut solvable, mut solved) = (0, 0);
    for (episode, &success) in evaluation.episode_successes.iter().enumerate() {
        bench.reset(EpisodeSeed::of(SEED, episode as u64).value() as u64, &options).unwrap();
        let fov = factors().sample("test", &Episode::new(EpisodeSeed::of(SEED, episode as u64), &options));
        let [agent, target] = ["state", "goal_state"].map(|field| bench.pair(field).map(f64::from));
        let can_be = route::way(&Room::new(&fov.unwrap()), agent, target).succeeds;
        solvable += u32::from(can_be);
        solved += u32::from(success && can_be);
    }
    assert!(solvable >= 100 && solved * 100 >= solvable * 95, "{solved} of {solvable} solvable");
}

#[test]
fn repeated_actions_stay_reproducible_and_arguments_are_checked() {
    let few = |policy: &str| evaluate(policy, &ResetOptions::default(), 6, 60);
    let lengths = |evaluation: Evaluation| evaluation.episode_lengths;
    let sticky = "noisy-expert:noise=2,action_repeat_prob=0.8";
    assert_eq!(lengths(few(sticky)), lengths(few(sticky)));
    assert_ne!(lengths(few(sticky)), lengths(few("noisy-expert")));
    for (policy, part) in [
        ("expert:noise=-1", "noise -1 must be 0 or more"),
        ("expert:action_repeat_prob=2", "action_repeat_prob 2 must be 0 to 1"),
        ("expert:nois=1", "setting `nois`: unknown (did you mean `noise`?)"),
    ] {
        let config = EnvConfig::default();
        let context = PolicyContext::new(&TWO_ROOM_V2, &config);
        let made = Registry::new().policy(policy, context);
        let message = made.err().expect("it is wrong").to_string();
        assert!(message.contains(part), "{message}");
    }
}
