//! The rules of the expert, which knows the whole world: stays alive, and goes through the achievements in an order in which
//! each needs only what earlier ones gave.

use super::actions::is_near;
use super::rules::{Achievement, Block, Cell, action, block, direction, distance, is_solid, plus};
use super::shortest_path::{WALKS, room, toward, use_block, way_to};
use super::state::{Map, Mob, State};

/// Food, drink and energy below which the player looks for more.
const LOW: i32 = 4;
/// Cells of a shelter in which the player sleeps.
const SHELTER: usize = 3;
/// Stones that the player keeps for shelters, furnace and tools.
const STONES: u8 = 5;
/// Steps that the player goes back to a table before it builds another.
const FAR: u32 = 30;

/// The next action.
pub(super) fn choose(state: &State) -> i64 {
    if state.vitals.is_sleeping {
        return action::NOOP;
    }
    let rules: [fn(&State) -> Option<i64>; 9] =
        [fight, drink, eat, sleep, plant, tools, collect, hunt, pass_time];
    rules.into_iter().find_map(|rule| rule(state)).unwrap_or(action::NOOP)
}

/// Turns to a mob at this place and hits it.
fn hit(state: &State, mob: &Mob) -> Option<i64> {
    let walk = WALKS.into_iter().find(|&walk| plus(state.player, direction(walk)) == mob.at)?;
    Some(if state.direction == walk { action::DO } else { walk })
}

/// Hits foes beside the player.
fn fight(state: &State) -> Option<i64> {
    let foes = state.zombies.iter().chain(&state.skeletons).filter(|mob| mob.is_alive);
    foes.filter_map(|mob| hit(state, mob)).next()
}

fn drink(state: &State) -> Option<i64> {
    let is_thirsty = state.vitals.drink < LOW || !state.has_achieved(Achievement::CollectDrink);
    // Once at the water, the player drinks until it has enough.
    let is_drinking = state.vitals.drink < 9 && faces(state, block::WATER);
    (is_thirsty || is_drinking).then(|| use_block(state, block::WATER)).flatten().map(|(chosen, _)| chosen)
}

fn eat(state: &State) -> Option<i64> {
    let ripe = || use_block(state, block::RIPE_PLANT).map(|(chosen, _)| chosen);
    if !state.has_achieved(Achievement::EatPlant)
        && let Some(chosen) = ripe()
    {
        return Some(chosen);
    }
    let is_hungry = state.vitals.food < LOW || !state.has_achieved(Achievement::EatCow);
    is_hungry.then(|| reach(state, &state.cows).or_else(ripe)).flatten()
}

/// Goes to the nearest mob of a kind and hits it.
fn reach(state: &State, mobs: &[Mob]) -> Option<i64> {
    let (walk, _) = way_to(state, |cell| mobs.iter().any(|mob| mob.is_alive && mob.at == cell))?;
    Some(toward(state, walk))
}

/// Digs a shelter, closes it, and sleeps in it.
fn sleep(state: &State) -> Option<i64> {
    if state.vitals.energy >= LOW && (state.has_achieved(Achievement::WakeUp) || state.vitals.energy > 6) {
        return None;
    }
    if room(state, state.player, None, SHELTER) <= SHELTER {
        return Some(action::SLEEP);
    }
    let front = plus(state.player, direction(state.direction));
    let closes = |from: Cell, cell: Cell| room(state, from, Some(cell), SHELTER) <= SHELTER;
    if state.inventory.stone == 0 || state.inventory.wood_pickaxe == 0 {
        return (state.vitals.energy < 2).then_some(action::SLEEP);
    }
    if can_place(state) && closes(state.player, front) {
        return Some(action::PLACE_STONE);
    }
    // One cell further, the player looks at the next.
    let opens =
        |cell: Cell| Map::contains(cell) && !is_solid(state.map.block(cell)) && !state.is_occupied(cell);
    for walk in WALKS {
        let next = plus(state.player, direction(walk));
        let beyond = plus(next, direction(walk));
        if opens(next) && opens(beyond) && state.map.block(next) != block::LAVA && closes(next, beyond) {
            return Some(walk);
        }
    }
    // Into the inside of a mountain.
    let is_inside = |cell: Cell| {
        let is_rock = |cell| [block::STONE, block::COAL].contains(&state.map.block(cell));
        is_rock(cell) && WALKS.iter().all(|&walk| is_rock(plus(cell, direction(walk))))
    };
    way_to(state, is_inside).map(|(walk, _)| toward(state, walk))
}

/// Collects a sapling and plants it.
fn plant(state: &State) -> Option<i64> {
    if state.has_achieved(Achievement::PlacePlant) {
        return None;
    }
    if state.inventory.sapling > 0 && faces(state, block::GRASS) && can_place(state) {
        return Some(action::PLACE_PLANT);
    }
    use_block(state, block::GRASS).map(|(chosen, _)| chosen)
}

