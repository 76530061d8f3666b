//! Convolutions compared with burn's.

use burn::tensor::Device;

use super::*;
use crate::params::host;

/// Values between −1 and 1 without a pattern that sums would hide.
fn wild<const D: usize>(shape: [usize; D], device: &Device) -> Tensor<D> {
    let count: usize = shape.iter().product();
    let values: Vec<f32> = (0..count).map(|i| ((i * i + 7 * count) as f32).sin()).collect();
    Tensor::from_data(TensorData::new(values, shape), device)
}

type Way = fn(Tensor<4>, Tensor<2>, Tensor<1>, Kernel, Activation) -> Tensor<4>;

/// Outputs, and the gradients of images, weights and bias.
fn pass(
    way: Way,
    shape: [usize; 4],
    outputs: usize,
    kernel: Kernel,
    activation: Activation,
) -> [Vec<f32>; 4] {
    let device = Device::flex().autodiff();
    let images = wild(shape, &device).require_grad();
    let weight = wild([kernel.size * kernel.size * shape[3], outputs], &device).require_grad();
    let bias = wild([outputs], &device).require_grad();
    let out = way(images.clone(), weight.clone(), bias.clone(), kernel, activation);
    // Another value for each output.
    let gradients = (out.clone() * wild(out.dims(), &device)).sum().backward();
    let of = "all three are tracked";
    [
        host(out),
        host(images.grad(&gradients).expect(of)),
        host(weight.grad(&gradients).expect(of)),
        host(bias.grad(&gradients).expect(of)),
    ]
}

#[test]
fn agrees_with_burns_convolution_forwards_and_backwards() {
    let kernels = [(5, 2, 2), (3, 2, 1), (3, 1, 1), (3, 1, 0), (4, 2, 1), (1, 1, 0), (2, 3, 0), (5, 2, 4)];
    let both = [Activation::Relu, Activation::Mish];
    for ((size, stride, padding), activation) in
        kernels.into_iter().flat_map(|kernel| both.map(|activation| (kernel, activation)))
    {
        let kernel = Kernel { size, stride, padding };
        for shape in [[3, 8, 8, 3], [2, 7, 9, 4], [1, 5, 5, 1], [40, 32, 32, 3]] {
            let [ours, burns] =
                [convolve as Way, convolve_anywhere].map(|way| pass(way, shape, 6, kernel, activation));
            for (what, (ours, burns)) in
                ["outputs", "images", "weight", "bias"].iter().zip(ours.iter().zip(&burns))
            {
                assert_eq!(ours.len(), burns.len(), "{what} of {kernel:?}, {activation:?}, {shape:?}");
                let largest = burns.iter().fold(1.0_f32, |most, value| most.max(value.abs()));
                for (a, b) in ours.iter().zip(burns) {
                    assert!(
                        (a - b).abs() <= 1e-5 * largest,
                        "{what} of {kernel:?}, {activation:?}, {shape:?}: {a} and {b}"
                    );
                }
            }
        }
    }
}

#[test]
fn an_image_is_convolved_alike_in_any_batch() {
    let device = Device::flex();
    let kernel = Kernel { size: 3, stride: 2, padding: 1 };
    let (weight, bias) = (wild([9 * 16, 32], &device), wild([32], &device));
    let images = wild([50, 16, 16, 16], &device);
    for activation in [Activation::Relu, Activation::Mish] {
        let all = convolve(images.clone(), weight.clone(), bias.clone(), kernel, activation);
        for one in [0, 17, 49] {
            let image = images.clone().narrow(0, one, 1);
            let alone = convolve(image, weight.clone(), bias.clone(), kernel, activation);
            assert_eq!(host(alone), host(all.clone().narrow(0, one, 1)));
        }
    }
}
