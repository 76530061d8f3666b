//! Driving a world from outside: actions by hand, chosen slots, foreign memory, cancelling, errors that keep their source.

use std::sync::{Arc, Mutex};
use std::thread::{self, ThreadId};

use swm_core::dataset::Metadata;
use swm_core::testing::TOY;
use swm_core::{
    Actions, Batch, BoxError, Cancel, Column, Dtype, EnvState, EpisodeEnd, EpisodeSink, Field, LiveEpisode,
    LiveStep, Policy, PolicyError, Recorder, ResetOptions, Rollout, RowsMut, SavedSlot, Schema, Slice,
    SliceMut, Value, View, World, WorldError, WorldOptions, policies, policy,
};

fn world(num_envs: usize, threads: usize) -> World {
    World::new(&TOY, WorldOptions::new(num_envs).max_episode_steps(9).threads(threads))
        .expect("valid options")
}

/// Walks towards the goal by steps of up to 1.
fn action(state: f64, goal: f64) -> f32 {
    (goal - state).clamp(-1.0, 1.0) as f32
}

fn walker() -> impl Policy {
    policy::scripted("walk", |slot, out| {
        let (state, goal) = (slot.row.get::<f64>("state")?[0], slot.row.get::<f64>("goal_state")?[0]);
        policy::write_action(out, &[action(state, goal)]);
        Ok(())
    })
}

/// All steps and ends, by episode.
#[derive(Default, Debug, PartialEq)]
struct Log {
    steps: Vec<(u64, u64, u64, u32)>,
    ends: Vec<(u64, u64)>,
    policy: String,
    finished: bool,
}

impl Recorder for Log {
    fn start(&mut self, run: &swm_core::RunInfo<'_>) -> Result<(), BoxError> {
        self.policy = run.policy.to_owned();
        Ok(())
    }

    fn step(&mut self, live: &LiveStep<'_>) -> Result<(), BoxError> {
        let state = live.values.get::<f64>("state")?[0].to_bits();
        let action = live.values.get::<f32>("action")?[0].to_bits();
        self.steps.push((live.episode.index, live.episode.step, state, action));
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.ends.push((end.index, end.steps));
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.finished = true;
        self.steps.sort_unstable();
        self.ends.sort_unstable();
        Ok(())
    }
}

#[test]
fn a_driver_outside_gets_what_a_policy_gets() {
    let rollout = Rollout::new(3..14).seed(5).vary(["point"]);
    let mut expected = Log::default();
    let mut inside = world(4, 2);
    inside.set_policy(walker()).unwrap();
    inside.run(&rollout, &mut expected).unwrap();
    for (num_envs, threads) in [(1, 1), (3, 2), (16, 1)] {
        let mut world = world(num_envs, threads);
        let mut log = Log::default();
        let mut run = world.begin(&rollout, &mut log).unwrap();
        while let Some(view) = run.needs_actions() {
            let states = view.infos().get::<f64>("state").unwrap();
            let goals = view.infos().get::<f64>("goal_state").unwrap();
            let actions = states.iter().zip(goals).map(|(&state, &goal)| action(state, goal)).collect();
            run.set_actions(Column::F32(actions).as_slice()).unwrap();
            run.advance().unwrap();
        }
        assert_eq!(log.policy, "external");
        log.policy.clone_from(&expected.policy);
        assert_eq!(log, expected, "{num_envs} environments");
    }
    assert!(expected.finished && expected.ends.len() == 11);
}

#[test]
fn a_step_needs_actions_and_a_rollout_without_episodes_none() {
    let (mut world, rollout) = (world(2, 1), Rollout::new(0..2));
    let mut nobody = ();
    let mut run = world.begin(&rollout, &mut nobody).unwrap();
    assert!(matches!(run.advance(), Err(WorldError::NoActions)));
    assert!(matches!(run.act(), Err(WorldError::NoPolicy)));
    let (empty, mut log) = (Rollout::new(0..0), Log::default());
    assert!(world.begin(&empty, &mut log).unwrap().needs_actions().is_none());
    assert!(log.finished);
}

