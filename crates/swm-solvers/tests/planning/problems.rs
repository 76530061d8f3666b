//! Analytic planning problems with known solutions: linear-quadratic control, navigation around an obstacle and walking
//! by categories, four instances each. Computed in `f32` per candidate, as the reference's golden runs were.

use swm_core::{Dtype, EpisodeSeed, Space};
use swm_solvers::models::{ControlModel, LinearQuadratic, Navigation};
use swm_solvers::{Candidates, Cost, Outputs, PlanError, PlanKey, Problem, Solver};

/// H of the problems with real actions.
pub(super) const HORIZON: usize = 10;
/// A of the problems with real actions.
pub(super) const WIDTH: usize = 2;
/// H of [`disc`].
pub(super) const DISC_HORIZON: usize = 6;
/// C of [`disc`].
pub(super) const DISC_CATEGORIES: usize = 5;

/// An analytic problem: the cost of a plan `[H, A]` from start `instance`.
pub(super) type PlanCost = fn(instance: usize, plan: &[f32]) -> f32;

/// Linear-quadratic: a damped double integrator driven to the origin.
pub(super) fn lq(instance: usize, plan: &[f32]) -> f32 {
    const STARTS: [[f32; 4]; 4] =
        [[1.0, 0.0, 0.0, 0.0], [-0.5, 0.8, 0.2, -0.1], [0.3, -1.2, 0.0, 0.5], [1.5, 1.5, -1.0, 0.0]];
    let [mut x, mut y, mut vx, mut vy] = STARTS[instance];
    let mut cost = 0.0;
    for u in plan.chunks_exact(WIDTH) {
        cost += x * x + y * y + 0.1 * (vx * vx + vy * vy) + 0.05 * (u[0] * u[0] + u[1] * u[1]);
        (x, y, vx, vy) =
            (x + 0.1 * vx + 0.05 * u[0], y + 0.1 * vy + 0.05 * u[1], 0.95 * vx + u[0], 0.95 * vy + u[1]);
    }
    cost + 10.0 * (x * x + y * y) + (vx * vx + vy * vy)
}

/// The unconstrained optima of [`lq`], by instance.
pub(super) const LQ_OPTIMA: [f64; 4] = [4.402300, 3.826701, 6.443985, 19.139794];

/// Starts of [`nav`] and [`disc`], by instance.
const STARTS: [[f32; 2]; 4] = [[0.0, 0.0], [0.0, 0.3], [-0.5, -0.2], [0.2, 0.6]];
/// Goals of [`nav`] and [`disc`], by instance.
const GOALS: [[f32; 2]; 4] = [[1.2, 1.0], [1.0, -0.8], [1.0, 0.4], [-1.0, -0.6]];

/// The square of a distance.
fn far(p: [f32; 2], q: [f32; 2]) -> f32 {
    (p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1])
}

/// Navigation to a goal past a round obstacle; paths left and right of it are local minima.
pub(super) fn nav(instance: usize, plan: &[f32]) -> f32 {
    const OBSTACLE: [f32; 2] = [0.55, 0.45];
    let mut place = STARTS[instance];
    let mut cost = 0.0;
    for u in plan.chunks_exact(WIDTH) {
        place = [place[0] + 0.2 * u[0].tanh(), place[1] + 0.2 * u[1].tanh()];
        cost += far(place, GOALS[instance])
            + 5.0 * (-far(place, OBSTACLE) / 0.1).exp()
            + 0.01 * (u[0] * u[0] + u[1] * u[1]);
    }
    cost + 5.0 * far(place, GOALS[instance])
}

/// Walking toward a goal by steps of a quarter: none, right, left, up or down; mixtures of them while a solver relaxes
/// the categories.
pub(super) fn disc(instance: usize, plan: &[f32]) -> f32 {
    let mut place = STARTS[instance];
    let mut cost = 0.0;
    for a in plan.chunks_exact(DISC_CATEGORIES) {
        place = [place[0] + 0.25 * (a[1] - a[2]), place[1] + 0.25 * (a[3] - a[4])];
        cost += 0.1 * far(place, GOALS[instance]);
    }
    cost + far(place, GOALS[instance])
}

/// The gradient of [`disc`], in the order in which automatic differentiation finds it.
pub(super) fn disc_gradient(instance: usize, plan: &[f32], gradient: &mut [f32]) {
    let goal = GOALS[instance];
    let mut places = [STARTS[instance]; DISC_HORIZON + 1];
    for (t, a) in plan.chunks_exact(DISC_CATEGORIES).enumerate() {
        let [x, y] = places[t];
        places[t + 1] = [x + 0.25 * (a[1] - a[2]), y + 0.25 * (a[3] - a[4])];
    }
    let mut later = [0.0_f32; 2];
    for (t, gradient) in gradient.chunks_exact_mut(DISC_CATEGORIES).enumerate().rev() {
        for axis in 0..2 {
            let away = 2.0 * (places[t + 1][axis] - goal[axis]);
            if t + 1 == DISC_HORIZON {
                later[axis] += away;
            }
            later[axis] += 0.1 * away;
        }
        let [x, y] = later.map(|slope| 0.25 * slope);
        gradient.copy_from_slice(&[0.0, x, -x, y, -y]);
    }
}

/// The cheapest plans of [`disc`], by instance.
pub(super) const DISC_OPTIMA: [f64; 4] = [0.852750, 0.694750, 0.722250, 1.166750];

/// A problem to try a solver on, of the kind that it accepts.
#[derive(Clone, Debug)]
pub(super) struct Trial {
    pub(super) cost: PlanCost,
    pub(super) space: Space,
    pub(super) horizon: usize,
    /// H × D.
    pub(super) size: usize,
}

