//! Rules of Gymnasium's classic control: equal to the bit from the recorded start on, images to the pixel. The files name the
//! environments without their versions.

use super::rules::{ImageTolerance, Rules, Tolerance, Unit};

const CLASSIC: Rules = Rules {
    reference_id: "",
    env_id: "",
    settings: |_| {},
    compared: &[],
    // Sums of the reward may be taken in another order.
    tolerance: [Tolerance { px: 2e-15, rad: 0.0, px_per_s: 0.0 }; 2],
    // Not one pixel may differ.
    images: ImageTolerance { equal_pixels: 1.0 - 1e-9, largest_difference: 0 },
    steps: usize::MAX,
    starts: &[],
    adapt: |_| Vec::new(),
    expected_differences: &[],
};

/// Rules by the number of values in state and observation.
macro_rules! classic {
    ($name:ident, $recorded:literal, $id:literal, $state:literal, $observation:literal, $images:expr) => {
        pub(super) const $name: Rules = Rules {
            reference_id: $recorded,
            env_id: $id,
            compared: &[
                ("state_simulator_state", &[Unit::Given; $state]),
                ("obs", &[Unit::Given; $observation]),
                ("reward", &[Unit::Reward]),
                ("terminated", &[Unit::Given]),
            ],
            images: $images,
            ..CLASSIC
        };
    };
}

/// The pendulum's arrow is fitted geometry: at most 50 of 250,000 pixels differ, by 1 level; one by more where the hub's
/// color is replaced and a pixel is black on one side only.
const ARROW: ImageTolerance = ImageTolerance { equal_pixels: 0.9998, largest_difference: 255 };

classic!(CART_POLE, "swm/CartPoleControl", "swm/CartPoleControl-v1", 4, 4, CLASSIC.images);
classic!(MOUNTAIN_CAR, "swm/MountainCarControl", "swm/MountainCarControl-v0", 2, 2, CLASSIC.images);
classic!(
    MOUNTAIN_CAR_CONTINUOUS,
    "swm/MountainCarContinuousControl",
    "swm/MountainCarContinuousControl-v0",
    2,
    2,
    CLASSIC.images
);
classic!(ACROBOT, "swm/AcrobotControl", "swm/AcrobotControl-v1", 4, 6, CLASSIC.images);
classic!(PENDULUM, "swm/PendulumControl", "swm/PendulumControl-v1", 2, 3, ARROW);
