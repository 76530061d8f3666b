//! The factors of SimplePointMaze, their constraints, and how the walls of an episode are placed.

use swm_core::{Dtype, EnvError, Episode, Space, Value};
use swm_fov::{Constraint, Factor, Fov, FovSpace};

use super::walls::{MAX_WALLS, SIDE, Wall, is_blocked, walls};

/// The reference's default walls: extents and corners of least coordinates, wall by wall.
const SHAPES: [f32; 2 * MAX_WALLS] = [
    1.289_385_2,
    0.840_687_3,
    1.244_401_8,
    1.042_815_8,
    0.659_792_54,
    1.363_933_2, //
    1.112_480_2,
    1.099_487_4,
    0.963_911_9,
    0.616_462_47,
    0.714_128_6,
    0.655_603_7,
];
const POSITIONS: [f32; 2 * MAX_WALLS] = [
    1.035_264_5,
    3.455_474_9,
    3.002_354_6,
    3.442_296_5,
    1.534_523_5,
    2.916_535_6, //
    2.142_178_5,
    2.783_088,
    1.260_334_3,
    3.453_317_9,
    1.504_300_8,
    2.397_299_3,
];
/// Samples of a wall's position before an episode is refused.
const MAX_TRIES: usize = 10_000;

/// The factor table, in sampling order. Lengths are in units of which the room is 5 wide.
pub(super) fn factors() -> FovSpace {
    let position =
        |name: &str, default: f32| Factor::vector_f32(name, 0.0, f64::from(SIDE), &[default, default]);
    let per_wall = |name: &str, [low, high]: [f64; 2], default: &[f32]| {
        let shape = [MAX_WALLS, 2];
        let default = Value { shape: shape.to_vec(), ..Value::vector(default) };
        Factor::new(name, Space::uniform_box(Dtype::F32, &shape, low, high), default)
    };
    let space = FovSpace::new(vec![
        Factor::integer("walls.number", 4, MAX_WALLS as i64, 5).doc("how many of the walls there are"),
        Factor::rgb("walls.color", [0, 0, 0]).doc("color of the walls"),
        per_wall("walls.shape", [0.5, 1.5], &SHAPES).doc("width and height of each wall"),
        per_wall("walls.positions", [0.0, f64::from(SIDE)], &POSITIONS)
            .doc("least x, y of each wall; sampled clear of an agent and a goal that are not sampled"),
        Factor::rgb("agent.color", [255, 0, 0]).doc("color of the disc"),
        Factor::scalar_f32("agent.radius", 0.05, 0.5, 0.1).doc("radius of the disc"),
        position("agent.position", 0.5).doc("start x, y of the disc").sampled_by_default(),
        Factor::scalar_f32("agent.speed", 0.05, 2.0, 1.0).doc("distance of a step per unit of action"),
        Factor::rgb("goal.color", [0, 255, 0]).doc("color of the goal, half transparent"),
        Factor::scalar_f32("goal.radius", 0.05, 0.5, 0.2).doc("the goal is reached within this distance"),
        position("goal.position", 4.5).doc("x, y of the goal"),
        Factor::rgb("background.color", [255, 255, 255]).doc("color of the floor"),
    ]);
    const WALLS: &[&str] = &["walls.number", "walls.shape", "walls.positions"];
    space.with_constraints(vec![
        Constraint {
            owner: "walls.positions",
            reads: &["walls.number", "walls.shape"],
            words: "every wall lies in the room",
            holds: |fov| walls(fov).iter().all(Wall::is_inside),
        },
        Constraint {
            owner: "agent.position",
            reads: &["walls.number", "walls.shape", "walls.positions", "agent.radius"],
            words: "clear of the walls",
            holds: |fov| is_clear(fov, "agent"),
        },
        Constraint {
            owner: "goal.position",
            reads: WALLS,
            words: "clear of the walls by goal.radius",
            holds: |fov| is_clear(fov, "goal"),
        },
    ])
}

/// Whether the disc of an agent or a goal overlaps no wall.
fn is_clear(fov: &Fov, thing: &str) -> bool {
    let [position, radius] = ["position", "radius"].map(|part| format!("{thing}.{part}"));
    !is_blocked(&walls(fov), fov.vector(&position), fov.f32(&radius))
}

/// The factors of an episode. Positions of a recorded start and goal are used in place of those of the factors.
///
/// Walls that are sampled are placed one by one: six that are sampled together rarely lie in the room all of them.
pub(super) fn sample(
    env: &str,
    space: &FovSpace,
    episode: &Episode<'_>,
    [start, goal]: [Option<[f32; 2]>; 2],
) -> Result<Fov, EnvError> {
    let recorded = [("agent", start), ("goal", goal)];
    let mut options = episode.options.clone();
    let is_set = |name: &str| episode.options.variation_values.contains_key(name);
    let fov = space.sample_where(env, episode, |_| false)?;
    if fov.touched("walls.positions") && !is_set("walls.positions") {
        // Things that stand still already; what is sampled later is sampled clear of the walls.
        let still = recorded.iter().filter_map(|&(thing, at)| {
            let name = format!("{thing}.position");
            let is_sampled = at.is_none() && fov.touched(&name) && !is_set(&name);
            let at = at.unwrap_or_else(|| fov.vector(&name));
            (!is_sampled).then(|| (at, fov.f32(&format!("{thing}.radius"))))
        });
        let placed = place(env, &fov, episode, &still.collect::<Vec<_>>())?;
        options = options.set("walls.positions", placed);
    }
    let applies = |rule: &Constraint| match rule.owner {
        "agent.position" => start.is_none(),
        "goal.position" => goal.is_none(),
        _ => true,
    };
    space.sample_where(env, &Episode::new(episode.seed, &options), applies)
}

/// Positions of walls in the room and clear of the discs `still`.
fn place(env: &str, fov: &Fov, episode: &Episode<'_>, still: &[([f32; 2], f32)]) -> Result<Value, EnvError> {
    let shapes = fov.vector::<f32, { 2 * MAX_WALLS }>("walls.shape");
    let space = Space::uniform_box(Dtype::F32, &[2], 0.0, f64::from(SIDE));
    let mut stream = episode.seed.stream("walls.positions of each wall");
    let mut positions = Vec::with_capacity(2 * MAX_WALLS);
    for shape in shapes.as_chunks::<2>().0 {
        let found = (0..MAX_TRIES).find_map(|_| {
            let sampled = space.sample(&mut stream);
            let min: [f32; 2] = sampled.data.as_slice().get::<f32>()?.try_into().ok()?;
            let wall = Wall::new(min, *shape);
            let is_clear = !still.iter().any(|&(center, radius)| wall.meets(center, radius));
            (wall.is_inside() && is_clear).then_some(min)
        });
        let min = found.ok_or_else(|| EnvError::Constraint {
            env: env.to_owned(),
            reason: format!(
                "none of {MAX_TRIES} sampled positions of a wall of {shape:?} in `walls.positions` is clear of agent and goal; \
                 sample or set agent.position, goal.position, walls.shape"
            ),
        })?;
        positions.extend(min);
    }
    Ok(Value { shape: vec![MAX_WALLS, 2], ..Value::vector(&positions) })
}
