//! How far samples are from a standard normal distribution: the statistic of Epps and Pulley, with its gradient.
//!
//! Knots are at multiples of one step, so that the sines and cosines of a sample at all knots are powers of one rotation: one sine
//! and one cosine are computed of each sample, in place of one of each per knot.

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::Tensor;
use multiversion::multiversion;
use rayon::prelude::*;

use super::{is_ours, tensor_of, values_mut, values_of, vector};

/// The end of the interval of knots.
const END: f32 = 3.0;

/// Distributions that are compared at a time.
const LANES: usize = 16;

/// Of B samples of each of T × P distributions, `[B, T, P]`: B times the mean, over the distributions, of the squared distance
/// between their characteristic function and that of N(0, 1), weighed by the latter, over `knots` (2 or more) in [0, 3] by the
/// trapezoid rule, as `[1]`. Source: arXiv 2511.08544.
pub(crate) fn epps_pulley(samples: Tensor<3>, knots: usize) -> Tensor<1> {
    let is_empty = samples.dims().contains(&0);
    if is_empty || !is_ours(&samples) {
        return epps_pulley_anywhere(&samples, knots);
    }
    Tensor::from_dispatch(<Dispatch as Compare>::compare(samples.into_dispatch(), knots))
}

/// The same by burn's own operations.
pub(super) fn epps_pulley_anywhere(samples: &Tensor<3>, knots: usize) -> Tensor<1> {
    let [batch, steps, projections] = samples.dims();
    let mut total = Tensor::<3>::zeros([1, steps, projections], &samples.device().inner());
    for Knot { t, window, weight } in all(knots) {
        let angle = samples.clone() * t;
        let real = angle.clone().cos().mean_dim(0) - window;
        let imaginary = angle.sin().mean_dim(0);
        total = total + (real.square() + imaginary.square()) * weight;
    }
    total.mean() * batch as f32
}

/// A place where characteristic functions are compared.
struct Knot {
    t: f32,
    /// That of N(0, 1) there.
    window: f32,
    weight: f32,
}

fn all(knots: usize) -> impl Iterator<Item = Knot> {
    let step = END / (knots - 1) as f32;
    (0..knots).map(move |knot| {
        let t = knot as f32 * step;
        let window = (-t * t / 2.0).exp();
        let ends = if knot == 0 || knot + 1 == knots { 1.0 } else { 2.0 };
        Knot { t, window, weight: ends * step * window }
    })
}

#[backend_extension(Flex, Autodiff)]
trait Compare: Backend {
    fn compare(samples: FloatTensor<Self>, knots: usize) -> FloatTensor<Self>;
}

impl Compare for Flex {
    fn compare(samples: FlexTensor, knots: usize) -> FlexTensor {
        tensor_of(vec![compared(&samples.to_contiguous(), knots, None)], [1])
    }
}

/// The gradient, which is computed with the statistic.
#[derive(Debug)]
struct Compared;

impl<C: CheckpointStrategy> Compare for Autodiff<Flex, C> {
    fn compare(samples: FloatTensor<Self>, knots: usize) -> FloatTensor<Self> {
        let (samples, node) = samples.into_parts();
        match Compared.prepare::<C>([node]).compute_bound().stateful() {
            OpsKind::Tracked(ops) => {
                let samples = samples.to_contiguous();
                let shape: [usize; 3] = samples.layout().shape().dims();
                let mut gradient = vec![0.0; shape.iter().product()];
                let statistic = compared(&samples, knots, Some(&mut gradient));
                ops.finish(tensor_of(gradient, shape), tensor_of(vec![statistic], [1]))
            }
            OpsKind::UnTracked(ops) => ops.finish(Flex::compare(samples, knots)),
        }
    }
}

impl Backward<Flex, 1> for Compared {
    type State = FlexTensor;

    fn backward(self, ops: Ops<FlexTensor, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let [Some(parent)] = ops.parents else { return };
        let given = gradients.consume::<Flex>(&ops.node).to_contiguous();
        let mut gradient = super::owned(ops.state);
        vector::scale(values_mut(&mut gradient), values_of(&given)[0]);
        gradients.register::<Flex>(parent.id, gradient);
    }
}

