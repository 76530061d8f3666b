//! What a training takes of the machine's memory, noted before it starts where that is much.

use serde_json::json;
use swm_tasks::memory::gigabytes;
use swm_tasks::request::{Assignment, Fix, Message};

/// Memory of a training step on a CPU, over that of its images as 32-bit numbers: measured with the small presets of `lewm` and
/// `pldm` (8), and of `conv-jepa` (20).
const STEP_OVER_IMAGES: [u64; 2] = [8, 20];

/// A note where a training step on `clips` clips with images of `clip_bytes` may take more than there is.
pub(super) fn step_note(clips: usize, clip_bytes: u64, machine_bytes: Option<u64>) -> Option<Message> {
    let images = (clips as u64).saturating_mul(clip_bytes);
    let [least, most] = STEP_OVER_IMAGES.map(|factor| images.saturating_mul(factor));
    let machine = machine_bytes.filter(|&machine| most > machine)?;
    let text = format!(
        "a step on {clips} clips takes about {} to {} of memory, of {} on this machine",
        gigabytes(least),
        gigabytes(most),
        gigabytes(machine)
    );
    Some(Message::new(text).fix(Fix::Reduce(&["batch"])))
}

/// A note where so many steps and bytes take more than half of the machine's memory.
pub(super) fn steps_note([steps, bytes]: [u64; 2], machine_bytes: Option<u64>) -> Option<Message> {
    let machine = machine_bytes.filter(|&machine| bytes > machine / 2)?;
    let text = format!(
        "steps that are learned from are in memory: {} once there are {steps}, of {} on this machine",
        size(bytes),
        size(machine)
    );
    let of = |name: &str, value: &str| Assignment::of("set", json!({ name: value }));
    let settings = vec![of("collect.capacity", "STEPS"), of("image.size", "PIXELS")];
    Some(Message::new(text).fix(Fix::With { how: "give smaller", settings, to: "to take less" }))
}

/// Bytes, in megabytes or gigabytes.
pub(super) fn size(bytes: u64) -> String {
    match bytes {
        ..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => gigabytes(bytes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_batch_beyond_the_memory_is_told_before_it_is_taken() {
        let clip = 4 * 64 * 64 * 3 * 4;
        assert_eq!(step_note(256, clip, Some(16_000_000_000)), None);
        assert_eq!(step_note(usize::MAX, clip, None), None);
        let said = step_note(100_000, clip, Some(16_000_000_000)).unwrap().to_string();
        assert!(
            said.starts_with("a step on 100000 clips takes about 157.3 GB to 393.2 GB of memory, of 16.0 GB"),
            "{said}"
        );
    }

    #[test]
    fn a_replay_buffer_that_takes_much_memory_is_noted_before_it_does() {
        assert_eq!(steps_note([1_000, 7_000_000], Some(16_000_000_000)), None);
        assert_eq!(steps_note([1_000_000, 12_000_000_000], None), None);
        let note = steps_note([1_000_000, 12_300_000_000], Some(16_000_000_000)).unwrap().to_string();
        for part in ["12.3 GB once there are 1000000, of 16.0 GB", "collect.capacity", "image.size"] {
            assert!(note.contains(part), "{part}: {note}");
        }
    }
}
