//! Recording a dataset, looking at it, handing it on.

use crate::home::Home;

#[test]
fn a_dataset_is_recorded_continued_and_checked() {
    let home = Home::new();
    let collect = "collect swm/PushT-v1 --policy weak --seed 1 --max-steps 10 --image-size 32x32 --vary +agent.color --out data/a.h5";
    let said = home.ok(&format!("{collect} --episodes 4"));
    assert!(!said.err.contains("note"), "starts are still sampled: {}", said.err);
    home.ok(&format!("{collect} --total 6 --mode append"));
    let shown = home.json("inspect data/a.h5");
    assert_eq!(shown["episodes"], 6);
    assert!(shown["columns"]["variation.agent.start_position"].is_object(), "{shown}");
    home.ok("replay data/a.h5");
    home.ok("stats data/a.h5");
    home.ok("verify data/a.h5");
    home.ok("preview data/a.h5 --out sheet.png");
}

#[test]
fn a_recording_without_images_is_seen_converted_and_divided() {
    let home = Home::new();
    let collect = "collect swm/PushT-v1 --policy weak --episodes 4 --max-steps 10 --replayable";
    home.ok(&format!("{collect} --out small.h5"));
    home.ok(&format!("{collect} --seed 1 --vary +goal.angle --out angles.h5"));
    home.ok("merge small.h5 angles.h5 --out both.h5");
    home.ok("preview both.h5 --episodes 0..4 --out videos/grid.gif");
    let target = if cfg!(feature = "mp4") { "both.video" } else { "both.folder --image-size 64x64" };
    home.ok(&format!("convert both.h5 {target}"));
    let name = target.split(' ').next().unwrap();
    assert!(home.json(&format!("inspect {name}"))["columns"]["pixels"].is_object());
    home.ok("split both.h5 --parts train=3,val=1 --image-size 48x48 --out {}.h5");
    assert_eq!(home.json("inspect val.h5")["columns"]["pixels"]["shape"][0], 48);
}

#[test]
fn what_is_shown_of_a_dataset_says_something() {
    let home = Home::new();
    home.ok(
        "collect swm/PushT-v1 --policy weak --episodes 6 --max-steps 8 --image-size 24 --seed 1 --out a.h5",
    );
    // Means of indices and seeds are left out, unless they are asked for.
    let shown = home.ok("stats a.h5").out;
    assert!(shown.contains("hold no quantities: ep_idx, seed, step_idx"), "{shown}");
    assert!(!shown.lines().any(|line| line.starts_with("seed")), "{shown}");
    assert!(home.ok("stats a.h5 --columns seed").out.contains("\nseed"));
    // An image per episode is shown once.
    assert!(home.ok("preview a.h5 --column goal --out goals.png").out.contains("1 frame each"));
    home.ok("split a.h5 --parts val=0.4,train=0.6 --seed 1 --out {}.h5");
    home.ok("merge val.h5 train.h5 --out again.h5");
    let differs = |line: &str, told: &str| {
        let said = home.run(line);
        assert!(said.status == Some(1) && said.out.contains(told), "swm {line}:\n{}", said.out);
    };
    differs("diff a.h5 again.h5", "both hold the same episodes, in another order");
    differs("diff a.h5 train.h5", "every episode of the second is in the first");
}

#[cfg(unix)]
#[test]
fn an_interrupted_recording_goes_on() {
    use std::io::{BufRead as _, BufReader};
    use std::process::{Command, Stdio};

    let home = Home::new();
    let collect =
        "collect swm/PushT-v1 --policy weak --max-steps 10 --image-size 32x32 --report-every 0 --out a.h5";
    let mut child = home
        .command(&format!("{collect} --episodes 1000000"))
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .expect("the program starts");
    let mut lines = BufReader::new(child.stderr.take().expect("piped")).lines().map_while(Result::ok);
    assert!(lines.next().is_some_and(|line| line.starts_with("episode 0 written")));
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill is there");
    let advice = lines.find(|line| line.starts_with("interrupted: ")).expect("it says how to go on");
    assert!(advice.contains("--mode append"), "{advice}");
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    let held = home.json("inspect a.h5")["episodes"].as_u64().expect("a count");
    home.ok(&format!("{collect} --total {} --mode append", held + 1));
    assert_eq!(home.json("inspect a.h5")["episodes"], held + 1);
}
