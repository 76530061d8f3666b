//! Options of opening datasets of other programs, through the commands that read datasets.

use std::fs;

use crate::support::{Folder, PUSHT, root, says, swm_json, swm_ok};

fn golden(name: &str) -> String {
    root().join("tests/golden/field").join(name).display().to_string()
}

/// The record of how a copy was read.
fn source(path: &str) -> serde_json::Value {
    let dataset = swm::data::open(path.as_ref()).expect("the copy opens");
    dataset.metadata().and_then(|run| run.source.clone()).expect("a copy says how it was read")
}

#[test]
fn every_command_that_reads_a_dataset_takes_the_options() {
    let folder = Folder::new();
    let [can, again] = [golden("robomimic_can.hdf5"), folder.path("again.hdf5")];
    fs::copy(&can, &again).expect("a second dataset of the same layout");
    let wrist = ["--camera", "robot0_eye_in_hand", "--map", "proprio=obs.robot0_eef_pos"];
    let [whole, part, sheet] = ["whole.h5", "part_{}.h5", "sheet.png"].map(|name| folder.path(name));
    let merged = swm_json(&[&["merge", &can, &again, "--out", &whole][..], &wrist].concat());
    assert_eq!(merged["episodes"], 6);
    assert_eq!(source(&whole)["columns"]["pixels"], "obs/robot0_eye_in_hand_image");
    assert_eq!(source(&whole)["options"]["map"]["proprio"], "obs.robot0_eef_pos");
    swm_ok(&[&["split", &can, "--parts", "a=2,b=1", "--out", &part][..], &wrist].concat());
    assert_eq!(source(&part.replace("{}", "a"))["options"]["camera"], "robot0_eye_in_hand");
    swm_ok(&[&["preview", &can, "--out", &sheet][..], &wrist].concat());
    says(2, &["preview", &can, "--out", &sheet, "--camera", "left"], &["no camera is called `left`"]);
    says(2, &["split", &whole, "--out", &part, "--camera", "left"], &["no use for it"]);
    // Of environments that are named, and not those of the file.
    let human = golden("pusht_cchi_v7_replay.zarr");
    let task = folder.path("task.toml");
    let make = ["manifest", "make", PUSHT, "--out", &task, "--episodes", "2"];
    says(2, &[&make[..], &["--camera", "top"]].concat(), &["--camera", "about a dataset"]);
    let noise = ["--dataset", &golden("dinowm_pusht_noise"), "--goal-offset", "3"];
    says(2, &[&make[..], &noise, &["--split", "test"]].concat(), &["no part `test`"]);
    swm_ok(&[&make[..], &noise, &["--split", "train"]].concat());
    says(2, &["quality", PUSHT, "--flip", "180"], &["--flip", "none is named"]);
    says(2, &["replay", noise[1], "--split", "test"], &["no part `test`"]);
    let eval = ["eval", PUSHT, "--policy", "random", "--episodes", "1", "--goal-offset", "2"];
    says(1, &[&eval[..], &["--dataset", &human]].concat(), &["its `state` has 5 values a row"]);
    let other = [&eval[..], &["--dataset", &human, "--map", "all=state"]].concat();
    says(1, &other, &["100 % of its actions are outside"]);
    says(2, &["eval", PUSHT, "--policy", "random", "--flip", "180"], &["--flip", "about a dataset"]);
}

#[test]
fn images_are_resized_on_the_way() {
    let folder = Folder::new();
    let (can, out) = (golden("robomimic_can.hdf5"), folder.path("small.h5"));
    says(
        2,
        &["convert", &can, &out, "--image-size", "10x20"],
        &["of another shape than 10 x 20", "stretch, crop or pad"],
    );
    swm_ok(&["convert", &can, &out, "--image-size", "10x20", "--fit", "pad"]);
    assert_eq!(source(&out)["images"], serde_json::json!({ "size": [10, 20], "fit": "pad" }));
    let dataset = swm::data::open(out.as_ref()).expect("the copy opens");
    let pixels = dataset.schema().index("pixels").expect("it has images");
    assert_eq!(dataset.schema().fields()[pixels].shape, [10, 20, 3]);
    says(2, &["convert", &can, &out, "--fit", "pad"], &["--image-size"]);
    let [blind, none] = [golden("halfcheetah-medium-v2.hdf5"), folder.path("none.h5")];
    says(2, &["convert", &blind, &none, "--image-size", "8x8", "--fit", "crop"], &["holds no images"]);
}