#[test]
fn chosen_slots_are_reset_and_stepped_and_others_stay() {
    let mut world = world(3, 2);
    world.reset(1, &ResetOptions::default()).unwrap();
    let states = |world: &World| world.infos().get::<f64>("state").unwrap().to_vec();
    let before = states(&world);
    world.step_slots(&[false, true, false], Slice::F32(&[1.0; 3])).unwrap();
    let after = states(&world);
    assert_eq!([after[0], after[2]], [before[0], before[2]]);
    assert!(after[1] != before[1]);
    assert_eq!(world.infos().get::<i64>("step_idx").unwrap(), [0, 1, 0]);
    let start = |at: f64| {
        let start = [("state".to_owned(), Value::vector(&[at]))].into_iter().collect();
        ResetOptions { start: Some(start), ..ResetOptions::default() }
    };
    let (low, high) = (start(-3.0), start(3.0));
    world.reset_slots(&[(2, LiveEpisode::of(1, 7), &high), (0, LiveEpisode::of(1, 8), &low)]).unwrap();
    assert_eq!(states(&world), [-3.0, after[1], 3.0]);
    assert_eq!(world.episode(2).map(|episode| (episode.index, episode.steps)), Some((7, 0)));
    assert_eq!(world.episode(1).map(|episode| (episode.index, episode.steps)), Some((1, 1)));
    let twice = [(1, LiveEpisode::of(1, 9), &low), (1, LiveEpisode::of(1, 9), &low)];
    for (wrong, part) in [(&twice[..], "named twice"), (&[(3, LiveEpisode::of(1, 9), &low)], "slot 3 of 3")] {
        assert!(world.reset_slots(wrong).unwrap_err().to_string().contains(part));
    }
    assert!(world.step_slots(&[true], Slice::F32(&[0.0; 3])).is_err());
}

/// Fails with an error of its own, and notes the threads that it was asked on.
struct Foreign(Arc<Mutex<Vec<ThreadId>>>);

#[derive(Debug, thiserror::Error)]
#[error("the model is away")]
struct Away(u32);

impl Policy for Foreign {
    fn describe(&self) -> String {
        "foreign".to_owned()
    }

    fn fields(&self) -> Vec<Field> {
        vec![Field::step("plan.cost", Dtype::F64, &[])]
    }

    fn act(&mut self, _view: &View<'_>, _actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        self.0.lock().expect("no thread panicked").push(thread::current().id());
        Err(PolicyError::Other(Box::new(Away(7))))
    }

    fn is_parallel(&self) -> bool {
        false
    }
}

#[test]
fn foreign_errors_stay_whole_and_tables_are_returned_at_their_addresses() {
    let mut world = world(2, 1);
    assert!(world.exchange_policy(policies::random()).unwrap().is_none());
    world.reset(1, &ResetOptions::default()).unwrap();
    let (address, schema) =
        (world.infos().get::<f64>("state").unwrap().as_ptr(), world.infos().schema().clone());
    let threads = Arc::default();
    let replaced = world.exchange_policy(Foreign(Arc::clone(&threads))).unwrap();
    let replaced = replaced.expect("the infos have one more column");
    assert_eq!((replaced.get::<f64>("state").unwrap().as_ptr(), replaced.schema()), (address, &schema));
    assert!(world.exchange_policy(Foreign(Arc::clone(&threads))).unwrap().is_none());
    for error in [world.step().unwrap_err(), world.evaluate(&Rollout::new(0..3)).unwrap_err()] {
        let foreign = error.foreign().and_then(|error| error.downcast_ref::<Away>());
        assert_eq!(foreign.map(|away| away.0), Some(7));
    }
    assert_eq!(*threads.lock().unwrap(), [thread::current().id(); 2], "one thread is the caller's");
    assert!(WorldError::NoPolicy.foreign().is_none());
    let address = world.infos().get::<f64>("state").unwrap().as_ptr();
    assert_eq!(world.into_infos().get::<f64>("state").unwrap().as_ptr(), address);
}

