//! Images of 3D scenes on their way into datasets: more cameras, depth, segmentation, and who drew them.

use std::path::Path;

use serde_json::json;
use swm::core::{Batch, Schema};

use crate::support::{Folder, content, swm_json, swm_ok};

const SIZE: (usize, usize) = (40, 48);

fn collect(out: &str, num_envs: &str, threads: &str) {
    swm_ok(&[
        "collect",
        "swm/CheetahDMControl-v0",
        "--policy",
        "random",
        "--episodes",
        "3",
        "--max-steps",
        "4",
        "--seed",
        "5",
        "--vary",
        "all",
        "--image-size",
        "40x48",
        "--env-option",
        "cameras=back",
        "--env-option",
        "depth=true",
        "--env-option",
        "segmentation=true",
        "--num-envs",
        num_envs,
        "--threads",
        threads,
        "--out",
        out,
        "--quiet",
    ]);
}

#[test]
fn all_columns_of_images_are_recorded_the_same_on_any_number_of_threads() {
    let folder = Folder::new();
    let (one, two) = (folder.path("one.h5"), folder.path("two.h5"));
    collect(&one, "1", "1");
    collect(&two, "3", "2");
    assert_eq!(content(&one), content(&two));
    let shown = swm_json(&["inspect", &one]);
    let (height, width) = SIZE;
    for camera in ["", ".back"] {
        let column = |name: &str| shown["columns"][format!("{name}{camera}")].clone();
        assert_eq!(column("pixels"), json!({"dtype": "uint8", "shape": [height, width, 3]}));
        assert_eq!(column("pixels_depth"), json!({"dtype": "float32", "shape": [height, width]}));
        assert_eq!(column("pixels_segmentation"), json!({"dtype": "int32", "shape": [height, width]}));
    }
    assert_eq!(shown["metadata"]["renderer"], "swm-render 0.1.0 (software)");

    let mut dataset = swm::data::open(Path::new(&one)).unwrap();
    let fields = dataset.schema().fields().iter().filter(|field| field.name.starts_with("pixels")).cloned();
    let mut rows = Batch::new(Schema::new(fields.collect()).unwrap(), 0);
    dataset.read(1, 4..5, &mut rows).unwrap();
    for camera in ["", ".back"] {
        let segments = rows.get::<i32>(&format!("pixels_segmentation{camera}")).unwrap();
        let depth = rows.get::<f32>(&format!("pixels_depth{camera}")).unwrap();
        assert_eq!((segments.len(), depth.len()), (height * width, height * width));
        assert!(segments.iter().any(|&segment| segment > 0), "the cheetah is in the image of `{camera}`");
        assert!(depth.iter().all(|&depth| depth > 0.0 && depth.is_finite()));
    }
}
