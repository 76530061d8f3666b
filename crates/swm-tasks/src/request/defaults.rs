//! Defaults and bounds that several requests share.

/// Environments that are stepped in parallel. Results do not depend on it.
pub const NUM_ENVS: usize = 8;
/// Steps after which an episode is truncated (the reference's).
pub const MAX_STEPS: u64 = 100;

/// More environments than anybody needs.
const MANY_ENVS: usize = 1 << 15;

/// No more environments than episodes, for each takes time and memory to make. Numbers above 32768 stay, so that the world
/// refuses those that it never takes, whatever the number of episodes.
pub fn envs_at_most(num_envs: usize, episodes: u64) -> usize {
    let most = usize::try_from(episodes.max(1)).unwrap_or(usize::MAX);
    if num_envs > MANY_ENVS { num_envs } else { num_envs.min(most) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn environments_are_no_more_than_episodes() {
        let made = [(8, 100), (10_000, 1), (8, 3), (0, 3), (8, 0)].map(|(envs, n)| envs_at_most(envs, n));
        assert_eq!(made, [8, 1, 3, 0, 1]);
        // Refused by the world.
        assert_eq!(envs_at_most(10_000_000, 1), 10_000_000);
    }
}
