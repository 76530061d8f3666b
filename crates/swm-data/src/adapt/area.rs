//! Resizing of images of bytes by area: every pixel is the mean of what it covers, each pixel of the source by its part in it. Sums are
//! of whole numbers, so that the bytes are the same on every machine.

/// A part of a row or column of the source: its first pixel, and how much of each pixel there is covered, in parts of the target's size.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Span {
    first: usize,
    weights: Vec<u32>,
}

/// Tables for images of one size.
#[derive(Clone, Debug)]
pub(super) struct Area {
    rows: Vec<Span>,
    columns: Vec<Span>,
    /// `[H, W]` of the source.
    source: [usize; 2],
}

impl Area {
    pub(super) fn new(source: [usize; 2], target: [usize; 2]) -> Self {
        let [rows, columns] = [0, 1].map(|axis| spans(source[axis], target[axis]));
        Self { rows, columns, source }
    }

    /// Calls `write` with the place and the values of each pixel of the target, `[H, W, channels]`. `read` gives a byte of the source.
    pub(super) fn resize(
        &self,
        channels: usize,
        read: impl Fn(usize, usize) -> u8,
        mut write: impl FnMut(usize, usize, u8),
    ) {
        let [height, width] = self.source;
        let whole = (height * width) as u64;
        let mut sums = vec![0_u32; width * channels];
        for (y, rows) in self.rows.iter().enumerate() {
            sums.fill(0);
            for (row, &weight) in (rows.first..).zip(&rows.weights) {
                for (at, sum) in sums.iter_mut().enumerate() {
                    *sum += weight * u32::from(read(row, at));
                }
            }
            for (x, columns) in self.columns.iter().enumerate() {
                for channel in 0..channels {
                    let parts = (columns.first..).zip(&columns.weights);
                    let sum: u64 = parts
                        .map(|(column, &weight)| {
                            u64::from(sums[column * channels + channel]) * u64::from(weight)
                        })
                        .sum();
                    write(y, x * channels + channel, ((sum + whole / 2) / whole) as u8);
                }
            }
        }
    }
}

/// What each of `target` pixels covers of `source` ones. A pixel of the source is `target` units long, one of the target `source`.
fn spans(source: usize, target: usize) -> Vec<Span> {
    let one = |at: usize| {
        let (begin, end) = (at * source, (at + 1) * source);
        let (first, last) = (begin / target, (end - 1) / target);
        let covered = |pixel: usize| (end.min((pixel + 1) * target) - begin.max(pixel * target)) as u32;
        Span { first, weights: (first..=last).map(covered).collect() }
    };
    (0..target).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resized(source: [usize; 2], target: [usize; 2], channels: usize, image: &[u8]) -> Vec<u8> {
        let mut out = vec![0; target[0] * target[1] * channels];
        let (from, into) = (source[1] * channels, target[1] * channels);
        Area::new(source, target).resize(
            channels,
            |y, at| image[y * from + at],
            |y, at, value| {
                out[y * into + at] = value;
            },
        );
        out
    }

    #[test]
    fn pixels_are_means_of_what_they_cover() {
        assert_eq!(resized([2, 2], [1, 1], 1, &[0, 10, 20, 31]), [15]);
        assert_eq!(resized([1, 3], [1, 2], 1, &[0, 90, 255]), [30, 200]);
        assert_eq!(resized([1, 2], [1, 4], 1, &[7, 9]), [7, 7, 9, 9]);
        assert_eq!(resized([2, 1], [1, 1], 3, &[0, 10, 255, 10, 20, 255]), [5, 15, 255]);
        let image: Vec<u8> = (0..5 * 7 * 3).map(|at| (at * 37 % 251) as u8).collect();
        assert_eq!(resized([5, 7], [5, 7], 3, &image), image, "the same size changes nothing");
        for target in [[3, 4], [1, 7], [9, 2]] {
            assert!(resized([5, 7], target, 3, &[200; 105]).iter().all(|&value| value == 200), "{target:?}");
        }
    }

    #[test]
    fn all_of_the_source_is_covered_once() {
        for (source, target) in [(5, 3), (3, 5), (64, 64), (96, 64), (1, 4), (7, 1)] {
            let mut covered = vec![0; source];
            for span in spans(source, target) {
                assert_eq!(span.weights.iter().sum::<u32>(), source as u32);
                (span.first..).zip(span.weights).for_each(|(pixel, weight)| covered[pixel] += weight);
            }
            assert!(covered.iter().all(|&weight| weight == target as u32), "{source} {target}: {covered:?}");
        }
    }
}
