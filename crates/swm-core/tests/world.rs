//! `World` on the toy environment: the loop, its rows, its errors.

use swm_core::error::BoxError;
use swm_core::policy::write_action;
use swm_core::testing::TOY;
use swm_core::{
    Actions, Dtype, EpisodeEnd, Field, LiveStep, Policy, PolicyError, Recorder, ResetOptions, Rollout, Slice,
    Value, View, World, WorldError, WorldOptions, policies, policy,
};

fn world(num_envs: usize, max_steps: u64) -> World {
    let options = WorldOptions::new(num_envs).max_episode_steps(max_steps);
    World::new(&TOY, options).expect("valid options")
}

/// Everything that a run shows, by episode.
#[derive(Default, PartialEq, Debug)]
struct Log {
    rows: Vec<(u64, u64, f64, bool)>,
    ends: Vec<(u64, u64, bool)>,
}

impl Recorder for Log {
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        let action = row.values.get::<f32>("action")?[0];
        let state = row.values.get::<f64>("state")?[0];
        self.rows.push((row.episode.index, row.episode.step, state, action.is_nan()));
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.ends.push((end.index, end.steps, end.truncated));
        Ok(())
    }
}

fn run(world: &mut World, episodes: std::ops::Range<u64>) -> Log {
    let mut log = Log::default();
    let rollout = Rollout::new(episodes).seed(5);
    world.run(&rollout, &mut log).expect("the toy runs");
    log.rows.sort_by_key(|row| (row.0, row.1));
    log.ends.sort_unstable();
    log
}

#[test]
fn a_run_shows_the_named_episodes_whatever_the_number_of_environments() {
    let of = |num_envs| {
        let mut world = world(num_envs, 9);
        world.set_policy(policies::random()).unwrap();
        run(&mut world, 3..10)
    };
    let one = of(1);
    assert_eq!(one.ends.iter().map(|end| end.0).collect::<Vec<_>>(), (3..10).collect::<Vec<_>>());
    assert_eq!(one, of(3));
    assert_eq!(one, of(16));
}

#[test]
fn only_the_last_row_of_an_episode_has_no_action() {
    let mut world = world(2, 6);
    world.set_policy(policies::random()).unwrap();
    let log = run(&mut world, 0..5);
    for &(index, steps, _) in &log.ends {
        let rows: Vec<_> = log.rows.iter().filter(|row| row.0 == index).collect();
        assert_eq!(rows.len() as u64, steps + 1, "episode {index}");
        for row in rows {
            assert_eq!(row.3, row.1 == steps, "episode {index}, row {}", row.1);
        }
    }
}

#[test]
fn a_world_can_be_stepped_by_hand() {
    let mut world = world(2, 100);
    assert!(matches!(world.step().unwrap_err(), WorldError::NoPolicy));
    world.reset(1, &ResetOptions::default().set("point.gain", Value::scalar(2.0))).unwrap();
    let before = world.infos().get::<f64>("state").unwrap().to_vec();
    world.step_with(Slice::F32(&[1.0, -0.5])).unwrap();
    let after = world.infos().get::<f64>("state").unwrap();
    assert_eq!([after[0] - before[0], after[1] - before[1]], [2.0, -1.0]);
    assert_eq!(world.infos().get::<i64>("step_idx").unwrap(), [1, 1]);
    assert!(world.infos().get::<f64>("stat").unwrap_err().to_string().contains("did you mean `state`?"));
}

#[test]
fn a_step_that_would_step_nothing_is_refused() {
    let mut world = world(2, 3);
    let actions = Slice::F32(&[0.1, 0.1]);
    let refused = |world: &mut World, words: &str| {
        for error in [world.step().unwrap_err(), world.step_with(actions).unwrap_err()] {
            assert!(matches!(error, WorldError::NoEpisode { .. }), "{error}");
            let message = error.to_string();
            assert!(message.contains(words) && message.contains("call `reset`"), "{message}");
        }
    };
    world.set_policy(policies::random()).unwrap();
    refused(&mut world, "no episode has begun");
    world.reset(1, &ResetOptions::default()).unwrap();
    // One of the two ends first: the other goes on, and it stays as it ended.
    for _ in 0..3 {
        world.step_slots(&[true, false], actions).unwrap();
    }
    let ended = world.infos().get::<f64>("state").unwrap()[0];
    world.step().unwrap();
    assert_eq!(world.infos().get::<f64>("state").unwrap()[0], ended);
    assert_eq!(world.infos().get::<i64>("step_idx").unwrap(), [3, 1]);
    assert!(matches!(world.step_slots(&[true, false], actions), Err(WorldError::NoEpisode { .. })));
    world.step_slots(&[false, false], actions).expect("nothing was asked for");
    world.step().unwrap();
    world.step().unwrap();
    refused(&mut world, "are over");
    world.reset(2, &ResetOptions::default()).unwrap();
    world.step().unwrap();
}

#[test]
fn unusable_actions_are_refused_before_anything_moves() {
    let mut world = world(2, 100);
    world.reset(1, &ResetOptions::default()).unwrap();
    let before = world.infos().clone();
    let nan = world.step_with(Slice::F32(&[0.0, f32::NAN])).unwrap_err().to_string();
    assert!(nan.contains("environment 1") && nan.contains("not finite"), "{nan}");
    let width = world.step_with(Slice::F32(&[0.0; 3])).unwrap_err().to_string();
    assert!(width.contains("2 values of float32") && width.contains("found 3"), "{width}");
    assert!(!width.contains("environment 0"), "no environment is at fault: {width}");
    let kind = world.step_with(Slice::F64(&[0.0; 2])).unwrap_err().to_string();
    assert!(kind.contains("float64"), "{kind}");
    assert_eq!(world.infos().get::<f64>("state").unwrap(), before.get::<f64>("state").unwrap());
}

