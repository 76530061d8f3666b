//! Both vision transformers, on pictures of the size of their positions and of another: patches, summary token, scales on
//! branches, interpolated positions.

use burn::tensor::Tensor;

use super::Fixture;
use crate::nn::{Vit, VitConfig};
use crate::params;

fn compare(name: &str, dinov2: bool) {
    let fixture = Fixture::open(name);
    let config = VitConfig { width: 12, depth: 2, heads: 3, hidden: 24, patch: 4, positions_for: 16, dinov2 };
    let vit = fixture.load(&Vit::new(&config, &fixture.device), "weights");
    for size in [16, 24] {
        fixture.check(
            &format!("outputs.tokens{size}"),
            vit.forward(fixture.tensor(&format!("inputs.pictures{size}"))),
        );
    }
    let tracked = params::track(&vit, &[""]);
    let tokens = tracked.forward(fixture.tensor("inputs.pictures24"));
    let weights: Tensor<3> = fixture.tensor("inputs.weights24");
    assert!(fixture.check_gradients(&tracked, &(tokens * weights).sum()) > 30);
}

#[test]
fn the_vision_transformer_is_hugging_faces() {
    compare("vit", false);
}

#[test]
fn dinov2_is_hugging_faces() {
    compare("dinov2", true);
}
