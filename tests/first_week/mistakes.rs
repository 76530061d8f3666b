//! What a newcomer gets wrong, and is told.

use crate::home::Home;

#[test]
fn messages_name_the_fix() {
    let home = Home::new();
    let render = |rest: &str| format!("render swm/PushT-v1 --steps 0 --out a.png {rest}");
    home.refused("fovs swm/PushT", &["did you mean `swm/PushT-v1`?"]);
    home.refused(&render("--vary agent.colr"), &["did you mean `agent.color`?"]);
    home.refused(&render("--set agent.color=crimsonish"), &["is no color", "red"]);
    home.refused(&render("--policy expertt"), &["did you mean `expert`?"]);
    let narrow = home.ok(&render("--vary agent.color"));
    assert!(narrow.err.contains("--vary +agent.color"), "{}", narrow.err);
    home.ok(&render("--vary +*.color --set background.color=#203040"));
    for (name, feature) in [("onnx:model", "onnx"), ("mpc:runs/lewm", "baselines")] {
        let said = home.run(&render(&format!("--policy {name}")));
        // A program that has the feature misses the model.
        let is_told =
            said.err.contains(&format!("--features {feature}")) || !said.err.contains("unknown policy");
        assert!(said.status != Some(0) && is_told, "{}", said.err);
    }
}

#[test]
fn what_there_is_fits_on_a_page() {
    let home = Home::new();
    let shown = home.ok("envs swm/PushT-v1").out;
    assert!(shown.lines().count() < 80 && shown.contains("--full"), "{shown}");
    home.ok("fovs swm/PushT-v1");
    home.ok("solvers");
}
