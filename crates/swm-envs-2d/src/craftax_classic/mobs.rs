//! How zombies, cows, skeletons and arrows move and attack.

use super::rules::{Achievement, Cell, Params, action, block, direction, distance, is_solid, minus, plus};
use super::state::{ARROWS, Arrow, COWS, Map, Mob, SKELETONS, State, ZOMBIES};
use super::threefry::Key;

/// Moves everything that lives or flies.
pub(super) fn update(state: &mut State, key: Key, params: &Params) {
    let mut link = key.next();
    for index in 0..ZOMBIES {
        link = move_zombie(state, index, link, params);
    }
    link = link.next();
    for index in 0..COWS {
        link = move_cow(state, index, link, params);
    }
    link = link.next();
    for index in 0..SKELETONS {
        link = move_skeleton(state, index, link, params);
    }
    for index in 0..ARROWS {
        move_arrow(state, index);
    }
}

/// A step in a random direction.
fn random_step(key: Key) -> Cell {
    direction(action::LEFT + i64::from(key.below_power_of_two(4)))
}

/// The step along the longer way to the player; between equal ones `key` decides.
fn step_to_player(state: &State, from: Cell, key: Key) -> Cell {
    let [rows, columns] = minus(state.player, from);
    let is_along_rows = match rows.abs().cmp(&columns.abs()) {
        std::cmp::Ordering::Equal => key.uniform() >= 0.5,
        order => order.is_gt(),
    };
    if is_along_rows { [rows.signum(), 0] } else { [0, columns.signum()] }
}

/// Puts a mob onto its new cell, and lets it vanish if it was too far from the player. `mark` is whether it lived until now.
fn settle(state: &mut State, mob: &mut Mob, to: Cell, params: &Params) {
    let to = if state.is_free(to) { to } else { mob.at };
    let stays = distance(mob.at, state.player) < params.despawn_distance;
    if mob.is_alive {
        state.map.set_mob(mob.at, false);
    }
    mob.is_alive &= stays;
    mob.at = to;
    if mob.is_alive {
        state.map.set_mob(to, true);
    }
}

/// Moves a zombie: towards the player if near, else anywhere. Returns the next link of the keys.
fn move_zombie(state: &mut State, index: usize, key: Key, params: &Params) -> Key {
    let mut mob = state.zombies[index];
    let (second, third) = (key.next(), key.next().next());
    let away = distance(mob.at, state.player);
    let attacks = away == 1 && mob.cooldown <= 0 && mob.is_alive;
    let to = if attacks {
        mob.at
    } else if away < 10 && third.side().uniform() < 0.75 {
        plus(mob.at, step_to_player(state, mob.at, second.side()))
    } else {
        plus(mob.at, random_step(key.side()))
    };
    mob.cooldown = if attacks { 5 } else { mob.cooldown - 1 };
    if attacks {
        if state.vitals.is_sleeping {
            state.achieve(Achievement::WakeUp);
        }
        state.vitals.health -= if state.vitals.is_sleeping { 7 } else { 2 };
        state.vitals.is_sleeping = false;
    }
    settle(state, &mut mob, to, params);
    state.zombies[index] = mob;
    // The original goes on with the side key here.
    third.next().side()
}

/// Moves a cow: in half of the steps, to a random side.
fn move_cow(state: &mut State, index: usize, key: Key, params: &Params) -> Key {
    let mut mob = state.cows[index];
    let step = direction(action::LEFT + i64::from(key.side().below_power_of_two(8)));
    let to = plus(mob.at, step);
    settle(state, &mut mob, to, params);
    state.cows[index] = mob;
    key.next()
}

/// Moves a skeleton: mostly anywhere, now and then towards the player if far, away if near. Lets it shoot.
fn move_skeleton(state: &mut State, index: usize, key: Key, params: &Params) -> Key {
    let mut mob = state.skeletons[index];
    let (second, third) = (key.next(), key.next().next());
    let away = distance(mob.at, state.player);
    let (is_far, is_close) = (away >= 10, away <= 3);
    let towards = step_to_player(state, mob.at, second.side());
    let step = if (is_far || is_close) && third.side().uniform() > 0.85 {
        if is_close { towards.map(|c| -c) } else { towards }
    } else {
        random_step(key.side())
    };
    let mut to = plus(mob.at, step);
    let wants_to_shoot = (4..=5).contains(&away) || (is_close && !state.is_free(to));
    let shoots = wants_to_shoot && mob.cooldown <= 0 && mob.is_alive;
    if shoots {
        if let Some(slot) = state.arrows.iter_mut().find(|arrow| !arrow.is_flying) {
            *slot = Arrow { at: mob.at, direction: towards, is_flying: true };
        }
        to = mob.at;
    }
    mob.cooldown = if shoots { 4 } else { mob.cooldown - 1 };
    settle(state, &mut mob, to, params);
    state.skeletons[index] = mob;
    third.next()
}

/// Moves an arrow until it hits. Slots without an arrow move on, too: the view reads where they are.
fn move_arrow(state: &mut State, index: usize) {
    let arrow = &mut state.arrows[index];
    let to = plus(arrow.at, arrow.direction);
    arrow.at = to;
    if !arrow.is_flying {
        return;
    }
    let hit = state.map.block(to);
    let flies_on = Map::contains(to) && (!is_solid(hit) || hit == block::WATER) && !state.is_occupied(to);
    state.arrows[index].is_flying = flies_on;
    if to == state.player {
        state.vitals.health -= 2;
        state.vitals.is_sleeping = false;
    }
    if [block::FURNACE, block::TABLE].contains(&hit) {
        state.map.set_block(to, block::PATH);
    }
}
