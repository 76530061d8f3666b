//! How a world is made: Perlin noise with thresholds.

use super::rules::{Block, Cell, Params, block, distance};
use super::spawning::Weights;
use super::state::{Map, SIDE, State};
use super::threefry::Key;
use super::vitals::light;

/// Cells of a map.
const CELLS: usize = SIDE * SIDE;

/// A value per cell, row by row.
type Layer = Vec<f32>;

/// The world of a key, as `jax.random.PRNGKey(seed)` gives it, with the player in it.
pub(super) fn generate(seed: u32, params: &Params) -> State {
    let episode = Key::new(seed);
    // Each layer takes the side key of the next link of a chain; some links are not used.
    let mut link = episode.side();
    let mut side = || {
        let side = link.side();
        link = link.next();
        (side, link)
    };
    let proximity = proximity();
    let water = near_player(noise(side().0, [4, 4]), &proximity);
    side();
    let mountain = noise(side().0, [4, 4]).into_iter().map(|value| value + 0.05).collect();
    let mountain = near_player(mountain, &proximity);
    let paths = noise(side().0, [8, 32]);
    side();
    let (coal, iron, diamonds) = (side().0, side().0, side().0);
    let (tree_key, tree_chance) = side();
    let trees = noise(tree_key, [16, 16]);

    let at = |cell: usize| -> Block {
        let crossed = cell % SIDE * SIDE + cell / SIDE;
        let (water, mountain, index) = (water[cell], mountain[cell], cell as u32);
        if mountain > 0.85 && trees[cell] > 0.7 {
            return block::LAVA;
        }
        if mountain > 0.7 {
            let is_path = paths[cell] > 0.8 || paths[crossed] > 0.8 || (mountain > 0.85 && water > 0.4);
            return if is_path {
                block::PATH
            } else if coal.uniform_at(index) < 0.04 {
                block::COAL
            } else if iron.uniform_at(index) < 0.03 {
                block::IRON
            } else if mountain > 0.8 && diamonds.uniform_at(index) < 0.005 {
                block::DIAMOND
            } else {
                block::STONE
            };
        }
        if water > 0.7 {
            block::WATER
        } else if water > 0.6 {
            block::SAND
        } else if trees[cell] > 0.5 && tree_chance.uniform_at(index) > 0.8 {
            block::TREE
        } else {
            block::GRASS
        }
    };
    let mut blocks: Vec<Block> = (0..CELLS).map(at).collect();
    blocks[SIDE / 2 * SIDE + SIDE / 2] = block::GRASS;
    let noise_key = tree_chance;
    let diamond = Weights::new(|cell| blocks[cell] == block::STONE).choose(noise_key.side());
    if let Some(cell) = diamond {
        blocks[cell] = if params.always_diamond { block::DIAMOND } else { block::STONE };
    }
    State::new(Map::new(blocks), params.cow_health, light(0, params.day_length), episode.next(), noise_key)
}

/// How far the start is, 0 near to 1 far.
fn proximity() -> Layer {
    let start: Cell = [SIDE as i32 / 2; 2];
    (0..CELLS)
        .map(|cell| {
            let steps = distance([(cell / SIDE) as i32, (cell % SIDE) as i32], start);
            (steps as f32 / 5.0).clamp(0.0, 1.0)
        })
        .collect()
}

/// Lowers a layer near the start, so that the player begins on grass.
fn near_player(mut layer: Layer, proximity: &Layer) -> Layer {
    for (value, proximity) in layer.iter_mut().zip(proximity) {
        *value = *value + proximity - 1.0;
    }
    layer
}

/// Fractal noise of one octave, 0 to 1: Perlin's, with gradients on a lattice of `lattice` rows and columns.
fn noise(key: Key, lattice: [usize; 2]) -> Layer {
    let mut layer = perlin(key.side().side(), lattice);
    let least = layer.iter().copied().fold(f32::INFINITY, f32::min);
    let most = layer.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    for value in &mut layer {
        *value = (*value - least) / (most - least);
    }
    layer
}

fn perlin(key: Key, lattice: [usize; 2]) -> Layer {
    let [rows, columns] = lattice.map(axis);
    let across = lattice[1] + 1;
    let gradients: Vec<[f32; 2]> = (0..(lattice[0] + 1) * across)
        .map(|index| {
            let angle = std::f32::consts::TAU * key.uniform_at(index as u32);
            [angle.cos(), angle.sin()]
        })
        .collect();
    let mut layer = Vec::with_capacity(CELLS);
    for &(row, u, down) in &rows {
        for &(column, v, right) in &columns {
            let ramp = |below: usize, beside: usize| {
                let [x, y] = gradients[(row + below) * across + column + beside];
                fused(v - beside as f32, y, (u - below as f32) * x)
            };
            let mix = |beside: usize| fused(down, ramp(1, beside), ramp(0, beside) * (1.0 - down));
            layer.push(std::f32::consts::SQRT_2 * fused(right, mix(1), (1.0 - right) * mix(0)));
        }
    }
    layer
}

/// For each row or column: its place on the lattice, how far it is to the next, 0 to 1, and how much that one counts.
fn axis(lattice: usize) -> [(usize, f32, f32); SIDE] {
    let cells = SIDE / lattice;
    std::array::from_fn(|i| {
        let t = (i % cells) as f32 / cells as f32;
        (i / cells, t, t * t * t * (t * (t * 6.0 - 15.0) + 10.0))
    })
}

/// a · b + c with one rounding, as the original's compiler contracts them; on every machine alike.
pub(super) fn fused(a: f32, b: f32, c: f32) -> f32 {
    (f64::from(a) * f64::from(b) + f64::from(c)) as f32
}
