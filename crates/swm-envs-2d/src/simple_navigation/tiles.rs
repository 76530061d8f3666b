//! The tiles that images are made of, as MiniGrid draws them: at three times their size, then averaged.

use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

use swm_render::Rgb;

/// The side of a tile, px.
pub(super) const TILE_PX: usize = 32;
/// Samples of a pixel along each axis.
const SAMPLES: usize = 3;
const SAMPLED: usize = TILE_PX * SAMPLES;
/// Width of the grid's lines, as a share of the tile.
const LINE: f64 = 0.031;
/// How much lighter seen cells are.
const LIGHT: f64 = 0.3;

const GRAY: Rgb = [100; 3];
const GREEN: Rgb = [0, 255, 0];
const RED: Rgb = [255, 0, 0];
/// Corners of the agent that looks right, as shares of the tile.
const AGENT: [[f32; 2]; 3] = [[0.12, 0.19], [0.87, 0.50], [0.12, 0.81]];

/// What a cell holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Thing {
    Floor,
    Wall,
    Goal,
}

/// The pixels of a tile, `[32, 32]`.
pub(super) type Tile = [[Rgb; TILE_PX]; TILE_PX];

/// Every tile: of each thing, unseen, seen, and seen with the agent in each direction.
static TILES: LazyLock<Vec<Tile>> = LazyLock::new(|| {
    let looks = [(None, false), (None, true)].into_iter().chain((0..4).map(|to| (Some(to), true)));
    let looks: Vec<_> = looks.collect();
    let things = [Thing::Floor, Thing::Wall, Thing::Goal];
    things.iter().flat_map(|&thing| looks.iter().map(move |&(agent, lit)| make(thing, agent, lit))).collect()
});

/// The tile of a thing; `agent` is the direction of an agent on it. A tile with an agent is always seen.
pub(super) fn tile(thing: Thing, agent: Option<i64>, is_seen: bool) -> &'static Tile {
    let look = match agent {
        Some(direction) => 2 + direction.rem_euclid(4) as usize,
        None => usize::from(is_seen),
    };
    &TILES[6 * thing as usize + look]
}

fn make(thing: Thing, agent: Option<i64>, is_seen: bool) -> Tile {
    let sample = |x: usize, y: usize| -> Rgb {
        let [u, v] = [x, y].map(|c| (c as f64 + 0.5) / SAMPLED as f64);
        let color = match thing {
            Thing::Wall => GRAY,
            Thing::Goal => GREEN,
            Thing::Floor if u <= LINE || v <= LINE => GRAY,
            Thing::Floor => [0; 3],
        };
        let color = match agent {
            Some(direction) if is_in_agent([u, v], direction) => RED,
            _ => color,
        };
        let lighter = |channel: u8| (f64::from(channel) + LIGHT * f64::from(255 - channel)) as u8;
        if is_seen { color.map(lighter) } else { color }
    };
    std::array::from_fn(|y| {
        std::array::from_fn(|x| {
            let mut sums = [0_u32; 3];
            for dy in 0..SAMPLES {
                for dx in 0..SAMPLES {
                    let color = sample(SAMPLES * x + dx, SAMPLES * y + dy);
                    sums.iter_mut().zip(color).for_each(|(sum, channel)| *sum += u32::from(channel));
                }
            }
            sums.map(|sum| (sum / (SAMPLES * SAMPLES) as u32) as u8)
        })
    })
}

/// Whether a place of the tile lies in an agent's triangle, by barycentric coordinates.
fn is_in_agent([x, y]: [f64; 2], direction: i64) -> bool {
    let (sin, cos) = (-FRAC_PI_2 * direction as f64).sin_cos();
    let [x, y] = [x - 0.5, y - 0.5];
    let place = [0.5 + x * cos - y * sin, 0.5 + y * cos + x * sin];
    let [a, b, c] = AGENT.map(|corner| corner.map(f64::from));
    let minus = |p: [f64; 2], q: [f64; 2]| [p[0] - q[0], p[1] - q[1]];
    let dot = |p: [f64; 2], q: [f64; 2]| p[0] * q[0] + p[1] * q[1];
    let (to_c, to_b, to_place) = (minus(c, a), minus(b, a), minus(place, a));
    let (cc, cb, bb) = (dot(to_c, to_c), dot(to_c, to_b), dot(to_b, to_b));
    let (cp, bp) = (dot(to_c, to_place), dot(to_b, to_place));
    let scale = 1.0 / (cc * bb - cb * cb);
    let (u, v) = ((bb * cp - cb * bp) * scale, (cc * bp - cb * cp) * scale);
    u >= 0.0 && v >= 0.0 && u + v < 1.0
}
