//! A hundred obstacle courses, keyed by number: a point walks from a start to a goal between round obstacles, at least
//! one of which bars the straight way. Not the golden navigation problem, which has one soft obstacle.

use rand::RngExt as _;
use serde_json::{Map, Value as Json, json};
use swm_core::seed::{Stream, keyed};
use swm_core::{Dtype, Space};
use swm_solvers::models::{ControlModel, Stage};
use swm_solvers::{Candidates, Cost, NoTrace, Outputs, Plan, PlanError, Problem, SOLVERS, Workspace};

use crate::problems::{keys, problem};

/// How many there are.
pub(super) const COURSES: usize = 100;
/// H.
pub(super) const STEPS: usize = 20;
/// A.
pub(super) const WIDTH: usize = 2;
/// The longest step along each axis.
const STRIDE: f64 = 0.2;
/// How near to the goal a walk must end.
const TOLERANCE: f64 = 0.1;
/// Obstacles cost from this far away on.
const MARGIN: f64 = 0.05;
const OBSTACLE_WEIGHT: f64 = 200.0;
const STAGE_WEIGHT: f64 = 0.05;
const GOAL_WEIGHT: f64 = 20.0;
const EFFORT_WEIGHT: f64 = 0.01;

type Point = [f64; 2];

/// Where to go, and what stands in the way.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Course {
    start: Point,
    goal: Point,
    /// Center and radius; 3 to 5, with gaps of 0.2 or more between them.
    obstacles: Vec<(Point, f64)>,
}

impl Course {
    /// Course `number`. Draws until a course is fair: start and goal are free, and the straight way is not.
    pub(super) fn number(number: usize) -> Self {
        let mut stream = keyed(number as u64, "obstacle course", [0, 0]);
        let obstacles = stream.random_range(3..=5);
        loop {
            let course = Self::sample(&mut stream, obstacles);
            if course.is_fair() {
                return course;
            }
        }
    }

    fn sample(stream: &mut Stream, obstacles: usize) -> Self {
        let mut near = |x: f64| [x + stream.random_range(-0.2..0.2), stream.random_range(-0.5..0.5)];
        let (start, goal) = (near(-1.0), near(1.0));
        let obstacle = |_| {
            let center = [stream.random_range(-0.6..0.6), stream.random_range(-0.8..0.8)];
            (center, stream.random_range(0.15..0.3))
        };
        Self { start, goal, obstacles: (0..obstacles).map(obstacle).collect() }
    }

    fn is_fair(&self) -> bool {
        let apart = |i: usize, j: usize| {
            let ((p, r), (q, s)) = (self.obstacles[i], self.obstacles[j]);
            minus(p, q)[0].hypot(minus(p, q)[1]) - r - s >= 0.2
        };
        (0..self.obstacles.len()).all(|j| (0..j).all(|i| apart(i, j)))
            && self.clearance([self.start; 2]) > 0.15
            && self.clearance([self.goal; 2]) > 0.15
            && self.clearance([self.start, self.goal]) < 0.0
    }

    /// Distance of the straight way between two points from the nearest obstacle; negative inside of it.
    fn clearance(&self, way: [Point; 2]) -> f64 {
        let distance = |(center, radius): &(Point, f64)| {
            let (_, [x, y]) = nearest(way, *center);
            x.hypot(y) - radius
        };
        self.obstacles.iter().map(distance).fold(f64::INFINITY, f64::min)
    }

    /// Whether `plan`, `[H, A]`, ends at the goal and touches no obstacle on the way.
    pub(super) fn is_solved_by(&self, plan: &[f32]) -> bool {
        let places = self.walk(plan);
        let [x, y] = minus(places[STEPS], self.goal);
        let clear = places.windows(2).all(|way| self.clearance([way[0], way[1]]) >= 0.0);
        clear && x.hypot(y) <= TOLERANCE
    }

    /// `[H + 1]`: start and all places after it.
    fn walk(&self, plan: &[f32]) -> [Point; STEPS + 1] {
        let mut places = [self.start; STEPS + 1];
        for (t, u) in plan.chunks_exact(WIDTH).enumerate() {
            places[t + 1] = step(places[t], [u[0].into(), u[1].into()]);
        }
        places
    }

    /// The cost of `plan`, `[H, A]`, and its derivative with respect to all places but the first.
    fn cost(&self, plan: &[f32]) -> (f64, [Point; STEPS]) {
        let places = self.walk(plan);
        let mut cost = plan.iter().map(|&u| EFFORT_WEIGHT * f64::from(u).powi(2)).sum::<f64>();
        let mut gradient = [[0.0; 2]; STEPS + 1];
        for t in 0..STEPS {
            let (step, by_place) = self.step_cost(t, [places[t], places[t + 1]]);
            cost += step;
            add(&mut gradient[t], by_place[0], 1.0);
            add(&mut gradient[t + 1], by_place[1], 1.0);
        }
        let [_, rest @ ..] = gradient;
        (cost, rest)
    }

