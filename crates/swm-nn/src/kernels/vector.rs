//! Loops over 32-bit floats that compilers make SIMD of: compiled for AVX-512, for AVX2 and for the least CPU of the target,
//! chosen at run time. Nothing is fused or reordered, and sums have [`LANES`] lanes everywhere, so each gives the same bits.

use multiversion::multiversion;

/// Partial sums of a row, added to each other at its end.
const LANES: usize = 16;

/// Below this, e^x is 0 here; it is the logarithm of the least normal value.
const LEAST: f32 = -87.336_54;

/// e^x for x ≤ 0, within 2⁻²² of it (relative); 0 where that would be subnormal. NaN stays NaN.
///
/// x = n ln 2 + r, |r| ≤ ln 2 / 2; e^r by a polynomial with the least relative error, 3e-9.
#[inline(always)]
pub(super) fn exp(x: f32) -> f32 {
    // Adding it rounds to an integer, which then is in the low bits.
    const ROUND: f32 = 12_582_912.0;
    // ln 2 in two parts, of which the first has few bits: n times it is exact.
    const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    const P: [f32; 5] = [0.499_999_93, 0.166_665_2, 0.041_668_39, 0.008_368_745, 0.001_381_453_8];
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (x - n * LN_2[0]) - n * LN_2[1];
    let curve = (((P[4] * r + P[3]) * r + P[2]) * r + P[1]) * r + P[0];
    let power = f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0_f32.to_bits()));
    let value = (curve * (r * r) + r + 1.0) * power;
    if x < LEAST { 0.0 } else { value }
}

/// Φ(x), the normal distribution up to x, within 2⁻²² of it, and e^(−x²/2). NaN stays NaN.
///
/// Beyond |x| are e^(−x²/2) g(1 / (1 + 0.26 |x|)), where g is a polynomial with the least relative error, 6e-9.
#[inline(always)]
fn normal(x: f32) -> (f32, f32) {
    const SCALE: f32 = 0.26;
    const G: [f32; 10] = [
        -7.163_687e-6,
        0.103_906_56,
        0.101_715_8,
        0.109_479_986,
        0.031_211_862,
        0.200_110_15,
        -0.200_802_93,
        0.290_976_35,
        -0.170_516_38,
        0.033_925_764,
    ];
    let bell = exp(-0.5 * x * x);
    let t = 1.0 / (1.0 + SCALE * x.abs());
    let g = ((((G[9] * t + G[8]) * t + G[7]) * t + G[6]) * t + G[5]) * t + G[4];
    let beyond = bell * ((((g * t + G[3]) * t + G[2]) * t + G[1]) * t + G[0]);
    (if x < 0.0 { beyond } else { 1.0 - beyond }, bell)
}

/// x Φ(x) of each value, in its place.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn gelu(values: &mut [f32]) {
    for value in values {
        *value *= normal(*value).0;
    }
}

/// x Φ(x) of each value; the values become its derivatives, Φ(x) + x e^(−x²/2) / √2π.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn gelu_and_derivative(values: &mut [f32], outputs: &mut [f32]) {
    const ONE_BY_ROOT_TWO_PI: f32 = 0.398_942_3;
    for (value, output) in values.iter_mut().zip(outputs) {
        let x = *value;
        let (below, bell) = normal(x);
        *output = x * below;
        *value = below + x * bell * ONE_BY_ROOT_TWO_PI;
    }
}

/// Products, in the place of the first.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn multiply(values: &mut [f32], factors: &[f32]) {
    for (value, factor) in values.iter_mut().zip(factors) {
        *value *= factor;
    }
}

/// Gradients where they pass a ReLU, 0 elsewhere, into `out`; of values before or after it.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn relu_back(values: &[f32], gradients: &[f32], out: &mut [f32]) {
    for ((out, value), gradient) in out.iter_mut().zip(values).zip(gradients) {
        *out = if *value > 0.0 { *gradient } else { 0.0 };
    }
}

/// Products with one factor, in the place of the values.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn scale(values: &mut [f32], factor: f32) {
    for value in values {
        *value *= factor;
    }
}

/// Rows of values plus a row, into `out`; plus nothing if there is no row.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn add_to_rows(values: &[f32], row: Option<&[f32]>, width: usize, out: &mut [f32]) {
    let Some(row) = row else { return out.copy_from_slice(values) };
    for (values, out) in values.chunks_exact(width).zip(out.chunks_exact_mut(width)) {
        for ((out, value), more) in out.iter_mut().zip(values).zip(row) {
            *out = value + more;
        }
    }
}

/// Adds rows to a sum, one after another.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn add_rows(sum: &mut [f32], rows: &[f32]) {
    for row in rows.chunks_exact(sum.len()) {
        for (sum, value) in sum.iter_mut().zip(row) {
            *sum += value;
        }
    }
}

/// The softmax of `scale` (above 0) times the values, of each row of `width` of them. With `causal`, a row sees one value more
/// than the row before it, the last all of them, and the others become 0. Of a row of −∞ it is 0, of one with NaN NaN.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn softmax(values: &mut [f32], width: usize, scale: f32, causal: bool) {
    let rows = values.len() / width;
    for (index, row) in values.chunks_exact_mut(width).enumerate() {
        let hidden = if causal { rows - 1 - index } else { 0 };
        let (row, unseen) = row.split_at_mut(width.saturating_sub(hidden));
        unseen.fill(0.0);
        // Not −∞: differences shall be numbers.
        let largest = fold(row, [f32::MIN; LANES], |most, value| if value > most { value } else { most });
        let largest = largest.into_iter().fold(f32::MIN, f32::max);
        for value in &mut *row {
            *value = exp((*value - largest) * scale);
        }
        let sum = total(fold(row, [0.0; LANES], |sum, value| sum + value));
        let factor = 1.0 / if sum < f32::MIN_POSITIVE { f32::MIN_POSITIVE } else { sum };
        for value in row {
            *value *= factor;
        }
    }
}