#[test]
fn tables_lie_over_foreign_memory() {
    let fields = vec![Field::step("state", Dtype::F64, &[2]), Field::step("seen", Dtype::Bool, &[])];
    let schema = Schema::new(fields).unwrap();
    let (mut states, mut seen) = (vec![0.0; 6], vec![false; 3]);
    let mut rows =
        RowsMut::over(&schema, 3, [SliceMut::F64(&mut states), SliceMut::Bool(&mut seen)]).unwrap();
    rows.select(1).write(0, &[1.0, 2.0]);
    rows.write(1, &[true]);
    drop(rows);
    assert_eq!(
        (states.as_slice(), seen.as_slice()),
        (&[0.0, 0.0, 1.0, 2.0, 0.0, 0.0][..], &[false, true, false][..])
    );
    let refused = |slices: Vec<SliceMut<'_>>| RowsMut::over(&schema, 3, slices).unwrap_err().to_string();
    assert!(refused(vec![SliceMut::F64(&mut states)]).contains("2, one per field"));
    assert!(
        refused(vec![SliceMut::F64(&mut states[..4]), SliceMut::Bool(&mut seen)])
            .contains("`state` must be 6 values")
    );
    assert!(
        refused(vec![SliceMut::F64(&mut states), SliceMut::U8(&mut [0; 3])])
            .contains("`seen` must be 3 values of bool")
    );
    let columns = Batch::new(schema.clone(), 2).into_columns();
    assert_eq!(columns, [Column::F64(vec![0.0; 4]), Column::Bool(vec![false; 2])]);
}

/// Keeps how many steps each episode has, and asks to stop after some.
#[derive(Default)]
struct Committed {
    lengths: Vec<usize>,
    enough: usize,
    cancel: Cancel,
}

impl EpisodeSink for Committed {
    fn begin(&mut self, _schema: &Arc<Schema>, _metadata: &Metadata) -> Result<u64, BoxError> {
        Ok(0)
    }

    fn holds(&self, _column: &str) -> bool {
        false
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        self.lengths.push(rows.rows());
        if self.lengths.len() == self.enough {
            self.cancel.cancel();
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        Ok(())
    }
}

#[test]
fn a_cancelled_run_keeps_what_it_committed() {
    // With several threads, the run goes on while an episode is written, and sees later that it shall stop.
    for (threads, episodes) in [(1, 20), (2, 2000)] {
        let mut world = world(3, threads);
        world.set_policy(policies::random()).unwrap();
        let mut whole = Committed::default();
        let rollout = Rollout::new(0..episodes).seed(2);
        world.record_dataset(&rollout, &mut whole).unwrap();
        let mut part = Committed { enough: 5, ..Committed::default() };
        let cancelled = world.record_dataset(&rollout.clone().cancel(&part.cancel), &mut part);
        assert!(matches!(cancelled, Err(WorldError::Cancelled)));
        assert!((5..episodes as usize).contains(&part.lengths.len()), "{}", part.lengths.len());
        assert_eq!(part.lengths, whole.lengths[..part.lengths.len()]);
    }
    let mut world = world(3, 2);
    world.set_policy(policies::random()).unwrap();
    let rollout = Rollout::new(0..20).seed(2);
    let stopped = Cancel::new();
    stopped.cancel();
    assert!(matches!(world.evaluate(&rollout.cancel(stopped)), Err(WorldError::Cancelled)));
}

#[test]
fn a_slot_goes_back_and_the_same_actions_give_the_same_bits() {
    let mut world = world(2, 1);
    world.reset(3, &ResetOptions::default()).unwrap();
    let step = |world: &mut World, action: f32| world.step_with(Slice::F32(&[action; 2])).unwrap();
    (0..3).for_each(|_| step(&mut world, 0.5));
    let saved = world.save_slot(0).unwrap();
    assert_eq!(saved.step(), Some(3));
    let row = |world: &World, slot: usize| {
        let row = world.infos().row(slot);
        (
            row.get::<f64>("state").unwrap().to_vec(),
            row.get::<f64>("reward").unwrap()[0].to_bits(),
            world.episode(slot),
        )
    };
    let there = row(&world, 0);
    // To the end of the episode, and back.
    let mut first = Vec::new();
    for index in 0..6 {
        step(&mut world, 0.1 * index as f32);
        first.push(row(&world, 0));
    }
    let other = row(&world, 1);
    // By way of another process, too.
    let mut bytes = EnvState::new();
    bytes.store("swm/Toy-v0", &saved).unwrap();
    let saved: SavedSlot = EnvState::from_bytes(bytes.bytes().to_vec()).load("swm/Toy-v0").unwrap();
    world.restore_slot(0, &saved).unwrap();
    assert_eq!((row(&world, 0), row(&world, 1)), (there, other));
    for (index, expected) in first.iter().enumerate() {
        world.step_slots(&[true, false], Slice::F32(&[0.1 * index as f32; 2])).unwrap();
        assert_eq!(row(&world, 0), *expected, "step {index}");
    }
    assert!(world.restore_slot(2, &saved).unwrap_err().to_string().contains("no slot 2"));
    assert!(world.save_slot(2).is_err());
}
