//! What a recording or a training takes of the machine's memory, said before it starts where that is much.

/// Memory of this machine in bytes, where the system tells.
pub(super) fn machine_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// A note where `envs` episodes of up to `steps` steps, which are in memory until they end, take more than half of it.
pub(super) fn note(envs: usize, steps: u64, row_bytes: u64, machine_bytes: Option<u64>) -> Option<String> {
    let episode = steps.saturating_add(1).saturating_mul(row_bytes);
    let all = episode.saturating_mul(envs as u64);
    let machine = machine_bytes.filter(|&machine| all > machine / 2)?;
    Some(format!(
        "an episode is in memory until it ends: at most {} if it goes on for {steps} steps, and {} for {envs} environments, of {} on \
         this machine; a smaller --max-steps, --num-envs or --image-size takes less",
        gigabytes(episode),
        gigabytes(all),
        gigabytes(machine)
    ))
}

/// Memory of a training step on a CPU, over that of its images as 32-bit numbers: measured with the small presets of `lewm` and
/// `pldm` (8), and of `conv-jepa` (20).
#[cfg(feature = "baselines")]
const STEP_OVER_IMAGES: [u64; 2] = [8, 20];

/// A note where a training step on `clips` clips with images of `clip_bytes` may take more than there is.
#[cfg(feature = "baselines")]
pub(super) fn step_note(clips: usize, clip_bytes: u64, machine_bytes: Option<u64>) -> Option<String> {
    let images = (clips as u64).saturating_mul(clip_bytes);
    let [least, most] = STEP_OVER_IMAGES.map(|factor| images.saturating_mul(factor));
    let machine = machine_bytes.filter(|&machine| most > machine)?;
    Some(format!(
        "a step on {clips} clips takes about {} to {} of memory, of {} on this machine; a smaller --batch takes less",
        gigabytes(least),
        gigabytes(most),
        gigabytes(machine)
    ))
}

/// `12.3 GB`.
pub(super) fn gigabytes(bytes: u64) -> String {
    format!("{:.1} GB", bytes as f64 / 1e9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(feature = "baselines")]
    #[test]
    fn a_batch_beyond_the_memory_is_told_before_it_is_taken() {
        let clip = 4 * 64 * 64 * 3 * 4;
        assert_eq!(step_note(256, clip, Some(16_000_000_000)), None);
        assert_eq!(step_note(usize::MAX, clip, None), None);
        let said = step_note(100_000, clip, Some(16_000_000_000)).unwrap();
        assert!(
            said.starts_with("a step on 100000 clips takes about 157.3 GB to 393.2 GB of memory, of 16.0 GB"),
            "{said}"
        );
    }

    #[test]
    fn much_memory_is_told_before_it_is_taken() {
        let gigabyte = 1_000_000_000;
        assert_eq!(note(8, 99, 12_288, Some(16 * gigabyte)), None);
        assert_eq!(note(8, u64::MAX, 12_288, None), None);
        let said = note(8, 99_999, 20_000, Some(16 * gigabyte)).unwrap();
        for part in ["2.0 GB if", "99999 steps", "16.0 GB for 8 environments", "of 16.0 GB", "--num-envs"] {
            assert!(said.contains(part), "{part}: {said}");
        }
        assert!(note(1, 1_000_000_000_000, 12_288, Some(16 * gigabyte)).is_some());
        assert!(note(1, u64::MAX, u64::MAX, Some(16 * gigabyte)).is_some());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_machine_has_memory() {
        assert!(machine_bytes().unwrap() > 100_000_000);
    }
}