#[test]
fn an_evaluation_is_indexed_by_episode() {
    let towards_goal = policy::scripted("towards the goal", |view, action| {
        let error = view.row.get::<f64>("goal_state")?[0] - view.row.get::<f64>("state")?[0];
        write_action(action, &[error.clamp(-1.0, 1.0) as f32]);
        Ok(())
    });
    let mut world = world(4, 40);
    world.set_policy(towards_goal).unwrap();
    let rollout = Rollout::new(0..25).seed(9);
    let result = world.evaluate(&rollout).unwrap();
    assert_eq!((result.success_rate, result.episodes), (100.0, 25));
    assert!(result.ci95[0] > 80.0 && result.ci95[1] == 100.0, "{:?}", result.ci95);
    assert_eq!(result.seeds.len(), 25);
    assert_eq!(result.setup.policy, "towards the goal");
    world.set_policy(policies::constant(Vec::new())).unwrap();
    let idle = world.evaluate(&rollout).unwrap();
    let at_start = idle.first_success_steps.iter().filter(|step| **step == Some(0)).count();
    assert_eq!(idle.episode_successes.iter().filter(|success| **success).count(), at_start);
    assert_eq!(idle.solved_at_start, at_start);
    assert_eq!(idle.seeds, result.seeds);
}

#[test]
fn the_time_of_an_evaluation_has_the_first_plan() {
    let pause = std::time::Duration::from_millis(20);
    let plans_once = policy::scripted("plans at the first step", move |view, action| {
        if view.row.get::<i64>("step_idx")?[0] == 0 {
            std::thread::sleep(pause);
        }
        write_action(action, &[0.0]);
        Ok(())
    });
    let mut world = world(1, 3);
    world.set_policy(plans_once).unwrap();
    let took = world.evaluate(&Rollout::new(0..1)).unwrap().wall_time_s;
    assert!(took >= pause.as_secs_f64(), "{took} s");
}

/// Does nothing, and says at every other step how many steps there were.
struct Talks {
    field: &'static str,
}

impl Policy for Talks {
    fn describe(&self) -> String {
        "talks".to_owned()
    }

    fn fields(&self) -> Vec<Field> {
        vec![Field::step(self.field, Dtype::F64, &[]), Field::step("steps.twice", Dtype::I64, &[2])]
    }

    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        for row in view.live() {
            let step = view.row(row).expect("live").episode.step;
            write_action(&mut actions.row(row), &[0.0]);
            if step.is_multiple_of(2) {
                actions.report(row, 0, &[step as f64]);
                actions.report(row, 1, &[step as i64, -5]);
            }
        }
        Ok(())
    }
}

#[test]
fn a_policy_adds_fields_of_its_own() {
    let mut world = world(3, 4);
    let place = |value: f64| Some([("state".to_owned(), Value::vector(&[value]))].into());
    let options = ResetOptions { start: place(0.0), goal: place(9.0), ..ResetOptions::default() };
    world.reset(1, &options).unwrap();
    let state = world.infos().get::<f64>("state").unwrap().to_vec();
    world.set_policy(Talks { field: "steps.so_far" }).unwrap();
    assert_eq!(world.infos().get::<f64>("state").unwrap(), state, "attaching a policy changes no value");

    struct Said(Vec<(u64, f64, Vec<i64>)>);
    impl Recorder for Said {
        fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
            let said = (row.values.get::<f64>("steps.so_far")?[0], row.values.get::<i64>("steps.twice")?);
            self.0.push((row.episode.step, said.0, said.1.to_vec()));
            Ok(())
        }
        fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
            Ok(())
        }
    }
    let mut said = Said(Vec::new());
    let rollout = Rollout::new(0..5).seed(5).options(options);
    world.run(&rollout, &mut said).unwrap();
    assert_eq!(said.0.len(), 5 * 5);
    for (step, so_far, twice) in said.0 {
        // The last row has no action, so it has nothing of the policy's either.
        if step % 2 == 0 && step < 4 {
            assert_eq!((so_far, twice), (step as f64, vec![step as i64, -5]));
        } else {
            assert!(so_far.is_nan() && twice == [-1, -1], "step {step}: {so_far} {twice:?}");
        }
    }
    world.set_policy(policies::random()).unwrap();
    assert!(world.infos().schema().index("steps.so_far").is_none(), "the fields go with the policy");
    world.run(&rollout, &mut ()).unwrap();
}

#[test]
fn a_policy_cannot_take_the_name_of_another_field() {
    let mut world = world(1, 4);
    let message = world.set_policy(Talks { field: "state" }).unwrap_err().to_string();
    assert!(message.contains("talks") && message.contains("`state`"), "{message}");
    world.reset(1, &ResetOptions::default()).unwrap();
    assert!(matches!(world.step(), Err(WorldError::NoPolicy)), "it was not attached");
    for field in ["ep_idx", "episode_idx", "reward"] {
        let message = world.set_policy(Talks { field }).unwrap_err().to_string();
        assert!(message.contains(&format!("`{field}` has the name of a column")), "{message}");
    }
    world.set_policy(policies::random()).unwrap();
    world.set_policy(Talks { field: "state" }).unwrap_err();
    world.step().expect("the policy before it stays");
    world.set_policy(Talks { field: "steps.so_far" }).unwrap();
    world.step().unwrap();
}
