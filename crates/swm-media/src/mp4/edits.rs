//! Which images of a track are shown and when: presentation times and the edit list (`elst`).
//!
//! Cutting without encoding keeps images from the key frame before the cut and hides them by an edit list. As in FFmpeg, and so in
//! LeRobot's decoders, an image belongs to an edit if its time does, and the first of an edit is shown where the edit begins.

use super::boxes::{Wrong, entries, find, number, signed};
use super::samples::Sample;

/// An image that is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    /// Its place among all images of the track, in the order of their times: hidden ones count.
    pub(super) rank: usize,
    /// In seconds.
    pub(super) time: f64,
}

/// Edits may show images more than once, but not more than so many times on the average: more is taken for damage.
const MAX_REPEATS: usize = 8;

/// One entry of an edit list.
#[derive(Clone, Copy, Debug)]
struct Edit {
    /// In units of the movie; 0: to the end.
    duration: u64,
    /// In units of the track; -1: nothing is shown.
    begin: i64,
}

/// The samples in the order of their times.
pub(super) fn order(samples: &[Sample]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..samples.len()).collect();
    order.sort_by_key(|&sample| (samples[sample].time, sample));
    order
}

/// The frames of a track, in the order of their times. `times` are those of all its images, sorted; `scales` are units per second, of the
/// track and of the movie.
pub(super) fn frames(
    track: &[u8],
    times: &[i64],
    scales: [u64; 2],
    is_fragmented: bool,
) -> Result<Vec<Frame>, Wrong> {
    let [scale, movie_scale] = scales.map(|scale| scale.max(1) as f64);
    let edits = read(track)?;
    if edits.iter().all(|edit| edit.begin < 0) {
        let delay: u64 = edits.iter().map(|edit| edit.duration).fold(0, u64::saturating_add);
        let delay = delay as f64 / movie_scale;
        let frame = |(rank, &time): (usize, &i64)| Frame { rank, time: delay + time as f64 / scale };
        return Ok(times.iter().enumerate().map(frame).collect());
    }
    let (mut frames, mut start) = (Vec::with_capacity(times.len()), 0.0);
    for edit in edits {
        let duration = edit.duration as f64 / movie_scale;
        if edit.begin >= 0 {
            // Of another length than the movie's rounding: an image that begins just before the end stays out.
            let end = match edit.duration {
                0 => i64::MAX,
                _ => edit.begin.saturating_add((duration * scale).round() as i64),
            };
            let shown =
                times.partition_point(|&time| time < edit.begin)..times.partition_point(|&time| time < end);
            if frames.len() + shown.len() > times.len().saturating_mul(MAX_REPEATS) {
                return Err("its edit list shows images again and again".into());
            }
            let begin = if is_fragmented { edit.begin } else { times.get(shown.start).copied().unwrap_or(0) };
            frames.extend(shown.map(|rank| {
                let since = times[rank].saturating_sub(begin) as f64 / scale;
                Frame { rank, time: start + since }
            }));
        }
        start += duration;
    }
    frames.sort_by(|a, b| a.time.total_cmp(&b.time));
    Ok(frames)
}

/// The edits of a track; none is usual.
fn read(track: &[u8]) -> Result<Vec<Edit>, Wrong> {
    let Ok(list) = find(track, b"edts").and_then(|edits| find(edits, b"elst")) else { return Ok(Vec::new()) };
    let is_long = number(list, 0, 1)? == 1;
    let width = if is_long { 20 } else { 12 };
    let mut edits = Vec::new();
    for entry in 0..entries(list, width, 4)? {
        let at = 8 + width * entry;
        let edit = match is_long {
            true => Edit { duration: number(list, at, 8)?, begin: number(list, at + 8, 8)? as i64 },
            false => Edit { duration: number(list, at, 4)?, begin: signed(list, at + 4)? },
        };
        let rate = number(list, at + width - 4, 4)?;
        if edit.begin >= 0 && rate != 0x1_0000 {
            let reason = "an edit list that changes the speed is not followed; encode the video again";
            return Err(Wrong::Unsupported(reason.to_owned()));
        }
        edits.push(edit);
    }
    Ok(edits)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A track with an edit list of durations and begins.
    fn track(edits: &[(u32, i32)]) -> Vec<u8> {
        let mut list = vec![0; 4];
        list.extend((edits.len() as u32).to_be_bytes());
        for (duration, begin) in edits {
            list.extend([duration.to_be_bytes(), begin.to_be_bytes(), 0x1_0000_u32.to_be_bytes()].concat());
        }
        let boxed =
            |name: &[u8], content: &[u8]| [&(content.len() as u32 + 8).to_be_bytes(), name, content].concat();
        boxed(b"edts", &boxed(b"elst", &list))
    }

    fn shown(edits: &[(u32, i32)], is_fragmented: bool) -> Vec<(usize, f64)> {
        // Ten images a second apart of 1000 units, the movie in units of 100; images are shown 2 s after they are decoded.
        let times: Vec<i64> = (0..10).map(|at| 2000 + 1000 * at).collect();
        let frames = frames(&track(edits), &times, [1000, 100], is_fragmented).unwrap();
        frames.iter().map(|frame| (frame.rank, frame.time)).collect()
    }

    #[test]
    fn edits_hide_shift_and_repeat() {
        assert_eq!(shown(&[], false)[..2], [(0, 2.0), (1, 3.0)]);
        assert_eq!(shown(&[(1000, 2000)], false).len(), 10);
        assert_eq!(shown(&[(300, 5000)], false), [(3, 0.0), (4, 1.0), (5, 2.0)]);
        // Between two images: the next one, at once; in fragments, when it is due.
        assert_eq!(shown(&[(200, 5500)], false), [(4, 0.0), (5, 1.0)]);
        assert_eq!(shown(&[(0, 9500)], true), [(8, 0.5), (9, 1.5)]);
        assert_eq!(shown(&[(150, -1), (100, 11_000)], false), [(9, 1.5)]);
        assert_eq!(shown(&[(150, -1)], false)[0], (0, 3.5));
        assert_eq!(shown(&[(200, 8000), (200, 2000)], false), [(6, 0.0), (7, 1.0), (0, 2.0), (1, 3.0)]);
        assert_eq!(shown(&[(100, 99_000)], false), []);
        let again = frames(&track(&[(1000, 0); 20]), &[0, 1], [1000, 100], false);
        assert!(matches!(again, Err(Wrong::Damaged(_))), "{again:?}");
    }
}
