//! Sums over a few values, in the order in which the suite's Python adds them up: the last bit depends on it.

/// The distance of two points.
pub fn distance<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}

/// The mean of fewer than 128 values: eight sums side by side, which are then added in pairs.
pub fn mean(values: &[f64]) -> f64 {
    let (whole, rest) = values.split_at(values.len() / 8 * 8);
    let mut sums = [0.0; 8];
    for chunk in whole.chunks_exact(8) {
        sums.iter_mut().zip(chunk).for_each(|(sum, value)| *sum += value);
    }
    let [a, b, c, d, e, f, g, h] = sums;
    let start = ((a + b) + (c + d)) + ((e + f) + (g + h));
    rest.iter().fold(start, |sum, value| sum + value) / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_distances_are_those_of_the_numbers() {
        let values: Vec<f64> = (1..=21).map(f64::from).collect();
        assert_eq!(mean(&values), 11.0);
        assert_eq!(mean(&values[..3]), 2.0);
        assert_eq!(distance([0.0, 3.0, 1.0], [4.0, 0.0, 1.0]), 5.0);
    }
}
