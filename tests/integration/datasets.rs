//! The commands on datasets: convert, merge, split, preview, verify, diff.

use std::fs;
use std::path::Path;

use crate::support::{Folder, PUSHT, content, root, swm, swm_fails, swm_json, swm_ok};

/// The formats of this build that are folders.
fn folders() -> impl Iterator<Item = &'static str> {
    ["folder", "video", "lerobot"]
        .into_iter()
        .filter(|name| swm::registry().find::<swm::data::Format>(name).is_ok())
}

/// The smallest of them, and the file of an episode's images in it.
const SMALL: (&str, &str) =
    if cfg!(feature = "mp4") { ("video", "pixels/ep_1.mp4") } else { ("folder", "pixels/ep_1_step_3.jpeg") };

/// A small recording of PushT.
fn recorded(folder: &Folder, name: &str, seed: &str, episodes: &str) -> String {
    let out = folder.path(name);
    swm_ok(&[
        "collect",
        PUSHT,
        "--policy",
        "weak",
        "--episodes",
        episodes,
        "--max-steps",
        "12",
        "--image-size",
        "40x40",
        "--seed",
        seed,
        "--out",
        &out,
        "--quiet",
    ]);
    out
}

#[test]
fn a_dataset_goes_round_through_every_format() {
    let folder = Folder::new();
    let source = recorded(&folder, "a.h5", "1", "3");
    for name in folders() {
        let [there, back] = [format!("b.{name}"), format!("c-{name}.h5")].map(|name| folder.path(&name));
        let result = swm_json(&["convert", &source, &there]);
        assert_eq!((&result["episodes"], &result["resumed"]), (&3.into(), &0.into()));
        assert_eq!(swm_json(&["inspect", &there])["format"], name);
        swm_ok(&["convert", &there, &back]);
        let exact = swm_json(&["diff", &source, &back, "--ignore", "pixels,goal"]);
        assert_eq!(exact["equal"], true, "{exact}");
        let said = swm(&["diff", &source, &back, "--json"]).output().unwrap();
        assert_eq!(said.status.code(), Some(1));
        let found: serde_json::Value = serde_json::from_slice(&said.stdout).unwrap();
        for column in found["columns"].as_array().unwrap() {
            if let Some(psnr) = column["psnr"].as_f64() {
                assert!(psnr > 25.0, "{column}");
            }
        }
        // Recorded directly, and replayed by the simulator.
        let direct = folder.path(&format!("d.{name}"));
        recorded(&folder, &format!("d.{name}"), "1", "3");
        swm_ok(&["diff", &direct, &there, "--ignore", "pixels,goal"]);
        swm_ok(&["replay", &direct]);
        assert_eq!(swm_json(&["verify", &direct])["ok"], true);
    }
}

#[test]
fn images_are_recorded_in_the_quality_that_is_asked_for() {
    let folder = Folder::new();
    for name in folders() {
        let bytes = |quality: &str| {
            let out = folder.path(&format!("{quality}.{name}"));
            let fixed = [
                "--policy",
                "weak",
                "--episodes",
                "2",
                "--max-steps",
                "8",
                "--image-size",
                "64x64",
                "--quiet",
            ];
            swm_ok(
                &[
                    &["collect", PUSHT, "--without", "goal"][..],
                    &fixed,
                    &["--quality", quality, "--out", &out],
                ]
                .concat(),
            );
            size(Path::new(&out))
        };
        let (low, high) = (bytes("20"), bytes("98"));
        assert!(high > low + low / 5, "{name}: {low} bytes in low quality, {high} in high");
    }
    let message = swm_fails(2, &["collect", PUSHT, "--quality", "0", "--out", &folder.path("a.folder")]);
    assert!(message.contains("quality"), "{message}");
    let exact = folder.path("a.h5");
    let collect =
        ["collect", PUSHT, "--policy", "random", "--episodes", "1", "--max-steps", "2", "--out", &exact];
    let message = swm_fails(2, &[&collect[..], &["--quality", "50"]].concat());
    assert!(message.contains("`hdf5` keeps images without loss"), "{message}");
    swm_ok(&collect);
    assert!(swm_fails(2, &collect).contains("--mode append"));
    let message = swm_fails(2, &["convert", &exact, &folder.path("b.folder"), "--key-frames", "5"]);
    assert!(message.contains("`folder` has no videos"), "{message}");
}

/// Bytes of all images and videos below a folder.
fn size(path: &Path) -> u64 {
    if path.is_dir() {
        return fs::read_dir(path).into_iter().flatten().flatten().map(|entry| size(&entry.path())).sum();
    }
    let is_image = path.extension().is_some_and(|extension| extension == "jpeg" || extension == "mp4");
    path.metadata().map_or(0, |metadata| if is_image { metadata.len() } else { 0 })
}

