//! What a recording takes of the machine's memory, noted before it starts where that is much.

use crate::request::{Fix, Message};

/// Memory of this machine in bytes, where the system has it in `/proc`.
pub fn machine_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// A note where `envs` episodes of up to `steps` steps, which are in memory until they end, take more than half of it.
pub fn episodes_note(envs: usize, steps: u64, row_bytes: u64, machine_bytes: Option<u64>) -> Option<Message> {
    let episode = steps.saturating_add(1).saturating_mul(row_bytes);
    let all = episode.saturating_mul(envs as u64);
    let machine = machine_bytes.filter(|&machine| all > machine / 2)?;
    let text = format!(
        "an episode is in memory until it ends: at most {} if it goes on for {steps} steps, and {} for {envs} environments, of {} on \
         this machine",
        gigabytes(episode),
        gigabytes(all),
        gigabytes(machine)
    );
    Some(Message::new(text).fix(Fix::Reduce(&["max_steps", "num_envs", "image_size"])))
}

/// `12.3 GB`.
pub fn gigabytes(bytes: u64) -> String {
    format!("{:.1} GB", bytes as f64 / 1e9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn much_memory_is_noted_before_it_is_taken() {
        let gigabyte = 1_000_000_000;
        assert_eq!(episodes_note(8, 99, 12_288, Some(16 * gigabyte)), None);
        assert_eq!(episodes_note(8, u64::MAX, 12_288, None), None);
        let note = episodes_note(8, 99_999, 20_000, Some(16 * gigabyte)).unwrap().to_string();
        for part in ["2.0 GB if", "99999 steps", "16.0 GB for 8 environments", "of 16.0 GB", "num_envs"] {
            assert!(note.contains(part), "{part}: {note}");
        }
        assert!(episodes_note(1, 1_000_000_000_000, 12_288, Some(16 * gigabyte)).is_some());
        assert!(episodes_note(1, u64::MAX, u64::MAX, Some(16 * gigabyte)).is_some());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_machine_has_memory() {
        assert!(machine_bytes().unwrap() > 100_000_000);
    }
}
