//! What the player does: walks, collects, fights, places, crafts.

use super::rules::{Achievement, action, block, direction, is_solid, plus};
use super::state::{Inventory, Map, Mob, Plant, State};
use super::threefry::Key;

/// The cells from which a table or a furnace is near.
const NEAR: std::ops::RangeInclusive<i32> = -1..=1;

/// Makes tools.
pub(super) fn craft(state: &mut State, chosen: i64) {
    type Tool = fn(&mut Inventory) -> &mut u8;
    // Wood, stone, iron with coal; iron needs a furnace, too.
    let (tool, price, achievement): (Tool, [u8; 3], _) = match chosen {
        action::MAKE_WOOD_PICKAXE => (|i| &mut i.wood_pickaxe, [1, 0, 0], Achievement::MakeWoodPickaxe),
        action::MAKE_STONE_PICKAXE => (|i| &mut i.stone_pickaxe, [1, 1, 0], Achievement::MakeStonePickaxe),
        action::MAKE_IRON_PICKAXE => (|i| &mut i.iron_pickaxe, [1, 1, 1], Achievement::MakeIronPickaxe),
        action::MAKE_WOOD_SWORD => (|i| &mut i.wood_sword, [1, 0, 0], Achievement::MakeWoodSword),
        action::MAKE_STONE_SWORD => (|i| &mut i.stone_sword, [1, 1, 0], Achievement::MakeStoneSword),
        action::MAKE_IRON_SWORD => (|i| &mut i.iron_sword, [1, 1, 1], Achievement::MakeIronSword),
        _ => return,
    };
    let [wood, stone, metal] = price;
    let Inventory { wood: has_wood, stone: has_stone, iron, coal, .. } = state.inventory;
    let can_pay = has_wood >= wood && has_stone >= stone && iron.min(coal) >= metal;
    if !can_pay || !is_near(state, block::TABLE) || (metal > 0 && !is_near(state, block::FURNACE)) {
        return;
    }
    let inventory = &mut state.inventory;
    inventory.wood -= wood;
    inventory.stone -= stone;
    inventory.iron -= metal;
    inventory.coal -= metal;
    *tool(inventory) += 1;
    state.achieve(achievement);
}

/// Whether one of the eight cells around the player is such a block.
pub(super) fn is_near(state: &State, wanted: u8) -> bool {
    NEAR.flat_map(|row| NEAR.map(move |column| [row, column])).any(|to| {
        let cell = plus(state.player, to);
        to != [0, 0] && Map::contains(cell) && state.map.block(cell) == wanted
    })
}

/// Collects, drinks, eats or attacks what the player looks at.
pub(super) fn interact(state: &mut State, key: Key) {
    let target = plus(state.player, direction(state.direction));
    let damage = damage(&state.inventory);
    let [zombie, cow, skeleton] = [
        attack(&mut state.zombies, target, damage),
        attack(&mut state.cows, target, damage),
        attack(&mut state.skeletons, target, damage),
    ];
    if zombie.killed {
        state.achieve(Achievement::DefeatZombie);
    }
    if cow.killed {
        state.achieve(Achievement::EatCow);
        state.vitals.food = (state.vitals.food + 6).min(9);
        state.vitals.hunger = 0.0;
    }
    if skeleton.killed {
        state.achieve(Achievement::DefeatSkeleton);
    }
    let attacks = [zombie, cow, skeleton];
    if attacks.iter().any(|attack| attack.killed) {
        state.map.set_mob(target, false);
    }
    if Map::contains(target) && !attacks.iter().any(|attack| attack.hit) {
        collect(state, target, key);
    }
}

/// The strength of a blow.
fn damage(inventory: &Inventory) -> i32 {
    let Inventory { wood_sword, stone_sword, iron_sword, .. } = *inventory;
    [1, 2 * i32::from(wood_sword), 3 * i32::from(stone_sword), 5 * i32::from(iron_sword)]
        .into_iter()
        .max()
        .expect("four numbers")
}

/// What a blow led to.
#[derive(Clone, Copy)]
struct Attack {
    hit: bool,
    killed: bool,
}

