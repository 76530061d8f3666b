//! What a training takes of the machine's memory, noted before it starts where that is much.

#[cfg(feature = "baselines")]
pub(super) use swm_tasks::memory::{gigabytes, machine_bytes};

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

#[cfg(all(test, feature = "baselines"))]
mod tests {
    use super::*;

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
}
