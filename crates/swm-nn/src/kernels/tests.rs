//! Each operation compared with its formula in f64, and its gradient with that of burn's operations; at odd sizes, of views, on
//! other numbers of threads and as part of other batches.

use burn::tensor::module;
use burn::tensor::ops::AttentionModuleOptions;
use burn::tensor::{Device, Distribution, activation};

use super::sigreg::epps_pulley_anywhere;
use super::vector::{self, Affine};
use super::*;
use crate::params::host;

/// Values between −1 and 1 without a pattern that sums would hide.
fn wild<const D: usize>(shape: [usize; D], seed: usize, device: &Device) -> Tensor<D> {
    let count: usize = shape.iter().product();
    let values: Vec<f32> = (0..count).map(|i| ((i * i + 7 * count + 31 * seed) as f32).sin()).collect();
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// Finite values from −`most` to `most`, close to each other near 0.
fn axis(most: f32) -> impl Iterator<Item = f32> {
    (-60_000..=60_000).map(move |i| (i as f32 / 60_000.0).powi(3) * most)
}

/// Whether values are within `share` of the largest of the others, or of 1.
#[track_caller]
fn agree(what: &str, ours: &[f32], others: &[f32], share: f32) {
    assert_eq!(ours.len(), others.len(), "{what}");
    let largest = others.iter().fold(1.0_f32, |most, value| most.max(value.abs()));
    for (place, (a, b)) in ours.iter().zip(others).enumerate() {
        assert!((a - b).abs() <= share * largest, "{what}, {place}: {a} and {b}");
    }
}

/// Outputs of some operation, and the gradients of its inputs, where each output has another gradient.
fn gradients<const D: usize, const O: usize>(
    inputs: &[Tensor<D>],
    work: impl Fn(&[Tensor<D>]) -> Tensor<O>,
) -> Vec<Vec<f32>> {
    let inputs: Vec<_> = inputs.iter().map(|input| input.clone().autodiff().require_grad()).collect();
    let out = work(&inputs);
    let weights = wild(out.dims(), 5, &Device::flex());
    let gradients = (out.clone() * weights).sum().backward();
    let found = inputs.iter().map(|input| host(input.grad(&gradients).expect("it is tracked")));
    std::iter::once(host(out)).chain(found).collect()
}

/// Compares two ways, forwards and backwards.
#[track_caller]
fn agree_on<const D: usize, const O: usize>(
    what: &str,
    inputs: &[Tensor<D>],
    ours: impl Fn(&[Tensor<D>]) -> Tensor<O>,
    burns: impl Fn(&[Tensor<D>]) -> Tensor<O>,
    share: f32,
) {
    let plain = host(ours(inputs));
    let [ours, burns] = [gradients(inputs, ours), gradients(inputs, burns)];
    assert_eq!(plain, ours[0], "{what}: outputs with a gradient and without");
    for (index, (ours, burns)) in ours.iter().zip(&burns).enumerate() {
        agree(&format!("{what}, {}", ["output", "first", "second", "third"][index]), ours, burns, share);
    }
}

/// Bits on one thread and on three.
fn on_threads<T: PartialEq + std::fmt::Debug + Send>(work: impl Fn() -> T + Sync) {
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("few threads");
        pool.install(&work)
    });
    assert!(one == three);
}

#[test]
fn exponentials_are_within_their_bound() {
    for x in axis(87.3).map(|x| -x.abs()) {
        let (found, wanted) = (f64::from(vector::exp(x)), f64::from(x).exp());
        assert!((found - wanted).abs() <= wanted * 2.0_f64.powi(-22), "exp {x}: {found} and {wanted}");
    }
    assert_eq!([-87.4, -1e30, f32::NEG_INFINITY, 0.0].map(vector::exp), [0.0, 0.0, 0.0, 1.0]);
    assert!(vector::exp(f32::NAN).is_nan());
}

