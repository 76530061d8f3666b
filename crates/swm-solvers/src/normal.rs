//! Standard normal numbers in blocks, by arithmetic that compilers turn into vector instructions and that gives the same
//! bits on every machine. Whole blocks are what planners need; for single numbers there is `rand_distr`.
//!
//! The transform of Box & Muller, *A Note on the Generation of Random Normal Deviates* (1958), in single precision:
//! polynomials of Moshier's Cephes library for logarithm, sine and cosine; no fused multiplication, no branch. Uniform
//! numbers have 24 bits, so that no result lies beyond √(48 ln 2) = 5.77.

use rand::Rng as _;
use swm_core::seed::Stream;

/// Pairs that are made together: two vectors of four on the smallest x86-64.
const PAIRS: usize = 8;

/// Fills `out` from `stream`, 16 numbers at a time: the first numbers do not depend on how many follow.
pub(crate) fn fill(stream: &mut Stream, out: &mut [f32]) {
    let mut blocks = out.chunks_exact_mut(2 * PAIRS);
    for block in &mut blocks {
        block.copy_from_slice(next(stream).as_flattened());
    }
    let rest = blocks.into_remainder();
    if !rest.is_empty() {
        rest.copy_from_slice(&next(stream).as_flattened()[..rest.len()]);
    }
}

/// The next block: cosines, then sines.
fn next(stream: &mut Stream) -> [[f32; PAIRS]; 2] {
    let mut bytes = [0; 8 * PAIRS];
    stream.fill_bytes(&mut bytes);
    let word = |index: usize| -> u32 {
        let [a, b, c, d] = [0, 1, 2, 3].map(|byte| bytes[4 * index + byte]);
        u32::from_le_bytes([a, b, c, d]) >> 8
    };
    let mut pairs = [[0.0; PAIRS]; 2];
    for lane in 0..PAIRS {
        let radius = (-2.0 * ln_of_share(word(lane) + 1)).sqrt();
        let [cos, sin] = cos_sin_of_turn(word(PAIRS + lane));
        pairs[0][lane] = radius * cos;
        pairs[1][lane] = radius * sin;
    }
    pairs
}

/// One whole, of which words count the shares.
const WHOLE: f32 = (1_u32 << 24) as f32;

/// ln(word / 2^24) for words 1 to 2^24.
fn ln_of_share(word: u32) -> f32 {
    // Half of the words are above √½ 2^e, and count as 2^(e + 1) times a mantissa below 1.
    let bits = (word as f32).to_bits() - SQRT_HALF_BITS;
    let exponent = (bits >> 23) as i32 - 24;
    let mantissa = f32::from_bits((bits & 0x007f_ffff) + SQRT_HALF_BITS);
    let x = mantissa - 1.0;
    let tail = poly(
        x,
        [
            7.037_683_6e-2,
            -1.151_461e-1,
            1.167_699_9e-1,
            -1.242_014_1e-1,
            1.424_932_3e-1,
            -1.666_805_7e-1,
            2.000_071_5e-1,
            -2.499_999_4e-1,
            3.333_333_1e-1,
        ],
    );
    let squared = x * x;
    let of_mantissa = x - 0.5 * squared + tail * x * squared;
    of_mantissa + exponent as f32 * std::f32::consts::LN_2
}

/// The bits of √½.
const SQRT_HALF_BITS: u32 = 0x3f35_04f3;

/// Cosine and sine of word / 2^24 turns.
fn cos_sin_of_turn(word: u32) -> [f32; 2] {
    // The nearest quarter turn, and what is left: up to an eighth of a turn to either side, exactly.
    let quarters = (word + (1 << 21)) >> 22;
    let left = word as i32 - (quarters << 22) as i32;
    let x = left as f32 * (std::f32::consts::TAU / WHOLE);
    let squared = x * x;
    let sin = x + x * squared * poly(squared, [-1.951_529_6e-4, 8.332_161e-3, -1.666_665_5e-1]);
    let cos = 1.0 - 0.5 * squared
        + squared * squared * poly(squared, [2.443_315_7e-5, -1.388_731_6e-3, 4.166_664_6e-2]);
    let (even, flipped) = (quarters & 1 == 0, quarters & 2 != 0);
    let [cos, sin] = if even { [cos, sin] } else { [-sin, cos] };
    if flipped { [-cos, -sin] } else { [cos, sin] }
}

