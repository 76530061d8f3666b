//! Both vision transformers, on images of the size of their positions and of another: patches, summary token, scales on
//! branches, interpolated positions.

use std::path::PathBuf;

use burn::tensor::Tensor;

use super::{Fixture, fixture_path};
use crate::weights;
use swm_nn::params;
use swm_nn::{Vit, VitConfig};

fn tiny(dinov2: bool) -> VitConfig {
    VitConfig { dim: 12, depth: 2, heads: 3, hidden: 24, patch: 4, positions_for: 16, dinov2 }
}

fn compare(name: &str, dinov2: bool) {
    let fixture = Fixture::open(name);
    let config = tiny(dinov2);
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

#[test]
fn files_of_transformers_4_and_of_trainers_are_understood() {
    for (name, file, dinov2) in
        [("vit", "vit_generation4.pt", false), ("dinov2", "dinov2_generation4.ckpt", true)]
    {
        let fixture = Fixture::open(&format!("{name}_generation4"));
        let vit = Vit::new(&tiny(dinov2), &fixture.device);
        let vit = weights::load_network(&vit, &fixture_path(file)).unwrap_or_else(|error| panic!("{error}"));
        fixture.check("outputs.tokens", vit.forward(fixture.tensor("inputs.pictures")));
    }
}

#[test]
fn dinov2_small_is_hugging_faces() {
    let Some(folder) = std::env::var_os("SWM_DINOV2_SMALL").map(PathBuf::from) else {
        println!("skipped: SWM_DINOV2_SMALL names no folder that `make_fixtures.py dinov2_small` filled");
        return;
    };
    let fixture = Fixture::read(&folder.join("case.safetensors"));
    let vit = Vit::new(&VitConfig::dinov2_small(), &fixture.device);
    let vit = weights::load_network(&vit, &folder.join("model.safetensors"));
    let vit = vit.unwrap_or_else(|error| panic!("{error}"));
    for size in [70, 224] {
        let tokens = vit.forward(fixture.tensor(&format!("inputs.pictures{size}")));
        let worst = fixture.check(&format!("outputs.tokens{size}"), tokens);
        println!("images of {size} pixels: outputs differ by {worst:e} at most");
    }
}
