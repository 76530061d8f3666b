//! The factors of Craftax-Classic: which world, and the constants that the original passes to its steps.

use swm_fov::{Factor, Fov, FovSpace};

use super::rules::Params;

/// A world in which skeletons come near soon.
const DANGEROUS_WORLD: i64 = 21;

/// The factor table, in sampling order.
pub(super) fn factors() -> FovSpace {
    let health = |name: &str, default: i32| Factor::integer(name, 1, 12, default.into());
    let chance = |name: &str, most: f64, default: f64| Factor::scalar(name, 0.0, most, default);
    let Params { zombie_health, cow_health, skeleton_health, day_length, despawn_distance, .. } =
        Params::default();
    FovSpace::new(vec![
        Factor::integer("world.seed", 0, i64::from(i32::MAX), 0)
            .doc("seed of the world and of all that happens in it, as of JAX's `PRNGKey`")
            .sampled_by_default(),
        Factor::integer("day.length", 50, 1000, day_length.into()).doc("steps from one night to the next"),
        chance("cows.chance", 0.5, 0.1).doc("probability per step that a cow appears"),
        health("cows.health", cow_health).doc("blows of strength 1 that kill a cow"),
        chance("zombies.chance", 0.2, 0.02).doc("probability per step that a zombie appears by day"),
        chance("zombies.night_chance", 0.5, 0.1)
            .doc("what is added to it in full darkness")
            .shows_with("day.length", 50),
        health("zombies.health", zombie_health)
            .doc("blows of strength 1 that kill a zombie")
            .shows_with("zombies.chance", 0.2),
        chance("skeletons.chance", 0.5, 0.05)
            .doc("probability per step that a skeleton appears")
            .shows_with("world.seed", DANGEROUS_WORLD),
        health("skeletons.health", skeleton_health)
            .doc("blows of strength 1 that kill a skeleton")
            .shows_with("world.seed", DANGEROUS_WORLD)
            .shows_with("skeletons.chance", 0.5),
        Factor::integer("mobs.despawn_distance", 11, 20, despawn_distance.into())
            .doc("distance from the player at which mobs vanish and below which they appear, cells"),
    ])
}

/// The constants of an assignment, and the seed of its world.
pub(super) fn params(fov: &Fov) -> (u32, Params) {
    let int = |name: &str| i32::try_from(fov.i64(name)).expect("bounds of the factors are those of i32");
    let params = Params {
        day_length: int("day.length"),
        cow_chance: fov.f64("cows.chance") as f32,
        cow_health: int("cows.health"),
        zombie_chance: fov.f64("zombies.chance") as f32,
        zombie_night_chance: fov.f64("zombies.night_chance") as f32,
        zombie_health: int("zombies.health"),
        skeleton_chance: fov.f64("skeletons.chance") as f32,
        skeleton_health: int("skeletons.health"),
        despawn_distance: int("mobs.despawn_distance"),
        ..Params::default()
    };
    (int("world.seed").unsigned_abs(), params)
}

#[cfg(test)]
mod tests {
    #[test]
    fn defaults_are_those_of_the_original() {
        assert_eq!(super::params(&super::factors().defaults()), (0, super::Params::default()));
    }
}
