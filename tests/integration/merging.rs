//! Sources that cannot be joined as they are: what `swm merge` says, and that nothing is lost.

use std::path::Path;

use crate::support::{Folder, PUSHT, record, says, swm_ok};

const SHORT: &str = "--episodes 1 --max-steps 3 --image-size 16x16";

#[test]
fn sources_of_other_settings_are_named_and_the_target_stays() {
    let folder = Folder::new();
    let first = record(&folder, "first.h5", SHORT);
    let out = folder.path("out.h5");
    let advice = "merge only datasets of the same environment, settings and frame skip";
    let relative = record(&folder, "relative.h5", &format!("{SHORT} --env-option relative=false"));
    let skipped = record(&folder, "skipped.h5", &format!("{SHORT} --frame-skip 2"));
    let other = folder.path("other.h5");
    let collect =
        ["collect", "swm/TwoRoom-v1", "--episodes", "1", "--max-steps", "3", "--image-size", "24x24"];
    swm_ok(&[&collect[..], &["--quiet", "--out", &other]].concat());
    for (second, here, there) in [
        (
            &relative,
            "relative.h5: it was recorded with relative=false",
            "first.h5 was recorded with the default settings",
        ),
        (
            &skipped,
            "skipped.h5: it was recorded with frame skip 2",
            "first.h5 was recorded with frame skip 1",
        ),
        (&other, "other.h5: it was recorded in swm/TwoRoom-v1", PUSHT),
    ] {
        let merge = ["merge", &first, second, "--out", &out];
        says(2, &merge, &[here, there, advice]);
        assert!(!Path::new(&out).exists());
        let held = record(&folder, "held.h5", &format!("{SHORT} --seed 9"));
        let before = std::fs::read(&held).unwrap();
        says(2, &["merge", &first, second, "--out", &held, "--overwrite"], &[here, there, advice]);
        assert!(std::fs::read(&held).unwrap() == before);
        std::fs::remove_file(held).unwrap();
    }
}

#[test]
fn a_source_without_images_of_the_goal_names_the_option_that_joins_them() {
    let folder = Folder::new();
    let whole = record(&folder, "whole.h5", SHORT);
    let without = record(&folder, "without.h5", &format!("{SHORT} --seed 1 --without goal"));
    let out = folder.path("both.h5");
    for [a, b] in [[&whole, &without], [&without, &whole]] {
        let merge = ["merge", a, b, "--out", &out];
        let fix = "give --image-size 16x16 for images of one size";
        says(2, &merge, &["whole.h5 holds images `goal`", "without.h5 holds none", fix]);
        assert!(!Path::new(&out).exists());
        swm_ok(&[&merge[..], &["--image-size", "16x16", "--quiet"]].concat());
        std::fs::remove_file(&out).unwrap();
    }
}