/// The normal distribution up to x in f64: by its series near 0, by a continued fraction far from it.
fn normal(x: f64) -> f64 {
    let bell = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    if x.abs() < 3.0 {
        // Φ(x) = 1/2 + φ(x) (x + x³/3 + x⁵/15 + …).
        let mut term = x;
        let mut sum = x;
        for k in 1..120 {
            term *= x * x / f64::from(2 * k + 1);
            sum += term;
        }
        return 0.5 + bell * sum;
    }
    // 1 − Φ(x) = φ(x) / (x + 1 / (x + 2 / (x + …))).
    let below = (1..200).rev().fold(x.abs(), |below, k| x.abs() + f64::from(k) / below);
    if x < 0.0 { bell / below } else { 1.0 - bell / below }
}

#[test]
fn gelu_and_its_derivative_are_within_their_bounds() {
    let xs: Vec<f32> = axis(30.0).chain([1e30, -1e30]).collect();
    let mut found = xs.clone();
    vector::gelu(&mut found);
    let (mut derivatives, mut outputs) = (xs.clone(), vec![0.0; xs.len()]);
    vector::gelu_and_derivative(&mut derivatives, &mut outputs);
    assert_eq!(found, outputs);
    for ((x, found), derivative) in xs.into_iter().map(f64::from).zip(found).zip(derivatives) {
        let wanted = x * normal(x);
        assert!((f64::from(found) - wanted).abs() <= 2.0_f64.powi(-21) * x.abs(), "{x}: {found}, {wanted}");
        let wanted = normal(x) + x * (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
        assert!(
            (f64::from(derivative) - wanted).abs() <= 2.0_f64.powi(-21),
            "derivative at {x}: {derivative}, {wanted}"
        );
    }
    let mut nan = [f32::NAN; 3];
    vector::gelu(&mut nan);
    assert!(nan.iter().all(|value| value.is_nan()));
}

#[test]
fn gelu_agrees_with_burns_on_views_and_odd_sizes() {
    let device = Device::flex();
    for shape in [[1, 1], [1, 17], [3, 5], [300, 257]] {
        let x = wild(shape, 1, &device) * 4.0;
        let views =
            [x.clone(), x.clone().transpose(), x.clone().narrow(1, shape[1] / 2, shape[1] - shape[1] / 2)];
        for view in views {
            agree_on("gelu", &[view], |x| gelu(x[0].clone()), |x| activation::gelu(x[0].clone()), 1e-6);
        }
        // What goes in is not what comes out.
        let before = host(x.clone());
        gelu(x.clone());
        assert_eq!(before, host(x));
    }
}

#[test]
fn softmax_is_its_formula_row_by_row() {
    for width in [1, 2, 15, 16, 17, 257] {
        for causal in [false, true] {
            let rows = width.min(19);
            let values: Vec<f32> = host(wild([rows, width], 2, &Device::flex()) * 20.0);
            let mut found = values.clone();
            vector::softmax(&mut found, width, 0.7, causal);
            for (index, (row, found)) in values.chunks(width).zip(found.chunks(width)).enumerate() {
                let seen = if causal { width - (rows - 1 - index) } else { width };
                let powers: Vec<f64> = row[..seen].iter().map(|x| (f64::from(*x) * 0.7).exp()).collect();
                let sum: f64 = powers.iter().sum();
                for (place, found) in found.iter().enumerate() {
                    let wanted = powers.get(place).map_or(0.0, |power| power / sum);
                    assert!(
                        (f64::from(*found) - wanted).abs() < 1e-6,
                        "{width}, {causal}: {found}, {wanted}"
                    );
                }
            }
        }
    }
    let mut rows = [f32::NEG_INFINITY, f32::NEG_INFINITY, f32::NAN, 1.0, f32::NEG_INFINITY, 1.0];
    vector::softmax(&mut rows, 2, 1.0, false);
    assert_eq!((&rows[..2], &rows[4..]), (&[0.0, 0.0][..], &[0.0, 1.0][..]));
    assert!(rows[2..4].iter().all(|value| value.is_nan()));
}

fn burns_attention(qkv: &[Tensor<4>], causal: bool) -> Tensor<4> {
    let [q, k, v] = [0, 1, 2].map(|index| qkv[index].clone());
    let options = AttentionModuleOptions { scale: None, softcap: None, is_causal: causal };
    module::attention_fallback(q, k, v, None, None, options)
}

#[test]
fn attention_agrees_with_burns_on_views_and_odd_sizes() {
    let device = Device::flex();
    for [batch, heads, queries, keys, dim] in [
        [1, 1, 32, 32, 1],
        [2, 3, 33, 47, 5],
        [3, 2, 1, 1030, 8],
        [1, 2, 1024, 1, 3],
        [2, 3, 65, 65, 64],
        [40, 16, 1, 3, 64],
        [3, 2, 5, 7, 19],
        [2, 1, 1, 1, 1],
    ] {
        let of = |tokens, seed| {
            let together = wild([batch, tokens, heads * dim], seed, &device) * 3.0;
            together.reshape([batch, tokens, heads, dim]).swap_dims(1, 2)
        };
        let views = [of(queries, 1), of(keys, 2), of(keys, 3)];
        let copies = views.clone().map(|view| Tensor::from_data(view.into_data(), &device));
        for causal in [false, true] {
            if causal && queries > keys {
                continue;
            }
            for qkv in [&views, &copies] {
                let ours = |qkv: &[Tensor<4>]| attention([0, 1, 2].map(|index| qkv[index].clone()), causal);
                agree_on("attention", qkv, ours, |qkv| burns_attention(qkv, causal), 1e-5);
            }
        }
    }
}

#[test]
fn attention_leaves_other_precisions_to_burn() {
    let device = Device::flex();
    for tokens in [3, 40] {
        let qkv = [1, 2, 3].map(|seed| wild([2, 2, tokens, 4], seed, &device));
        let ours = host(attention(qkv.clone(), true));
        agree("small", &ours, &host(burns_attention(&qkv, true)), 1e-5);
        let narrow = qkv.clone().map(|tensor| tensor.cast(burn::tensor::FloatDType::BF16));
        let narrow = attention(narrow, true);
        assert_eq!(narrow.dtype(), DType::BF16);
        agree("narrow", &host(narrow.cast(burn::tensor::FloatDType::F32)), &ours, 0.02);
    }
}

#[test]
fn layer_norm_is_its_formula() {
    for width in [1, 2, 15, 16, 17, 192, 257] {
        let device = Device::flex();
        // Far from 0: a variance by squares of values would lose all digits.
        let values = host(wild([5, width], 3, &device) + 100.0);
        let (scale, shift) = (host(wild([width], 4, &device)), host(wild([width], 6, &device)));
        let (mut outputs, mut moments) = (vec![0.0; values.len()], vec![[0.0; 2]; 5]);
        let affine = Affine { scale: &scale, shift: Some(&shift) };
        vector::layer_norm(&values, affine, 1e-5, &mut moments, &mut outputs);
        for (row, outputs) in values.chunks(width).zip(outputs.chunks(width)) {
            let mean = row.iter().map(|x| f64::from(*x)).sum::<f64>() / width as f64;
            let square = row.iter().map(|x| (f64::from(*x) - mean).powi(2)).sum::<f64>() / width as f64;
            for (((x, found), scale), shift) in row.iter().zip(outputs).zip(&scale).zip(&shift) {
                let wanted =
                    (f64::from(*x) - mean) / (square + 1e-5).sqrt() * f64::from(*scale) + f64::from(*shift);
                // What the mean of values near 100 is off.
                assert!((f64::from(*found) - wanted).abs() < 1e-4, "{width}: {found}, {wanted}");
            }
        }
    }
}

#[test]
fn layer_norm_agrees_with_burns_on_views_and_odd_sizes() {
    let device = Device::flex();
    let ours = |inputs: &[Tensor<2>], shifted: bool| {
        let [scale, shift] = [1, 2].map(|index| inputs[index].clone().reshape([-1]));
        layer_norm(inputs[0].clone(), scale, shifted.then_some(shift), 1e-5)
    };
    let burns = |inputs: &[Tensor<2>], shifted: bool| {
        let [scale, shift] = [1, 2].map(|index| inputs[index].clone().reshape([-1]));
        module::layer_norm(inputs[0].clone(), scale, shifted.then_some(shift), 1e-5)
    };
    for [rows, width] in [[1, 2], [1, 17], [33, 16], [400, 192], [700, 257]] {
        let x = wild([rows, width], 7, &device) * 2.0;
        let affine = [wild([1, width], 8, &device), wild([1, width], 9, &device)];
        let apart = Tensor::cat(vec![x.clone(), x.clone()], 1).narrow(1, width, width);
        let turned = wild([width, rows], 7, &device).transpose();
        for view in [x, apart, turned] {
            let inputs = [view, affine[0].clone(), affine[1].clone()];
            agree_on("shifted", &inputs, |inputs| ours(inputs, true), |inputs| burns(inputs, true), 2e-5);
            // Nothing depends on the third.
            let plain = |way: &dyn Fn(&[Tensor<2>], bool) -> Tensor<2>, inputs: &[Tensor<2>]| {
                way(&[inputs[0].clone(), inputs[1].clone(), inputs[1].clone()], false)
            };
            agree_on("plain", &inputs[..2], |x| plain(&ours, x), |x| plain(&burns, x), 2e-5);
        }
    }
}

#[test]
fn linear_layers_agree_with_burns_on_views_and_odd_sizes() {
    let device = Device::flex();
    for [rows, inputs, outputs] in [[1, 1, 1], [3, 17, 5], [97, 5, 33], [1500, 33, 200], [4, 300, 3000]] {
        let x = wild([rows, inputs], 1, &device);
        let apart = Tensor::cat(vec![x.clone(), x.clone()], 1).narrow(1, inputs, inputs);
        let turned = wild([inputs, rows], 1, &device).transpose();
        let weight = wild([outputs, inputs], 2, &device).transpose();
        let bias = wild([1, outputs], 3, &device);
        for view in [x, apart, turned] {
            for (then, with_bias) in
                [Then::Nothing, Then::Gelu].into_iter().flat_map(|then| [(then, true), (then, false)])
            {
                let parts = |inputs: &[Tensor<2>]| {
                    let bias = inputs.get(2).map(|bias| bias.clone().squeeze_dim(0));
                    (inputs[0].clone().unsqueeze_dim::<3>(0), inputs[1].clone(), bias)
                };
                let ours = |inputs: &[Tensor<2>]| {
                    let (x, weight, bias) = parts(inputs);
                    linear(x, weight, bias, then)
                };
                let burns = |inputs: &[Tensor<2>]| {
                    let (x, weight, bias) = parts(inputs);
                    let out = module::linear(x, weight, bias);
                    if then == Then::Gelu { activation::gelu(out) } else { out }
                };
                let inputs = [view.clone(), weight.clone(), bias.clone()];
                agree_on("linear", &inputs[..2 + usize::from(with_bias)], ours, burns, 1e-5);
            }
        }
    }
}

/// Sizes at and beside what tiles, blocks and parts of the depth take.
const SIZES: [[usize; 3]; 10] = [
    [1, 1, 1],
    [2, 0, 5],
    [5, 17, 15],
    [6, 16, 16],
    [13, 511, 17],
    [24, 512, 33],
    [25, 513, 100],
    [49, 1030, 7],
    [60, 5, 3000],
    // By columns so far from each other that the product is computed mirrored.
    [520, 5, 7],
];

#[test]
#[expect(clippy::disallowed_methods, reason = "slow where the CPU does not fuse, and right")]
fn products_are_chains_of_fused_sums_in_any_layout() {
    let device = Device::flex();
    for [rows, depth, columns] in SIZES {
        let [a, b] =
            [([rows, depth], 1), ([depth, columns], 2)].map(|(shape, seed)| host(wild(shape, seed, &device)));
        let bias = host(wild([columns], 3, &device));
        let turned = |values: &[f32], width: usize| -> Vec<f32> {
            (0..width).flat_map(|column| values.iter().skip(column).step_by(width).copied()).collect()
        };
        let [a_turned, b_turned] = [turned(&a, depth), turned(&b, columns)];
        for with_bias in [true, false] {
            let bias = with_bias.then_some(&bias[..]);
            let wanted: Vec<f32> = (0..rows * columns)
                .map(|place| {
                    let (row, column) = (place / columns, place % columns);
                    let begin = bias.map_or(0.0, |bias| bias[column]);
                    (0..depth)
                        .fold(begin, |sum, at| a[row * depth + at].mul_add(b[at * columns + column], sum))
                })
                .collect();
            let plain = |values, columns| Matrix::new(values, columns);
            let lefts = [plain(&a, depth), plain(&a_turned, rows).transposed()];
            let rights = [plain(&b, columns), plain(&b_turned, depth).transposed()];
            if depth == 0 {
                // No values, and so no number of rows.
                continue;
            }
            for left in lefts {
                for right in rights {
                    let mut found = vec![0.0; rows * columns];
                    multiply(left, right, bias, &mut found, |_, _, _| ());
                    if bias.is_none() {
                        assert_eq!(product(left, right), found);
                    }
                    if cfg!(target_arch = "aarch64") || is_fused() {
                        assert_eq!(found, wanted, "[{rows}, {depth}] by [{depth}, {columns}]");
                    } else {
                        agree("product", &found, &wanted, 1e-5);
                    }
                }
            }
        }
    }
}

fn is_fused() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// What CPUs with AVX-512 do, by whatever instructions there are here.
#[test]
fn tiles_of_any_height_have_the_same_bits() {
    let device = Device::flex();
    for [rows, depth, columns] in SIZES.into_iter().filter(|[_, depth, columns]| *depth > 0 && *columns < 200)
    {
        let [a, b] =
            [([rows, depth], 1), ([depth, columns], 2)].map(|(shape, seed)| host(wild(shape, seed, &device)));
        for a in
            [Matrix::new(&a, depth), Matrix::new(&host(wild([depth, rows], 1, &device)), rows).transposed()]
        {
            let [low, six, eight] = product::by_height(a, Matrix::new(&b, columns));
            assert_eq!(six, eight, "[{rows}, {depth}] by [{depth}, {columns}]");
            agree("sums that round twice", &low, &six, 1e-5);
        }
    }
}

#[test]
fn what_follows_a_product_gets_each_value_once() {
    let device = Device::flex();
    for [rows, depth, columns] in SIZES.into_iter().filter(|[_, depth, _]| *depth > 0) {
        let [a, b] =
            [([rows, depth], 1), ([depth, columns], 2)].map(|(shape, seed)| host(wild(shape, seed, &device)));
        let (a, b) = (Matrix::new(&a, depth), Matrix::new(&b, columns));
        let (plain, mut out, mut seen) =
            (product(a, b), vec![0.0; rows * columns], vec![f32::NAN; rows * columns]);
        multiply(a, b, None, &mut out, |row, column, values| {
            seen[row * columns + column..][..values.len()].copy_from_slice(values);
            values.iter_mut().for_each(|value| *value += 1.0);
        });
        assert_eq!(seen, plain);
        assert!(out.iter().zip(&plain).all(|(out, plain)| *out == plain + 1.0));
    }
}

#[test]
fn the_statistic_agrees_with_its_plain_form() {
    let device = Device::flex();
    for (shape, knots) in [([1, 1, 1], 2), ([5, 2, 3], 3), ([64, 4, 37], 17), ([7, 1, 16], 17)] {
        let samples = wild(shape, 3, &device) * 6.0;
        let turned = samples.clone().swap_dims(0, 2);
        for samples in [samples, turned] {
            let ours = |x: &[Tensor<3>]| epps_pulley(x[0].clone(), knots);
            agree_on("statistic", &[samples], ours, |x| epps_pulley_anywhere(&x[0], knots), 1e-5);
        }
    }
}

/// Slopes of the losses by finite differences, apart from any other implementation.
#[test]
fn gradients_are_finite_differences() {
    let device = Device::flex();
    let check = |what: &str, shape: [usize; 4], work: &dyn Fn(Tensor<4>) -> Tensor<4>| {
        let x = wild(shape, 1, &device);
        let found = gradients(std::slice::from_ref(&x), |x| work(x[0].clone())).swap_remove(1);
        let values = host(x);
        let at = |values: Vec<f32>| {
            let out = work(Tensor::from_data(TensorData::new(values, shape), &device));
            let weights = wild(out.dims(), 5, &device);
            host(out).iter().zip(host(weights)).map(|(out, w)| f64::from(*out) * f64::from(w)).sum::<f64>()
        };
        for place in (0..values.len()).step_by(values.len() / 7) {
            let step = |by: f32| {
                let mut values = values.clone();
                values[place] += by;
                at(values)
            };
            let difference = (step(0.02) - step(-0.02)) / 0.04;
            let error = (difference - f64::from(found[place])).abs();
            assert!(error < 2e-3, "{what}, {place}: {} and {difference}", found[place]);
        }
    };
    check("gelu", [1, 2, 3, 5], &|x| gelu(x * 3.0));
    let scale = wild([19], 2, &device);
    check("layer norm", [1, 2, 3, 19], &|x| layer_norm(x, scale.clone(), None, 1e-5));
    check("attention of few", [1, 2, 3, 6], &|x| attention([x.clone() * 2.0, x.clone() * -1.0, x], true));
    check("attention", [1, 2, 33, 6], &|x| attention([x.clone() * 2.0, x.clone() * -1.0, x], true));
    check("statistic", [1, 6, 2, 5], &|x| epps_pulley(x.squeeze_dim(0), 17).reshape([1, 1, 1, 1]));
}

#[test]
fn bits_do_not_depend_on_threads_or_on_the_rest_of_a_batch() {
    let device = Device::flex();
    let x: Tensor<3> = Tensor::random([40, 50, 192], Distribution::Normal(0.0, 1.0), &device);
    let scale = wild([192], 2, &device);
    let heads = |x: Tensor<3>| x.reshape([-1, 50, 3, 64]).swap_dims(1, 2);
    let all = |x: &[Tensor<3>]| {
        let (x, scale) = (x[0].clone(), scale.clone());
        let attended = attention([heads(x.clone()), heads(gelu(x.clone())), heads(x.clone())], false);
        let attended = attended.swap_dims(1, 2).reshape([-1, 50, 192]);
        let weight = wild([192, 192], 4, &device);
        let projected = linear(attended, weight, Some(scale.clone()), Then::Gelu);
        layer_norm(projected, scale.clone(), Some(scale), 1e-5)
    };
    on_threads(|| gradients(std::slice::from_ref(&x), all));
    on_threads(|| gradients(std::slice::from_ref(&x), |x| epps_pulley(x[0].clone(), 17)));
    let whole = all(std::slice::from_ref(&x));
    for (first, count) in [(3, 7), (20, 20)] {
        assert_eq!(
            host(all(&[x.clone().narrow(0, first, count)])),
            host(whole.clone().narrow(0, first, count))
        );
    }
    for row in [0, 17, 39] {
        assert_eq!(host(all(&[x.clone().narrow(0, row, 1)])), host(whole.clone().narrow(0, row, 1)));
    }
}
