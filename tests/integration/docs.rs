//! Tables in the docs are those of the code. `SWM_UPDATE_DOCS=1` writes them.

use std::fmt::Write as _;
use std::path::Path;

use swm::core::{EnvConfig, Registry, Setting, Settings as _};
use swm::solvers::{PlanConfig, SOLVERS, SimulatorOptions};

use crate::support::root;

/// The Markdown table of an environment's factors.
fn factor_table(registry: &Registry, id: &str) -> String {
    let env = registry.env(id).expect("it exists").make(&EnvConfig::default()).expect("defaults are valid");
    swm::fov::markdown(&env.spec().factors)
}

fn write_or_compare(path: &Path, found: &str, current: &str) {
    if std::env::var_os("SWM_UPDATE_DOCS").is_some() {
        std::fs::write(path, current).expect("docs can be written");
    } else {
        assert!(found == current, "{} is outdated; run this test with SWM_UPDATE_DOCS=1", path.display());
    }
}

/// A Markdown table of settings.
fn settings_table(settings: &[Setting]) -> String {
    let mut table = "| setting | default | what it does |\n|---|---|---|\n".to_owned();
    for setting in settings {
        let _ = writeln!(table, "| `{}` | `{}` | {} |", setting.name, setting.default, setting.doc);
    }
    table
}

/// `text` with `content` between the marker `name` and the next end marker.
fn with_table(text: &str, name: &str, content: &str) -> String {
    let marker = format!("<!-- {name} -->\n");
    let (head, rest) = text.split_once(&marker).expect("the marker is there");
    let (_, tail) = rest.split_once("<!-- end -->").expect("the table ends");
    format!("{head}{marker}{content}<!-- end -->{tail}")
}

#[test]
fn solver_tables_are_current() {
    let path = root().join("docs/solvers.md");
    let text = std::fs::read_to_string(&path).unwrap();
    let mut solvers = "| solver | what it does |\n|---|---|\n".to_owned();
    for solver in SOLVERS {
        let _ = writeln!(solvers, "| [`{0}`](#{0}) | {1} |", solver.name, solver.summary);
    }
    for solver in SOLVERS {
        let note = "Plans on models of the dynamics, not on the true simulator.\n\n";
        let note = if solver.plans_on_simulator { "" } else { note };
        let _ = write!(solvers, "\n### {}\n\n{note}{}", solver.name, settings_table(solver.settings));
    }
    let current = with_table(&text, "solvers", &solvers);
    let current = with_table(&current, "plan settings", &settings_table(PlanConfig::SETTINGS));
    let current = with_table(&current, "simulator settings", &settings_table(SimulatorOptions::SETTINGS));
    write_or_compare(&path, &text, &current);
}

#[test]
fn the_table_of_traps_is_current() {
    let path = root().join("docs/traps.md");
    let text = std::fs::read_to_string(&path).unwrap();
    write_or_compare(&path, &text, &with_table(&text, "traps", &swm::tasks::traps::markdown()));
}

#[test]
fn factor_tables_are_current() {
    let registry = swm::registry();
    let mut pages = 0;
    for entry in std::fs::read_dir(root().join("docs/envs")).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        let (mut current, mut left) = (String::new(), text.as_str());
        while let Some((head, rest)) = left.split_once("<!-- factors of ") {
            let (id, rest) = rest.split_once(" -->\n").expect("the marker ends");
            let (_, tail) = rest.split_once("<!-- end -->").expect("the table ends");
            let table = factor_table(&registry, id);
            let _ = write!(current, "{head}<!-- factors of {id} -->\n{table}<!-- end -->");
            left = tail;
        }
        pages += usize::from(!current.is_empty());
        current.push_str(left);
        write_or_compare(&path, &text, &current);
    }
    assert!(pages > 0, "no page of an environment has a factor table");
}

/// The order of sections on the pages of environments; a page may leave out some. Others come between `Policies` and `Exactness`.
const SECTIONS: &[&str] = &[
    "Tasks",
    "Starts and goals",
    "Factors of variation",
    "Settings",
    "Policies",
    "Exactness",
    "Speed",
    "Differences from the reference",
];

#[test]
fn pages_of_environments_have_one_form() {
    for entry in std::fs::read_dir(root().join("docs/envs")).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        if !text.contains("<!-- factors of ") {
            continue; // What several environments share.
        }
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let sections: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("## ")).collect();
        for wanted in ["Factors of variation", "Policies"] {
            assert!(sections.contains(&wanted), "{name} has no section `{wanted}`");
        }
        let known = sections.iter().filter_map(|name| SECTIONS.iter().position(|known| known == name));
        assert!(known.is_sorted(), "{name}: its sections are {sections:?}; their order is {SECTIONS:?}");
        let images = text.matches("../gallery/").count();
        assert!(images >= 2, "{name} shows {images} images: by default, and with all factors varied");
    }
}

#[test]
fn the_table_of_planners_is_current() {
    let path = root().join("docs/envs/suite.md");
    let text = std::fs::read_to_string(&path).unwrap();
    let mut table = "| environment | `expert` |\n|---|---|\n".to_owned();
    for entry in swm::registry().envs() {
        if let Some(planner) = entry.planner.filter(|_| entry.id.contains("DMControl")) {
            let _ = writeln!(table, "| `{}` | `{planner}` |", entry.id);
        }
    }
    write_or_compare(&path, &text, &with_table(&text, "planners", &table));
}

#[test]
fn the_code_of_the_chapter_on_plugins_is_that_of_the_plugin() {
    let plugin = root().join("tests/plugin");
    let mut sources = String::new();
    for folder in [plugin.clone(), plugin.join("src"), plugin.join("tests")] {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "rs" || extension == "toml") {
                sources += &std::fs::read_to_string(path).unwrap();
            }
        }
    }
    let page = std::fs::read_to_string(root().join("docs/plugins.md")).unwrap();
    let blocks: Vec<&str> = page.split("```").skip(1).step_by(2).collect();
    let quoted =
        blocks.iter().filter_map(|block| block.strip_prefix("rust\n").or(block.strip_prefix("toml\n")));
    let missing: Vec<&str> = quoted.clone().filter(|block| !sources.contains(*block)).collect();
    assert!(quoted.count() >= 10 && missing.is_empty(), "not in tests/plugin:\n{}", missing.join("\n"));
}
