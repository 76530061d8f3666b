//! What a user adds: an environment in a crate of one's own.

use crate::home::Home;

#[test]
fn a_crate_is_made_outside_of_the_checkout() {
    let home = Home::new();
    let said = home.ok("new-env my-env");
    assert!(said.out.contains("cargo test"), "{}", said.out);
    let manifest = std::fs::read_to_string(home.path("my-env/Cargo.toml")).unwrap();
    let manifest: toml::Table = manifest.parse().expect("cargo can read it");
    let taken_from = &manifest["patch"]["crates-io"];
    assert!(
        ["swm", "swm-core", "swm-fov"].iter().all(|name| taken_from.get(*name).is_some()),
        "{taken_from}"
    );
    home.refused("new-env my-env", &["not empty"]);
}