    /// The cost of step `t` along `way`, without its effort, and its derivative with respect to both ends.
    fn step_cost(&self, t: usize, way: [Point; 2]) -> (f64, [Point; 2]) {
        let weight = if t + 1 == STEPS { GOAL_WEIGHT } else { STAGE_WEIGHT };
        let away = minus(way[1], self.goal);
        let mut cost = weight * (away[0] * away[0] + away[1] * away[1]);
        let mut gradient = [[0.0; 2]; 2];
        add(&mut gradient[1], away, 2.0 * weight);
        for &(center, radius) in &self.obstacles {
            let (part, away) = nearest(way, center);
            let distance = (away[0] * away[0] + away[1] * away[1]).sqrt();
            let depth = radius + MARGIN - distance;
            if depth > 0.0 && distance > 0.0 {
                cost += OBSTACLE_WEIGHT * depth * depth;
                let slope = -2.0 * OBSTACLE_WEIGHT * depth / distance;
                add(&mut gradient[0], away, slope * (1.0 - part));
                add(&mut gradient[1], away, slope * part);
            }
        }
        (cost, gradient)
    }

    /// The cost of `plan`, `[H, A]`, and its derivative, written to `gradient`.
    fn cost_with_gradient(&self, plan: &[f32], gradient: &mut [f32]) -> f64 {
        let (cost, places) = self.cost(plan);
        let mut later = [0.0; 2];
        for t in (0..STEPS).rev() {
            add(&mut later, places[t], 1.0);
            for axis in 0..2 {
                let u = f64::from(plan[t * WIDTH + axis]);
                let slope = STRIDE * (1.0 + u * u).powf(-1.5);
                gradient[t * WIDTH + axis] = (later[axis] * slope + 2.0 * EFFORT_WEIGHT * u) as f32;
            }
        }
        cost
    }
}

/// Where an action leads.
fn step(place: Point, action: Point) -> Point {
    [place[0] + STRIDE * bend(action[0]), place[1] + STRIDE * bend(action[1])]
}

/// The point of the straight way between two points that is nearest to `center`: its part of the way, and where it is
/// seen from `center`.
fn nearest([a, b]: [Point; 2], center: Point) -> (f64, Point) {
    let (way, from) = (minus(b, a), minus(a, center));
    let length = way[0] * way[0] + way[1] * way[1];
    let part = if length > 0.0 { -(way[0] * from[0] + way[1] * from[1]) / length } else { 0.0 };
    let part = part.clamp(0.0, 1.0);
    (part, [from[0] + part * way[0], from[1] + part * way[1]])
}

/// From any number to one between -1 and 1.
fn bend(u: f64) -> f64 {
    u / (1.0 + u * u).sqrt()
}

fn minus(p: Point, q: Point) -> Point {
    [p[0] - q[0], p[1] - q[1]]
}

fn add(sum: &mut Point, p: Point, factor: f64) {
    *sum = [sum[0] + factor * p[0], sum[1] + factor * p[1]];
}

/// All courses as one cost: episode `b` is course `b`.
pub(super) struct Courses(pub(super) Vec<Course>);

impl Courses {
    pub(super) fn all() -> Self {
        Self((0..COURSES).map(Course::number).collect())
    }

    /// What one action may be.
    pub(super) fn space() -> Space {
        Space::uniform_box(Dtype::F32, &[WIDTH], -1.0, 1.0)
    }

    /// How many courses `plans`, `[COURSES, H, A]`, solve.
    pub(super) fn solved(&self, plans: &[f32]) -> usize {
        let plans = plans.chunks_exact(STEPS * WIDTH);
        self.0.iter().zip(plans).filter(|(course, plan)| course.is_solved_by(plan)).count()
    }
}

impl Cost for Courses {
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let Outputs { costs, gradient, .. } = outputs;
        for (index, (plan, cost)) in candidates.plans().zip(costs.iter_mut()).enumerate() {
            let course = &self.0[index / candidates.samples];
            *cost = match gradient {
                Some(all) => course.cost_with_gradient(plan, &mut all[index * plan.len()..][..plan.len()]),
                None => course.cost(plan).0,
            };
        }
        Ok(())
    }

    fn has_gradients(&self) -> bool {
        true
    }

    fn control(&self) -> Option<&dyn ControlModel> {
        Some(self)
    }
}

