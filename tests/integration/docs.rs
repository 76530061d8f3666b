//! Tables in the docs are those of the code. `SWM_UPDATE_DOCS=1` writes them.

use swm::core::{EnvConfig, Registry};

use crate::support::root;

/// The Markdown table of an environment's factors.
fn factor_table(registry: &Registry, id: &str) -> String {
    let env = (registry.env(id).expect("it exists").make)(&EnvConfig::default()).expect("defaults are valid");
    swm::fov::markdown(&env.spec().factors)
}

#[test]
fn factor_tables_are_current() {
    let registry = swm::registry();
    let mut pages = 0;
    for entry in std::fs::read_dir(root().join("docs/envs")).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        let Some((head, rest)) = text.split_once("<!-- factors of ") else { continue };
        let (id, rest) = rest.split_once(" -->\n").expect("the marker ends");
        let (_, tail) = rest.split_once("<!-- end -->").expect("the table ends");
        let current =
            format!("{head}<!-- factors of {id} -->\n{}<!-- end -->{tail}", factor_table(&registry, id));
        if std::env::var_os("SWM_UPDATE_DOCS").is_some() {
            std::fs::write(&path, &current).unwrap();
        } else {
            assert!(text == current, "{} is outdated; run this test with SWM_UPDATE_DOCS=1", path.display());
        }
        pages += 1;
    }
    assert!(pages > 0, "no page of an environment has a factor table");
}