#[test]
fn converting_goes_on_where_it_ended_and_replaces_nothing_unasked() {
    let folder = Folder::new();
    let [source, other] =
        [("a.h5", "1"), ("b.h5", "2")].map(|(name, seed)| recorded(&folder, name, seed, "3"));
    let target = recorded(&folder, &format!("c.{}", SMALL.0), "1", "2");
    assert_eq!(swm_json(&["convert", &source, &target])["resumed"], 2);
    assert_eq!(swm_json(&["convert", &source, &target])["resumed"], 3);
    let message = swm_fails(2, &["convert", &other, &target]);
    assert!(message.contains("not the beginning of this copy") && message.contains("overwrite"), "{message}");
    swm_ok(&["convert", &other, &target, "--overwrite"]);
    swm_ok(&["diff", &other, &target, "--ignore", "pixels,goal"]);
    let message = swm_fails(2, &["convert", &source, &folder.path("d.xyz")]);
    assert!(message.contains("unknown dataset format `xyz`"), "{message}");
    let message = swm_fails(2, &["convert", &folder.path("none.h5"), &folder.path("d.h5")]);
    assert!(message.contains("none.h5"), "{message}");
    let message = swm_fails(2, &["convert", &source, &folder.path("d.folder"), "--quality", "101"]);
    assert!(message.contains("101"), "{message}");
}

#[test]
fn splitting_and_merging_lose_nothing() {
    let folder = Folder::new();
    let source = recorded(&folder, "a.h5", "3", "5");
    let out = folder.path("part_{}.h5");
    let parts = swm_json(&["split", &source, "--by", "episode", "--parts", "train=3,val=2", "--out", &out]);
    assert_eq!((&parts[0]["episodes"], &parts[1]["episodes"]), (&3.into(), &2.into()));
    let [train, val, both] = ["part_train.h5", "part_val.h5", "both.h5"].map(|name| folder.path(name));
    swm_ok(&["merge", &train, &val, "--out", &both]);
    let (whole, joined) = (swm_json(&["inspect", &source]), swm_json(&["inspect", &both]));
    assert_eq!((&whole["episodes"], &whole["steps"]), (&joined["episodes"], &joined["steps"]));
    swm_ok(&["replay", &both]);
    let again = swm_json(&["split", &source, "--parts", "train=3,val=2", "--out", &out]);
    assert_eq!(again[0]["resumed"], 3);
    let message = swm_fails(2, &["split", &source, "--parts", "train=1,val=0", "--out", &out]);
    assert!(message.contains("`val` would get none of the 5 episodes"), "{message}");
    assert!(swm_fails(2, &["split", &source, "--out", "x.h5"]).contains("{}"));
    let small = folder.path("small.h5");
    swm_ok(&["collect", PUSHT, "--episodes", "1", "--image-size", "16x16", "--out", &small, "--quiet"]);
    let message = swm_fails(2, &["merge", &source, &small, "--out", &folder.path("no.h5")]);
    assert!(
        message.contains("small.h5 holds images of 16x16") && message.contains("--image-size"),
        "{message}"
    );
}

#[test]
fn damage_is_found_and_an_interruption_fixed() {
    let folder = Folder::new();
    let source = recorded(&folder, "a.h5", "4", "2");
    let sound = swm_json(&["verify", &source]);
    assert_eq!((&sound["ok"], &sound["report"]["has_checksums"]), (&true.into(), &true.into()));
    let videos = folder.path(&format!("b.{}", SMALL.0));
    swm_ok(&["convert", &source, &videos]);
    assert!(swm_ok(&["verify", &videos]).contains("sound"));

    let array = Path::new(&videos).join("state.npz");
    let bytes = fs::read(&array).unwrap();
    fs::write(&array, &bytes[..bytes.len() - 60]).unwrap();
    assert!(swm_fails(1, &["verify", &videos]).contains("has to be repaired"));
    let plan = swm(&["verify", &videos, "--fix", "--dry-run", "--json"]).output().unwrap();
    assert_eq!(plan.status.code(), Some(1), "what has to be repaired is no success");
    let plan: serde_json::Value = serde_json::from_slice(&plan.stdout).unwrap();
    assert_eq!(plan["ok"], false);
    assert!(plan["fixed"][0].as_str().unwrap().contains("state.npz"), "{plan}");
    assert!(fs::read(&array).unwrap() != bytes);
    swm_ok(&["verify", &videos, "--fix"]);
    assert!(fs::read(&array).unwrap() == bytes);
    swm_ok(&["verify", &videos, "--fix", "--dry-run"]);

    let video = Path::new(&videos).join(SMALL.1);
    let mut bytes = fs::read(&video).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&video, bytes).unwrap();
    let message = swm_fails(1, &["verify", &videos]);
    assert!(message.contains("is not sound"), "{message}");
}

