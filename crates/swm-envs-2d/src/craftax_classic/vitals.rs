//! What time does: to the player's body, to plants, to the light.

use super::rules::{Achievement, action, block};
use super::state::State;
use super::world::fused;

/// Steps until a sapling is ripe.
const RIPE_AGE: i32 = 600;

/// The light at a step, 0 to 1: 1 - |cos(π (t / day + 0.3))|³, each part rounded as in the original.
pub(super) fn light(steps: u32, day_length: i32) -> f32 {
    let days = steps as f32 * (1.0 / day_length as f32);
    let cosine = (std::f32::consts::PI * (days % 1.0 + 0.3)).cos().abs();
    fused(-(cosine * cosine), cosine, 1.0)
}

/// Lets plants grow.
pub(super) fn grow(state: &mut State) {
    for plant in state.plants.iter_mut().filter(|plant| plant.is_growing) {
        plant.age += 1;
        if plant.age >= RIPE_AGE {
            state.map.set_block(plant.at, block::RIPE_PLANT);
        }
    }
}

/// Sleep, hunger, thirst, fatigue and what they do to the health.
pub(super) fn live(state: &mut State, chosen: i64) {
    let vitals = &mut state.vitals;
    vitals.is_sleeping |= chosen == action::SLEEP && vitals.energy < 9;
    let wakes_up = vitals.is_sleeping && vitals.energy >= 9;
    vitals.is_sleeping &= !wakes_up;

    let need = if vitals.is_sleeping { 0.5 } else { 1.0 };
    vitals.hunger += need;
    if vitals.hunger > 25.0 {
        (vitals.hunger, vitals.food) = (0.0, (vitals.food - 1).max(0));
    }
    vitals.thirst += need;
    if vitals.thirst > 20.0 {
        (vitals.thirst, vitals.drink) = (0.0, (vitals.drink - 1).max(0));
    }
    vitals.fatigue = if vitals.is_sleeping { (vitals.fatigue - 1.0).min(0.0) } else { vitals.fatigue + 1.0 };
    if vitals.fatigue > 30.0 {
        (vitals.fatigue, vitals.energy) = (0.0, (vitals.energy - 1).max(0));
    }
    if vitals.fatigue < -10.0 {
        (vitals.fatigue, vitals.energy) = (0.0, (vitals.energy + 1).min(9));
    }

    let is_well = vitals.food > 0 && vitals.drink > 0 && (vitals.energy > 0 || vitals.is_sleeping);
    vitals.recover += match (is_well, vitals.is_sleeping) {
        (true, true) => 2.0,
        (true, false) => 1.0,
        (false, true) => -0.5,
        (false, false) => -1.0,
    };
    if vitals.recover > 25.0 {
        (vitals.recover, vitals.health) = (0.0, (vitals.health + 1).min(9));
    }
    if vitals.recover < -15.0 {
        (vitals.recover, vitals.health) = (0.0, vitals.health - 1);
    }
    if wakes_up {
        state.achieve(Achievement::WakeUp);
    }
}
