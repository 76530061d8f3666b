//! The nearest point of the probability simplex.

/// Replaces `values`, `[C]`, by the nearest point (in the Euclidean sense) whose values are 0 or more and add up to 1.
/// `scratch` is as long. Values that are not finite stay as they are.
///
/// Source: Held, Wolfe & Crowder, *Validation of subgradient optimization* (1974): all values are reduced by one
/// level and cut at 0, such that the rest adds up to 1; the level follows from the values in descending order.
pub(crate) fn project_to_simplex(values: &mut [f32], scratch: &mut [f32]) {
    if values.iter().any(|value| !value.is_finite()) {
        return;
    }
    scratch.copy_from_slice(values);
    scratch.sort_unstable_by(|a, b| b.total_cmp(a));
    // In single precision throughout, as the reference: where two categories are equally good, its choice is a matter of
    // the last bit.
    let (mut sum, mut level) = (0.0_f32, 0.0_f32);
    for (count, &value) in (1_u16..).zip(&*scratch) {
        sum += value;
        let next = (sum - 1.0) / f32::from(count);
        if count == 1 || value > next {
            level = next;
        }
    }
    values.iter_mut().for_each(|value| *value = (*value - level).max(0.0));
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn project(values: &[f32]) -> Vec<f32> {
        let (mut out, mut scratch) = (values.to_vec(), values.to_vec());
        project_to_simplex(&mut out, &mut scratch);
        out
    }

    #[test]
    fn golden_projections() {
        let golden = [
            ([-2.25168, -2.30472, -0.5011572, -0.8677576, 1.697421], [0.0, 0.0, 0.0, 0.0, 1.0]),
            ([1.384018, -0.6320255, -4.230439, 0.6445498, -2.52667], [0.8697342, 0.0, 0.0, 0.1302657, 0.0]),
            ([0.6999664, 0.6162679, 0.239683, 2.475316, 2.233554], [0.0, 0.0, 0.0, 0.6208808, 0.3791194]),
            ([-0.4945563, -2.705307, -3.391862, 1.133301, 1.587017], [0.0, 0.0, 0.0, 0.2731423, 0.7268578]),
            ([1.197679, -3.11019, -0.6827208, 3.706012, -0.4317265], [0.0, 0.0, 0.0, 1.0, 0.0]),
        ];
        for (input, expected) in golden {
            for (found, expected) in project(&input).iter().zip(expected) {
                assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
            }
        }
        assert_eq!(project(&[0.0; 4]), [0.25; 4]);
        assert_eq!(project(&[7.0]), [1.0]);
        assert_eq!(project(&[]), [0.0_f32; 0]);
        assert!(project(&[f32::NAN, 1.0])[0].is_nan());
    }

    proptest! {
        #[test]
        fn projections_are_nearest_points(
            values in proptest::collection::vec(-5.0_f32..5.0, 1..9),
            shift in -3.0_f32..3.0,
            other in proptest::collection::vec(0.01_f32..1.0, 9),
        ) {
            let found = project(&values);
            let distance = |point: &[f32]| -> f64 {
                point.iter().zip(&values).map(|(a, b)| f64::from(a - b).powi(2)).sum()
            };
            prop_assert!(found.iter().all(|&value| value >= 0.0));
            prop_assert!((found.iter().sum::<f32>() - 1.0).abs() < 2e-6);
            for (a, b) in project(&found).iter().zip(&found) {
                prop_assert!((a - b).abs() < 2e-6, "idempotent");
            }
            let shifted: Vec<f32> = values.iter().map(|value| value + shift).collect();
            for (a, b) in project(&shifted).iter().zip(&found) {
                prop_assert!((a - b).abs() < 5e-6, "a constant changes nothing");
            }
            for i in 0..values.len() {
                for j in 0..values.len() {
                    prop_assert!(values[i] < values[j] || found[i] >= found[j], "order is preserved");
                }
            }
            // No other point of the simplex is nearer.
            let sum: f32 = other[..values.len()].iter().sum();
            let other: Vec<f32> = other[..values.len()].iter().map(|value| value / sum).collect();
            prop_assert!(distance(&found) <= distance(&other) + 1e-5);
        }
    }
}