impl Trial {
    pub(super) fn nav() -> Self {
        Self { cost: nav, space: space(), horizon: HORIZON, size: HORIZON * WIDTH }
    }

    pub(super) fn lq() -> Self {
        Self { cost: lq, ..Self::nav() }
    }

    pub(super) fn disc() -> Self {
        let space = Space::Discrete { n: DISC_CATEGORIES as i64, start: 0 };
        Self { cost: disc, space, horizon: DISC_HORIZON, size: DISC_HORIZON * DISC_CATEGORIES }
    }

    /// [`nav`] for solvers of real actions, [`disc`] for those of integers.
    pub(super) fn accepted_by(solver: &dyn Solver) -> Self {
        [Self::nav(), Self::disc()]
            .into_iter()
            .find(|trial| solver.check(&trial.space).is_ok())
            .unwrap_or_else(|| panic!("{} accepts neither a box nor categories", solver.name()))
    }

    /// The problem of planning for `keys` from `initial`.
    pub(super) fn problem<'a>(&'a self, keys: &'a [PlanKey], initial: &'a [f32]) -> Problem<'a> {
        Problem { horizon: self.horizon, ..problem(keys, &self.space, initial) }
    }
}

/// The statistics of one iteration over the candidates of one episode.
#[derive(Clone, Copy, Debug)]
pub(super) struct Iteration {
    /// The cheapest.
    pub(super) min: f64,
    /// The mean of the cheapest `elites`.
    pub(super) elite: f64,
    /// The mean of all.
    pub(super) mean: f64,
    /// That of candidate 0.
    pub(super) first: f64,
}

/// A [`PlanCost`] as a [`Cost`] whose episode `b` is instance `b % 4`; remembers what each iteration saw.
pub(super) struct Analytic {
    pub(super) cost: PlanCost,
    /// How many elites the statistics use.
    pub(super) elites: usize,
    /// `[iteration][B]`, the final evaluation included.
    pub(super) iterations: Vec<Vec<Iteration>>,
    /// The same problem step by step, if it is [`nav`] or [`lq`].
    model: Option<Box<dyn ControlModel>>,
}

impl Analytic {
    pub(super) fn new(cost: PlanCost, elites: usize) -> Self {
        let is = |problem: PlanCost| std::ptr::fn_addr_eq(cost, problem);
        let model: Option<Box<dyn ControlModel>> = match () {
            () if is(nav) => Some(Box::new(Navigation::past_one_obstacle())),
            () if is(lq) => Some(Box::new(LinearQuadratic::point_mass())),
            () => None,
        };
        Self { cost, elites, iterations: Vec::new(), model }
    }

    fn statistics(&self, costs: &[f64]) -> Iteration {
        let mut sorted = costs.to_vec();
        sorted.sort_by(f64::total_cmp);
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let elite = mean(&sorted[..self.elites.min(costs.len())]);
        Iteration { min: sorted[0], elite, mean: mean(costs), first: costs[0] }
    }
}

impl Cost for Analytic {
    /// Gradients by differences: coarse, for checks that need any solver to run, whatever it finds.
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let Outputs { costs, gradient, .. } = outputs;
        for (index, (plan, cost)) in candidates.plans().zip(costs.iter_mut()).enumerate() {
            let (mut moved, instance) = (plan.to_vec(), index / candidates.samples % 4);
            *cost = f64::from((self.cost)(instance, plan));
            let Some(gradient) = gradient else { continue };
            for (number, &value) in plan.iter().enumerate() {
                let mut at = |place: f32| {
                    moved[number] = place;
                    (self.cost)(instance, &moved)
                };
                gradient[index * plan.len() + number] = (at(value + 0.01) - at(value - 0.01)) / 0.02;
                at(value);
            }
        }
        let seen = costs.chunks(candidates.samples).map(|costs| self.statistics(costs)).collect();
        self.iterations.push(seen);
        Ok(())
    }

    fn has_gradients(&self) -> bool {
        true
    }

    fn control(&self) -> Option<&dyn ControlModel> {
        self.model.as_deref()
    }
}

/// Episodes `episodes`, whose seeds are their indices, at their first plan.
pub(super) fn keys(episodes: impl IntoIterator<Item = u64>) -> Vec<PlanKey> {
    let key = |episode| PlanKey { episode, seed: EpisodeSeed::new(episode), plan: 0 };
    episodes.into_iter().map(key).collect()
}

/// The action space of the problems with real actions.
pub(super) fn space() -> Space {
    Space::uniform_box(Dtype::F32, &[WIDTH], -1.0, 1.0)
}

/// The problem of planning real actions for `keys` from `initial`.
pub(super) fn problem<'a>(keys: &'a [PlanKey], space: &'a Space, initial: &'a [f32]) -> Problem<'a> {
    Problem { keys, horizon: HORIZON, action_block: 1, action: space, initial, memory: &[] }
}

#[test]
fn the_cheapest_plans_by_categories_are_known_by_enumeration() {
    for (instance, known) in DISC_OPTIMA.into_iter().enumerate() {
        let count = DISC_CATEGORIES.pow(DISC_HORIZON as u32);
        let cost = |number: usize| {
            let mut plan = [0.0; DISC_HORIZON * DISC_CATEGORIES];
            for t in 0..DISC_HORIZON {
                plan[t * DISC_CATEGORIES + number / DISC_CATEGORIES.pow(t as u32) % DISC_CATEGORIES] = 1.0;
            }
            disc(instance, &plan)
        };
        let found = (0..count).map(cost).fold(f32::INFINITY, f32::min);
        assert!((f64::from(found) - known).abs() < 1e-5, "instance {instance}: {found}");
    }
}