#[test]
fn statistics_are_shown_and_kept_next_to_the_dataset() {
    let folder = Folder::new();
    for name in ["a.h5", "b.folder"] {
        let source = recorded(&folder, name, "6", "2");
        let found = swm_json(&["stats", &source, "--columns", "action,pixels"]);
        assert_eq!((&found["episodes"], found["columns"].as_object().unwrap().len()), (&2.into(), 2));
        // The last action of each episode does not count.
        assert_eq!(found["columns"]["action"]["not_finite"], 2);
        assert!(Path::new(&format!("{source}.stats.json")).exists());
        assert!(swm_fails(2, &["stats", &source, "--columns", "actoin"]).contains("`action`"));
    }
}

#[test]
fn previews_show_the_episodes() {
    let folder = Folder::new();
    let source = recorded(&folder, "a.h5", "5", "3");
    let [sheet, video, gif] = ["sheet.png", "grid.mp4", "grid.gif"].map(|name| folder.path(name));
    let result = swm_json(&["preview", &source, "--episodes", "0..2", "--frames", "4", "--out", &sheet]);
    assert_eq!(result["episodes"], serde_json::json!([0, 1]));
    // The goal and four images of 40 pixels with four gaps of 2, two rows of them with one gap.
    let png = fs::read(&sheet).unwrap();
    let side = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().unwrap());
    assert_eq!((side(16), side(20)), (5 * 40 + 4 * 2, 2 * 40 + 2));
    for out in [&video, &gif].into_iter().filter(|out| cfg!(feature = "mp4") || out.ends_with("gif")) {
        let result = swm_json(&["preview", &source, "--out", out]);
        assert_eq!(result["episodes"].as_array().unwrap().len(), 3);
        assert!(result["frames"].as_u64().unwrap() > 5 && fs::metadata(out).unwrap().len() > 500);
    }
    assert!(swm_fails(2, &["preview", &source, "--column", "state", "--out", &sheet]).contains("no images"));
    assert!(swm_fails(2, &["preview", &source, "--episodes", "7", "--out", &sheet]).contains("no episode 7"));
    assert!(swm_fails(2, &["preview", &source, "--column", "pixel", "--out", &sheet]).contains("`pixels`"));
}

#[test]
fn videos_and_folders_are_equal_for_any_number_of_environments() {
    let folder = Folder::new();
    for name in folders() {
        let out = |k: &str| folder.path(&format!("{k}.{name}"));
        for k in ["1", "3"] {
            swm_ok(&[
                "collect",
                PUSHT,
                "--policy",
                "weak",
                "--episodes",
                "4",
                "--max-steps",
                "9",
                "--num-envs",
                k,
                "--image-size",
                "40x40",
                "--out",
                &out(k),
                "--quiet",
            ]);
        }
        assert_eq!(content(&out("1")), content(&out("3")));
    }
}

/// Few steps and small images; what is recorded is the recipe's business.
#[test]
fn there_is_a_recipe_for_every_environment_and_it_records() {
    let recipes = fs::read_to_string(root().join("xtask/recipes/datasets.toml")).unwrap();
    let value = |line: &str, key: &str| -> Option<String> {
        Some(line.strip_prefix(key)?.strip_prefix(" = \"")?.strip_suffix('"')?.to_owned())
    };
    let folder = Folder::new();
    let (mut missing, mut env) = (swm::registry().envs().collect::<Vec<_>>(), String::new());
    for line in recipes.lines() {
        if let Some(id) = value(line, "env") {
            missing.retain(|entry| entry.id != id);
            env = id;
        } else if let Some(options) = value(line, "collect") {
            let mut words: Vec<&str> = options.split_whitespace().collect();
            for (option, small) in [("--max-steps", "2"), ("--image-size", "16x16")] {
                let at = words.iter().position(|word| *word == option).expect("the recipe says it");
                words[at + 1] = small;
            }
            let file = folder.path("data.h5");
            let args = ["collect", &env, "--episodes", "1", "--mode", "overwrite", "--out", &file];
            swm_ok(&[&args[..], &words].concat());
        }
    }
    let missing: Vec<&str> = missing.iter().map(|entry| entry.id).collect();
    assert!(missing.is_empty(), "no recipe for {}", missing.join(", "));
}

/// A copy says no more of its recording than the source, and is as welcome.
#[test]
fn copies_of_other_programs_datasets_are_evaluated_on_as_the_datasets_are() {
    let folder = Folder::new();
    let source = root().join("tests/golden/datasets/pusht_up_64_folder");
    let (source, copy, task) = (source.to_str().unwrap(), folder.path("copy.h5"), folder.path("task.toml"));
    swm_ok(&["convert", source, &copy, "--quiet"]);
    let pairs = ["--episodes", "2", "--goal-offset", "2", "--budget", "2", "--quiet"];
    let evaluated = |dataset: &str| {
        let eval = ["eval", PUSHT, "--policy", "random", "--dataset", dataset];
        let result = swm_json(&[&eval[..], &pairs].concat());
        (result["episode_returns"].clone(), result["episode_successes"].clone())
    };
    assert_eq!(evaluated(&copy), evaluated(source));
    let make = ["manifest", "make", PUSHT, "--tier", "historic", "--out", &task, "--dataset", &copy];
    swm_ok(&[&make[..], &pairs].concat());
}
