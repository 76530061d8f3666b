//! One step of the game.

use super::rules::{Params, TIME_LIMIT, action};
use super::state::State;
use super::threefry::Key;
use super::{actions, mobs, spawning, vitals};

/// The most that the player carries of anything.
const MOST: u8 = 9;

/// Plays one step; returns its reward: 1 for each new achievement, 0.1 for each point of health.
pub(super) fn step(state: &mut State, chosen: i64, params: &Params) -> f32 {
    let (achievements, health) = (state.achievements, state.vitals.health);
    let key = Key::from_words(state.key);
    let first = key.side();
    let (second, chosen) = (first.next(), if state.vitals.is_sleeping { action::NOOP } else { chosen });
    let third = second.next();

    actions::craft(state, chosen);
    if chosen == action::DO {
        actions::interact(state, first.side());
    }
    actions::place(state, chosen);
    actions::walk(state, chosen);
    mobs::update(state, second.side(), params);
    spawning::spawn(state, third.side(), params);
    vitals::grow(state);
    vitals::live(state, chosen);
    state.inventory.cap(MOST);
    if state.is_in_lava() {
        state.vitals.health = 0;
    }
    state.vitals.health = state.vitals.health.max(0);

    state.steps += 1;
    state.light = vitals::light(state.steps, params.day_length);
    state.key = key.next().words();
    state.noise_key = third.words();
    let gained = (state.achievements.count_ones() - achievements.count_ones()) as f32;
    gained + (state.vitals.health - health) as f32 * 0.1
}

/// Whether the game is over.
pub(super) fn is_over(state: &State) -> bool {
    state.steps >= TIME_LIMIT || state.is_in_lava() || state.vitals.health <= 0
}