/// From gradients of a softmax's weights those of what it was taken of, in their place: `scale` w (g − Σ w g), row by row.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn softmax_back(gradients: &mut [f32], weights: &[f32], width: usize, scale: f32) {
    for (gradients, weights) in gradients.chunks_exact_mut(width).zip(weights.chunks_exact(width)) {
        let mean = total(fold_pairs(gradients, weights, [0.0; LANES], |sum, g, w| sum + g * w));
        for (gradient, weight) in gradients.iter_mut().zip(weights) {
            *gradient = (*gradient - mean) * (*weight * scale);
        }
    }
}

/// What layer normalization multiplies by and adds to, for each value of a row.
#[derive(Clone, Copy)]
pub(super) struct Affine<'a> {
    /// Factors.
    pub(super) scale: &'a [f32],
    /// Summands.
    pub(super) shift: Option<&'a [f32]>,
}

/// Rows of values less their mean, by their standard deviation (of variance + `epsilon`), scaled and shifted. `moments` gets
/// mean and 1 / standard deviation of each.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn layer_norm(
    values: &[f32],
    affine: Affine<'_>,
    epsilon: f32,
    moments: &mut [[f32; 2]],
    outputs: &mut [f32],
) {
    let width = affine.scale.len();
    let rows = values.chunks_exact(width).zip(outputs.chunks_exact_mut(width));
    for ((row, outputs), moments) in rows.zip(moments) {
        let mean = total(fold(row, [0.0; LANES], |sum, value| sum + value)) / width as f32;
        let squares = fold(row, [0.0; LANES], |sum, value| sum + (value - mean) * (value - mean));
        let factor = 1.0 / (total(squares) / width as f32 + epsilon).sqrt();
        *moments = [mean, factor];
        for ((output, value), scale) in outputs.iter_mut().zip(row).zip(affine.scale) {
            *output = (value - mean) * factor * scale;
        }
        if let Some(shift) = affine.shift {
            for (output, shift) in outputs.iter_mut().zip(shift) {
                *output += shift;
            }
        }
    }
}

/// From gradients of [`layer_norm`]'s outputs those of its values, in their place; those of scale and shift are added to `sums`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn layer_norm_back(
    gradients: &mut [f32],
    values: &[f32],
    scale: &[f32],
    moments: &[[f32; 2]],
    sums: [&mut [f32]; 2],
) {
    let width = scale.len();
    let [of_scale, of_shift] = sums;
    let rows = gradients.chunks_exact_mut(width).zip(values.chunks_exact(width));
    for ((gradients, values), &[mean, factor]) in rows.zip(moments) {
        let sums = of_scale.iter_mut().zip(of_shift.iter_mut());
        for (((gradient, value), scale), (of_scale, of_shift)) in
            gradients.iter_mut().zip(values).zip(scale).zip(sums)
        {
            *of_shift += *gradient;
            *of_scale += *gradient * ((value - mean) * factor);
            *gradient *= scale;
        }
        let of_mean = total(fold(gradients, [0.0; LANES], |sum, gradient| sum + gradient)) / width as f32;
        let along = fold_pairs(gradients, values, [0.0; LANES], |sum, gradient, value| {
            sum + gradient * ((value - mean) * factor)
        });
        let along = total(along) / width as f32;
        for (gradient, value) in gradients.iter_mut().zip(values) {
            *gradient = factor * (*gradient - of_mean - (value - mean) * factor * along);
        }
    }
}

/// The sum of the products of two rows of one length.
#[inline(always)]
pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    total(fold_pairs(a, b, [0.0; LANES], |sum, a, b| sum + a * b))
}

/// Lane by lane; the row's end goes to the first lanes.
#[inline(always)]
fn fold(row: &[f32], mut lanes: [f32; LANES], step: impl Fn(f32, f32) -> f32) -> [f32; LANES] {
    let (chunks, rest) = row.as_chunks::<LANES>();
    for chunk in chunks {
        for lane in 0..LANES {
            lanes[lane] = step(lanes[lane], chunk[lane]);
        }
    }
    for (lane, value) in lanes.iter_mut().zip(rest) {
        *lane = step(*lane, *value);
    }
    lanes
}

/// The same of two rows of one length.
#[inline(always)]
fn fold_pairs(
    a: &[f32],
    b: &[f32],
    mut lanes: [f32; LANES],
    step: impl Fn(f32, f32, f32) -> f32,
) -> [f32; LANES] {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            lanes[lane] = step(lanes[lane], a[lane], b[lane]);
        }
    }
    for (lane, (a, b)) in lanes.iter_mut().zip(a_rest.iter().zip(b_rest)) {
        *lane = step(*lane, *a, *b);
    }
    lanes
}

/// The sum of all lanes, in one order.
#[inline(always)]
fn total(lanes: [f32; LANES]) -> f32 {
    let eight: [f32; 8] = std::array::from_fn(|i| lanes[i] + lanes[i + 8]);
    let four: [f32; 4] = std::array::from_fn(|i| eight[i] + eight[i + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}