/// Hits the first mob at a place. As in the original, this calls back all mobs of the kind that vanished unhurt.
fn attack(mobs: &mut [Mob], at: [i32; 2], damage: i32) -> Attack {
    let hit = mobs.iter().position(|mob| mob.is_alive && mob.at == at);
    let index = hit.unwrap_or(0);
    let was_alive = mobs[index].is_alive;
    if hit.is_some() {
        mobs[index].health -= damage;
    }
    for mob in mobs.iter_mut() {
        mob.is_alive = mob.health > 0;
    }
    Attack { hit: hit.is_some(), killed: was_alive && !mobs[index].is_alive }
}

fn collect(state: &mut State, target: [i32; 2], key: Key) {
    let has = state.inventory;
    let inventory = &mut state.inventory;
    let (count, left, achievement) = match state.map.block(target) {
        block::TREE => (&mut inventory.wood, block::GRASS, Achievement::CollectWood),
        block::STONE if has.wood_pickaxe > 0 => {
            (&mut inventory.stone, block::PATH, Achievement::CollectStone)
        }
        block::COAL if has.wood_pickaxe > 0 => (&mut inventory.coal, block::PATH, Achievement::CollectCoal),
        block::IRON if has.stone_pickaxe > 0 => (&mut inventory.iron, block::PATH, Achievement::CollectIron),
        block::DIAMOND if has.iron_pickaxe > 0 => {
            (&mut inventory.diamond, block::PATH, Achievement::CollectDiamond)
        }
        block::GRASS if key.side().uniform() < 0.1 => {
            (&mut inventory.sapling, block::GRASS, Achievement::CollectSapling)
        }
        block::WATER => {
            state.vitals.drink = (state.vitals.drink + 1).min(9);
            state.vitals.thirst = 0.0;
            return state.achieve(Achievement::CollectDrink);
        }
        block::RIPE_PLANT => {
            state.map.set_block(target, block::PLANT);
            state.vitals.food = (state.vitals.food + 4).min(9);
            state.vitals.hunger = 0.0;
            let plant = state.plants.iter().position(|plant| plant.at == target);
            state.plants[plant.unwrap_or(0)].age = 0;
            return state.achieve(Achievement::EatPlant);
        }
        _ => return,
    };
    *count += 1;
    state.map.set_block(target, left);
    state.achieve(achievement);
}

/// Places a block in front of the player.
pub(super) fn place(state: &mut State, chosen: i64) {
    let target = plus(state.player, direction(state.direction));
    if !Map::contains(target) || state.is_occupied(target) {
        return;
    }
    let before = state.map.block(target);
    let inventory = &mut state.inventory;
    let (count, price, fits, placed, achievement) = match chosen {
        action::PLACE_TABLE => {
            (&mut inventory.wood, 2, !is_solid(before), block::TABLE, Achievement::PlaceTable)
        }
        action::PLACE_FURNACE => {
            (&mut inventory.stone, 1, !is_solid(before), block::FURNACE, Achievement::PlaceFurnace)
        }
        action::PLACE_STONE => {
            let fits = before == block::WATER || !is_solid(before);
            (&mut inventory.stone, 1, fits, block::STONE, Achievement::PlaceStone)
        }
        action::PLACE_PLANT => {
            (&mut inventory.sapling, 1, before == block::GRASS, block::PLANT, Achievement::PlacePlant)
        }
        _ => return,
    };
    if !fits || *count < price {
        return;
    }
    *count -= price;
    state.map.set_block(target, placed);
    state.achieve(achievement);
    if placed == block::PLANT {
        // An eleventh plant never ripens.
        if let Some(slot) = state.plants.iter_mut().find(|plant| !plant.is_growing) {
            *slot = Plant { at: target, age: 0, is_growing: true };
        }
    }
}

/// Walks, or only turns where the way is blocked. Lava does not block it.
pub(super) fn walk(state: &mut State, chosen: i64) {
    let step = direction(chosen);
    if step == [0, 0] {
        return;
    }
    let to = plus(state.player, step);
    if state.is_free(to) || state.map.block(to) == block::LAVA {
        state.player = to;
    }
    state.direction = chosen;
}