/// The same cost step by step; a stage costs what the step from it does.
impl ControlModel for Courses {
    fn state_dim(&self) -> usize {
        2
    }
    fn action_dim(&self) -> usize {
        WIDTH
    }
    fn start(&self, episode: usize, state: &mut [f64]) {
        state.copy_from_slice(&self.0[episode].start);
    }
    fn step(&self, at: &Stage<'_>, next: &mut [f64]) {
        next.copy_from_slice(&step([at.state[0], at.state[1]], [at.action[0], at.action[1]]));
    }
    fn cost(&self, at: &Stage<'_>) -> f64 {
        let &[x, y] = at.action else { return 0.0 };
        let (place, effort) = ([at.state[0], at.state[1]], EFFORT_WEIGHT * (x * x + y * y));
        effort + self.0[at.episode].step_cost(at.step, [place, step(place, [x, y])]).0
    }
}

/// Settings that a solver needs for a problem of 40 values with several local minima; the others keep their defaults.
fn settings(solver: &str) -> Map<String, Json> {
    let settings = match solver {
        "sgd" | "pgd" => json!({"iterations": 100, "samples": 40, "lr": 0.03}),
        "adam" | "adamw" => json!({"iterations": 100, "samples": 40}),
        "ilqr" => json!({"samples": 10}),
        "lagrangian" => json!({"samples": 40}),
        "mppi" => json!({"sigma": 0.3, "iterations": 100, "temperature": 0.1}),
        "predictive-sampling" => json!({"sigma": 0.2, "iterations": 60}),
        _ => json!({}),
    };
    settings.as_object().expect("an object").clone()
}

#[test]
fn every_solver_of_real_actions_solves_95_of_100_courses() {
    let mut courses = Courses::all();
    let (keys, space, initial) =
        (keys(0..COURSES as u64), Courses::space(), vec![0.0; COURSES * STEPS * WIDTH]);
    let problem = Problem { horizon: STEPS, ..problem(&keys, &space, &initial) };
    // Those that need a model's states have tests of their own.
    for entry in SOLVERS.iter().filter(|entry| !entry.needs_states) {
        let solver = entry.make(settings(entry.name)).expect("valid settings");
        if solver.check(&space).is_err() {
            continue;
        }
        let mut plan = Plan::new();
        solver
            .solve(&problem, &mut courses, &mut Workspace::new(), &mut NoTrace, &mut plan)
            .expect("finite costs");
        let solved = courses.solved(&plan.actions);
        println!("{} solves {solved} of {COURSES} courses", entry.name);
        assert!(solved >= 95, "{} solves {solved} of {COURSES} courses", entry.name);
    }
}

#[test]
fn courses_differ_and_their_straight_way_is_barred() {
    let Courses(all) = Courses::all();
    for (number, course) in all.iter().enumerate() {
        assert_eq!(*course, Course::number(number));
        assert!((3..=5).contains(&course.obstacles.len()) && (number == 0 || *course != all[0]));
        let [x, y] = minus(course.goal, course.start);
        let pace = |way: f64| {
            let bent = way / STEPS as f64 / STRIDE;
            (bent / (1.0 - bent * bent).sqrt()) as f32
        };
        let straight: Vec<f32> = (0..STEPS).flat_map(|_| [pace(x), pace(y)]).collect();
        let [end_x, end_y] = minus(course.walk(&straight)[STEPS], course.goal);
        assert!(end_x.hypot(end_y) < 1e-6 && !course.is_solved_by(&straight));
        assert!(!course.is_solved_by(&[0.0; STEPS * WIDTH]));
    }
    assert!((3..=5).all(|count| all.iter().any(|course| course.obstacles.len() == count)));
}

#[test]
fn gradients_are_those_of_the_cost() {
    for (number, course) in Courses::all().0.iter().enumerate() {
        let mut stream = keyed(number as u64, "random walk", [0, 0]);
        let mut plan: [f32; STEPS * WIDTH] = std::array::from_fn(|_| stream.random_range(-0.5..1.0));
        let mut gradient = [0.0; STEPS * WIDTH];
        course.cost_with_gradient(&plan, &mut gradient);
        for index in 0..plan.len() {
            let step = 1.0 / 16384.0;
            let value = plan[index];
            plan[index] = value + step;
            let above = course.cost(&plan).0;
            plan[index] = value - step;
            let below = course.cost(&plan).0;
            plan[index] = value;
            let slope = (above - below) / f64::from(2.0 * step);
            let error = (slope - f64::from(gradient[index])).abs();
            assert!(error < 0.02 * slope.abs().max(1.0), "course {number}, {index}: {slope}");
        }
    }
}