/// The statistic of contiguous samples; fills its gradient, if that is asked for.
fn compared(samples: &FlexTensor, knots: usize, gradient: Option<&mut [f32]>) -> f32 {
    let [batch, steps, projections] = samples.layout().shape().dims();
    let (values, columns) = (values_of(samples), steps * projections);
    let knots: Vec<Knot> = all(knots).collect();
    let step = knots[1].t;
    let found: Vec<(f32, Vec<[f32; LANES]>)> = (0..columns.div_ceil(LANES))
        .into_par_iter()
        .map(|block| {
            let at = block * LANES..columns.min((block + 1) * LANES);
            let turns: Vec<Turn> =
                values.chunks_exact(columns).map(|row| Turn::by(&row[at.clone()], step)).collect();
            let mut derivatives = vec![[0.0; LANES]; if gradient.is_some() { batch } else { 0 }];
            let distances = compare(&turns, &knots, columns, &mut derivatives);
            (distances[..at.len()].iter().sum(), derivatives)
        })
        .collect();
    if let Some(gradient) = gradient {
        for (row, out) in gradient.chunks_exact_mut(columns).enumerate() {
            for (out, (_, derivatives)) in out.chunks_mut(LANES).zip(&found) {
                out.copy_from_slice(&derivatives[row][..out.len()]);
            }
        }
    }
    // In order: the same bits on any number of threads.
    found.iter().map(|(distance, _)| distance).sum::<f32>() * batch as f32
}

/// Cosines and sines of the angles between two knots, of one sample each of some distributions.
struct Turn {
    cos: [f32; LANES],
    sin: [f32; LANES],
}

impl Turn {
    fn by(samples: &[f32], step: f32) -> Self {
        let mut turn = Self { cos: [1.0; LANES], sin: [0.0; LANES] };
        for ((cos, sin), sample) in turn.cos.iter_mut().zip(&mut turn.sin).zip(samples) {
            (*sin, *cos) = (sample * step).sin_cos();
        }
        turn
    }

    /// The next powers.
    #[inline(always)]
    fn turn(&self, cos: &mut [f32; LANES], sin: &mut [f32; LANES]) {
        for lane in 0..LANES {
            let (c, s) = (cos[lane], sin[lane]);
            cos[lane] = c * self.cos[lane] - s * self.sin[lane];
            sin[lane] = s * self.cos[lane] + c * self.sin[lane];
        }
    }
}

/// What distributions add to the mean over `count` of them, from their samples. Fills the derivatives of the statistic, if there are any.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn compare(samples: &[Turn], knots: &[Knot], count: usize, derivatives: &mut [[f32; LANES]]) -> [f32; LANES] {
    let mut sums = vec![([0.0_f32; LANES], [0.0_f32; LANES]); knots.len()];
    for sample in samples {
        let (mut cos, mut sin) = ([1.0; LANES], [0.0; LANES]);
        for (cos_sum, sin_sum) in &mut sums {
            for lane in 0..LANES {
                cos_sum[lane] += cos[lane];
                sin_sum[lane] += sin[lane];
            }
            sample.turn(&mut cos, &mut sin);
        }
    }
    let (share, of_mean) = (1.0 / samples.len() as f32, 1.0 / count as f32);
    let mut distances = [0.0; LANES];
    // Sums become what the derivatives of cosines and sines are multiplied by.
    for ((cos, sin), knot) in sums.iter_mut().zip(knots) {
        for lane in 0..LANES {
            let (real, imaginary) = (cos[lane] * share - knot.window, sin[lane] * share);
            distances[lane] += (real * real + imaginary * imaginary) * knot.weight * of_mean;
            let factor = 2.0 * knot.weight * knot.t * of_mean;
            (cos[lane], sin[lane]) = (real * factor, imaginary * factor);
        }
    }
    for (derivative, sample) in derivatives.iter_mut().zip(samples) {
        let (mut cos, mut sin) = ([1.0; LANES], [0.0; LANES]);
        for (real, imaginary) in &sums {
            for lane in 0..LANES {
                derivative[lane] += imaginary[lane] * cos[lane] - real[lane] * sin[lane];
            }
            sample.turn(&mut cos, &mut sin);
        }
    }
    distances
}