/// A polynomial by Horner's rule, highest power first.
fn poly<const N: usize>(x: f32, coefficients: [f32; N]) -> f32 {
    coefficients.into_iter().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

#[cfg(test)]
mod tests {
    use swm_core::seed::keyed;

    use super::*;

    fn numbers(count: usize) -> Vec<f32> {
        let mut out = vec![0.0; count];
        fill(&mut keyed(7, "normal", [0, 0]), &mut out);
        out
    }

    #[test]
    fn logarithm_and_circle_are_those_of_the_library() {
        let words = (0..24).flat_map(|bit| [1_u32 << bit, (1 << bit) + 1, (3 << bit) / 2]).chain([1 << 24]);
        for word in words.chain((0..1 << 24).step_by(9973)).filter(|&word| word > 0) {
            let share = f64::from(word) / f64::from(WHOLE);
            let error = f64::from(ln_of_share(word)) - share.ln();
            assert!(error.abs() <= 3e-7 * share.ln().abs().max(1.0), "ln {share}: {error}");
            let (sin, cos) = (share * std::f64::consts::TAU).sin_cos();
            let [own_cos, own_sin] = cos_sin_of_turn(word % (1 << 24)).map(f64::from);
            assert!((own_cos - cos).abs() < 3e-7 && (own_sin - sin).abs() < 3e-7, "{share} turns");
        }
    }

    #[test]
    fn moments_and_shares_are_those_of_the_normal_distribution() {
        let numbers = numbers(1 << 20);
        let count = numbers.len() as f64;
        let moment = |power| numbers.iter().map(|&x| f64::from(x).powi(power)).sum::<f64>() / count;
        // Five standard errors each.
        for (power, expected, variance) in [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0_f64)]
        {
            let off = (moment(power) - expected).abs() / (variance / count).sqrt();
            assert!(off < 5.0, "moment {power} is {off} standard errors off");
        }
        // Shares below a bound: Abramowitz & Stegun, table 26.1.
        for (bound, share) in
            [(-2.0, 0.022_750), (-1.0, 0.158_655), (0.0, 0.5), (0.5, 0.691_462), (3.0, 0.998_650)]
        {
            let below = numbers.iter().filter(|&&x| x < bound).count() as f64 / count;
            let error = (share * (1.0 - share) / count).sqrt();
            assert!((below - share).abs() < 5.0 * error, "{below} below {bound}, not {share}");
        }
        let neighbours: f64 = numbers.windows(2).map(|pair| f64::from(pair[0]) * f64::from(pair[1])).sum();
        let pairs: f64 =
            numbers.chunks_exact(16).map(|block| f64::from(block[0]) * f64::from(block[8])).sum();
        assert!(
            (neighbours / count).abs() < 5.0 / count.sqrt()
                && (pairs / count * 16.0).abs() < 20.0 / count.sqrt()
        );
    }

    #[test]
    fn the_first_numbers_do_not_depend_on_how_many_follow() {
        let all = numbers(100);
        for count in [1, 15, 16, 17, 99] {
            assert_eq!(numbers(count), all[..count]);
        }
    }

    #[test]
    fn the_numbers_are_a_promise() {
        // Another machine must give these bits: plans depend on them.
        let bits: Vec<u32> = numbers(4).into_iter().map(f32::to_bits).collect();
        assert_eq!(bits, [1016104145, 3220083286, 3202409852, 3185488530]);
    }
}