/// Builds table and furnace, and makes the next tool, once the player has what it needs.
fn tools(state: &State) -> Option<i64> {
    let has = &state.inventory;
    let (chosen, [wood, stone, metal]) = next_tool(state)?;
    if has.wood < wood || has.stone < stone || has.iron.min(has.coal) < metal {
        return None;
    }
    if !is_near(state, block::TABLE) {
        let way = way_to(state, |cell| state.map.block(cell) == block::TABLE);
        return match way {
            Some((walk, steps)) if steps < FAR => Some(toward(state, walk)),
            // Some wood must be left for the tool.
            _ if has.wood >= wood + 2 => place(state, action::PLACE_TABLE),
            Some((walk, _)) => Some(toward(state, walk)),
            None => None,
        };
    }
    if metal > 0 && !is_near(state, block::FURNACE) {
        return place(state, action::PLACE_FURNACE);
    }
    Some(chosen)
}

/// The next tool, and the wood, stone, and iron with coal in hand that it takes, a furnace included.
fn next_tool(state: &State) -> Option<(i64, [u8; 3])> {
    let has = &state.inventory;
    Some(match () {
        () if has.wood_pickaxe == 0 => (action::MAKE_WOOD_PICKAXE, [1, 0, 0]),
        () if has.wood_sword == 0 => (action::MAKE_WOOD_SWORD, [1, 0, 0]),
        () if has.stone_pickaxe == 0 => (action::MAKE_STONE_PICKAXE, [1, 1, 0]),
        () if has.stone_sword == 0 => (action::MAKE_STONE_SWORD, [1, 1, 0]),
        () if has.iron_pickaxe == 0 => (action::MAKE_IRON_PICKAXE, [1, 2, 1]),
        () if has.iron_sword == 0 => (action::MAKE_IRON_SWORD, [1, 2, 1]),
        () => return None,
    })
}

/// Collects what the next tools need, then a diamond.
fn collect(state: &State) -> Option<i64> {
    let has = &state.inventory;
    let use_nearest = |wanted: Block| use_block(state, wanted).map(|(chosen, _)| chosen);
    if !state.has_achieved(Achievement::PlaceStone) && has.stone > 1 {
        return place(state, action::PLACE_STONE);
    }
    let makes_more = has.iron_sword == 0 || has.iron_pickaxe == 0;
    let wood = if has.wood_pickaxe == 0 { 4 } else { 3 };
    if makes_more
        && has.wood < wood
        && let Some(chosen) = use_nearest(block::TREE)
    {
        return Some(chosen);
    }
    if has.wood_pickaxe > 0
        && has.stone < STONES
        && let Some(chosen) = use_nearest(block::STONE)
    {
        return Some(chosen);
    }
    if makes_more
        && has.wood_pickaxe > 0
        && has.coal == 0
        && let Some(chosen) = use_nearest(block::COAL)
    {
        return Some(chosen);
    }
    if makes_more
        && has.stone_pickaxe > 0
        && has.iron == 0
        && let Some(chosen) = use_nearest(block::IRON)
    {
        return Some(chosen);
    }
    let wants_diamond = has.iron_pickaxe > 0 && !state.has_achieved(Achievement::CollectDiamond);
    wants_diamond.then(|| use_nearest(block::DIAMOND)).flatten()
}

/// Goes for foes that have not been defeated yet.
fn hunt(state: &State) -> Option<i64> {
    if state.vitals.health < LOW {
        return None;
    }
    let skeletons = !state.has_achieved(Achievement::DefeatSkeleton);
    let zombies = !state.has_achieved(Achievement::DefeatZombie);
    skeletons
        .then(|| reach(state, &state.skeletons))
        .flatten()
        .or_else(|| zombies.then(|| reach(state, &state.zombies)).flatten())
        // Skeletons appear near paths.
        .or_else(|| {
            let is_path =
                |cell: Cell| state.map.block(cell) == block::PATH && distance(cell, state.player) > 12;
            skeletons.then(|| way_to(state, is_path)).flatten().map(|(walk, _)| toward(state, walk))
        })
}

/// Stays near the plant until it is ripe.
fn pass_time(state: &State) -> Option<i64> {
    let is_plant = |cell: Cell| state.map.block(cell) == block::PLANT;
    let (walk, steps) = way_to(state, is_plant)?;
    (steps > 3).then(|| toward(state, walk))
}

/// Whether the player looks at such a block.
fn faces(state: &State, wanted: Block) -> bool {
    let front = plus(state.player, direction(state.direction));
    Map::contains(front) && state.map.block(front) == wanted
}

/// Whether there is room for a block in front of the player.
fn can_place(state: &State) -> bool {
    let front = plus(state.player, direction(state.direction));
    Map::contains(front) && !is_solid(state.map.block(front)) && !state.is_occupied(front)
}

/// Places something, after a step to where there is room for it.
fn place(state: &State, chosen: i64) -> Option<i64> {
    if can_place(state) {
        return Some(chosen);
    }
    WALKS.into_iter().find(|&walk| {
        let next = plus(state.player, direction(walk));
        state.is_free(next)
    })
}
