//! Where episodes begin, and what being at their goals looks like.

use rand::RngExt as _;
use swm_core::seed::Stream;
use swm_core::{Episode, Slice};

use super::Body;
use super::env::MazeEnv;
use super::layout::{Cell, START_RANGE, place_of};
use super::settings::Mode;
use super::soccer::put_ball;
use super::state::TaskState;
use crate::humanoid::TRIES;
use crate::suite::{normal, randomize_joints, uniform};
use swm_mujoco::MujocoError;

/// The range of positions and velocities at a start.
const NOISE: f64 = 0.1;

/// Cells, or places x, y in m, of an episode.
struct Places<T> {
    start: T,
    goal: T,
    /// Where the ball is at the start.
    ball: Option<T>,
}

impl MazeEnv {
    /// Samples start and goal of an episode, and stands at its start.
    pub(super) fn begin(&mut self, episode: &Episode<'_>) -> Result<(), MujocoError> {
        let (nq, nv) = (self.sim.model().nq(), self.sim.model().nv());
        self.task_state = TaskState::new(episode.seed.value(), nq, nv);
        let mut stream = episode.seed.stream("start");
        let cells = self.sample_cells(&mut stream);
        let mut near = |cell: Cell| {
            place_of(cell).map(|middle| middle + uniform(&mut stream, -START_RANGE, START_RANGE))
        };
        let (start, goal) = (near(cells.start), near(cells.goal));
        let ball = cells.ball.map(near);
        self.put(goal, ball.map(|_| goal), &mut stream)?;
        for step in 0..self.body.settling() {
            let action = self.spec.action.sample(&mut episode.seed.indexed("goal action", [step, 0]));
            if let Slice::F32(values) = action.data.as_slice() {
                self.advance(values)?;
            }
        }
        self.move_to(goal, ball.map(|_| goal));
        self.task_state.goal = goal;
        self.task_state.goal_qpos.copy_from_slice(self.sim.qpos());
        self.task_state.goal_qvel.copy_from_slice(self.sim.qvel());
        self.put(start, ball, &mut stream)
    }

    /// The cells of the episode.
    fn sample_cells(&mut self, stream: &mut Stream) -> Places<Cell> {
        let (maze, has_ball) = (self.maze(), self.body.has_ball());
        match self.settings.mode {
            Mode::Task if has_ball => {
                let tasks = maze.soccer_tasks();
                let [start, ball, goal] = tasks[self.sample_task(tasks.len(), stream)];
                Places { start, goal, ball: Some(ball) }
            }
            Mode::Task => {
                let tasks = maze.tasks();
                let [start, goal] = tasks[self.sample_task(tasks.len(), stream)];
                Places { start, goal, ball: None }
            }
            Mode::DataCollection => {
                let mut cells = maze.open_cells();
                let mut take = || cells.swap_remove(stream.random_range(0..cells.len()));
                let (start, goal) = (take(), take());
                Places { start, goal, ball: has_ball.then(take) }
            }
        }
    }

    /// The index of the task, which the episode remembers.
    fn sample_task(&mut self, count: usize, stream: &mut Stream) -> usize {
        let task = self.settings.task.unwrap_or_else(|| stream.random_range(1..=count));
        self.task_state.task = task as i64;
        task - 1
    }

    /// The body near its reference posture, the humanoid in a random one in which nothing touches, at `place`.
    fn put(
        &mut self,
        place: [f64; 2],
        ball: Option<[f64; 2]>,
        stream: &mut Stream,
    ) -> Result<(), MujocoError> {
        if self.body == Body::Humanoid {
            return self.throw(place, stream);
        }
        let sim = &mut self.sim;
        sim.reset();
        sim.qpos_mut().iter_mut().for_each(|q| *q += uniform(stream, -NOISE, NOISE));
        sim.qvel_mut().iter_mut().for_each(|v| *v += NOISE * normal(stream));
        self.move_to(place, ball);
        self.sim.forward()
    }

    /// The humanoid in the air, in any posture in which nothing touches.
    fn throw(&mut self, place: [f64; 2], stream: &mut Stream) -> Result<(), MujocoError> {
        for _ in 0..TRIES {
            self.sim.reset();
            randomize_joints(&mut self.sim, stream);
            self.sim.qvel_mut().iter_mut().for_each(|v| *v = NOISE * normal(stream));
            self.move_to(place, None);
            self.sim.forward_without_actuation()?;
            if self.sim.contacts() == 0 {
                return self.sim.forward();
            }
        }
        Err(MujocoError::Start(format!("in {TRIES} tries some part of the humanoid always touched another")))
    }

    /// Body and ball at other places in the same posture. Nothing is computed.
    fn move_to(&mut self, place: [f64; 2], ball: Option<[f64; 2]>) {
        self.sim.qpos_mut()[..2].copy_from_slice(&place);
        if let Some(ball) = ball {
            put_ball(&mut self.sim, ball);
        }
    }
}
