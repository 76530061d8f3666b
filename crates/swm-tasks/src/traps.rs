//! Known traps among Python packages: what surprised on valid input, by version. The table is `traps.toml`, and `docs/traps.md` shows it.

use std::fmt::Write as _;
use std::process::{Command, Stdio};
use std::sync::LazyLock;

use serde::Deserialize;

/// What a version of some software does that users do not expect.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trap {
    /// The software and its versions, as people write them.
    pub software: String,
    /// What it does.
    pub does: String,
    /// Who meets it here.
    pub who: String,
    /// What to do.
    pub fix: String,
    /// The script in `findings/` that shows it; none where it takes data of others.
    pub script: Option<String>,
    /// Packages that have it when all are installed; none: it cannot be seen from packages.
    #[serde(default)]
    pub when: Vec<Need>,
}

/// A package and which versions of it: `>=3.12`, `<2`, `==3.16` (and `3.16.1`), several by commas.
#[derive(Debug, Deserialize)]
pub struct Need(pub String, pub String);

/// All known traps.
pub static TRAPS: LazyLock<Vec<Trap>> = LazyLock::new(|| {
    #[derive(Deserialize)]
    struct Table {
        trap: Vec<Trap>,
    }
    let table: Table = toml::from_str(include_str!("traps.toml")).expect("the table is constant");
    table.trap
});

/// The table of `docs/traps.md`, in Markdown.
#[must_use]
pub fn markdown() -> String {
    let mut table = "| software, version | what it does | who meets it here | what to do | script |\n|---|---|---|---|---|\n".to_owned();
    for Trap { software, does, who, fix, script, .. } in TRAPS.iter() {
        let script = script.as_ref().map(|name| format!("[`{name}`](../findings/{name}.sh)"));
        let script = script.as_deref().unwrap_or("–");
        let _ = writeln!(table, "| {software} | {does} | {who} | {fix} | {script} |");
    }
    table
}

/// A trap that is installed: the packages with their versions, and the row of the table.
#[derive(Debug)]
pub struct Found {
    /// The packages.
    pub packages: String,
    /// The row.
    pub trap: &'static Trap,
}

/// Packages of a Python, as (name, version).
type Packages = Vec<(String, String)>;

/// The traps among the packages of the first Python that starts; `None` where none does.
pub fn installed() -> Option<(String, Vec<Found>)> {
    let (python, packages) =
        pythons().find_map(|python| packages_of(&python).map(|found| (python, found)))?;
    Some((python, among(&packages)))
}

/// The Python that runs the command in the wheel, else those of the search path.
pub fn pythons() -> impl Iterator<Item = String> {
    std::env::var("SWM_PYTHON").ok().into_iter().chain(["python3".to_owned(), "python".to_owned()])
}

fn packages_of(python: &str) -> Option<Packages> {
    // Without the current folder, whose files are no packages.
    const LIST: &str = "import sys; sys.path = [p for p in sys.path if p]\n\
        from importlib.metadata import distributions\n\
        for one in distributions():\n    \
        print('package', one.metadata['Name'], one.version)";
    let mut command = Command::new(python);
    command.args(["-c", LIST]).stdin(Stdio::null()).stderr(Stdio::null());
    let output = command.output().ok().filter(|output| output.status.success())?;
    let text = String::from_utf8_lossy(&output.stdout);
    let of_line = |line: &str| {
        let (name, version) = line.strip_prefix("package ")?.rsplit_once(' ')?;
        Some((normalized(name), version.to_owned()))
    };
    Some(text.lines().filter_map(of_line).collect())
}

/// The name by which pip compares packages.
fn normalized(name: &str) -> String {
    name.to_ascii_lowercase().replace(['_', '.'], "-")
}

fn among(packages: &Packages) -> Vec<Found> {
    let version_of = |need: &Need| {
        let (_, version) = packages.iter().find(|(name, _)| *name == normalized(&need.0))?;
        fits(version, &need.1).then(|| format!("{} {version}", need.0))
    };
    let found = |trap: &'static Trap| {
        let named: Option<Vec<_>> = trap.when.iter().map(version_of).collect();
        named.filter(|named| !named.is_empty()).map(|named| Found { packages: named.join(", "), trap })
    };
    TRAPS.iter().filter_map(found).collect()
}

/// Whether a version is among those of a [`Need`].
fn fits(version: &str, versions: &str) -> bool {
    versions.split(',').all(|bound| {
        let operator = bound.len() - bound.trim_start_matches(['<', '>', '=']).len();
        let (operator, bound) = bound.split_at(operator);
        let (version, bound) = (numbers(version), numbers(bound));
        match operator {
            "==" => version.starts_with(&bound),
            ">=" => version >= bound,
            // `<=4.0` takes 4.0.1, too.
            "<=" => version <= bound || version.starts_with(&bound),
            "<" => version < bound,
            _ => false,
        }
    })
}

/// `3.16.0rc1` -> 3, 16, 0.
fn numbers(version: &str) -> Vec<u64> {
    let digits =
        |part: &str| part.split(|c: char| !c.is_ascii_digit()).next().and_then(|digits| digits.parse().ok());
    version.split('.').map_while(digits).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn versions_are_compared_by_number() {
        assert!(fits("3.16.0", "==3.16") && !fits("3.160", "==3.16") && !fits("3.9.1", ">=3.12"));
        assert!(fits("1.24.4", "<1.26") && !fits("1.26.0", "<1.26") && fits("4.0.1rc2", ">=3.12,<=4.0"));
        assert!(fits("2.15.0+cu132", "==2.15") && !fits("2.15", "~=2.15"));
    }

    #[test]
    fn a_trap_is_found_where_all_of_its_packages_are() {
        let packages = |all: &[(&str, &str)]| -> Packages {
            all.iter().map(|(name, version)| (normalized(name), (*version).to_owned())).collect()
        };
        assert!(among(&packages(&[("MuJoCo", "3.3.1"), ("dm_control", "1.0.50")])).is_empty());
        let found = among(&packages(&[("mujoco", "4.0.0"), ("dm-control", "1.0.50")]));
        let one = found.iter().find(|found| found.packages.contains("dm_control")).unwrap();
        assert_eq!(one.packages, "mujoco 4.0.0, dm_control 1.0.50");
        assert!(one.trap.does.contains("none of its 51 tasks"), "{}", one.trap.does);
    }

    #[test]
    fn rows_are_whole_and_their_scripts_are_there() {
        let folder = root().join("findings");
        for trap in TRAPS.iter() {
            let Trap { software, does, who, fix, script, when } = trap;
            let texts = [software, does, who, fix];
            assert!(texts.iter().all(|text| !text.is_empty() && !text.contains(['|', '\n'])), "{software}");
            for bound in when.iter().flat_map(|need| need.1.split(',')) {
                let version = bound.trim_start_matches(['<', '>', '=']);
                assert!(version != bound && !numbers(version).is_empty(), "{software}: {bound}");
            }
            if let Some(script) = script {
                let text = std::fs::read_to_string(folder.join(format!("{script}.sh"))).expect(script);
                let headers = ["# Software:", "# Expected:", "# Happens:", "# Who:", "# Seen:"];
                assert!(headers.iter().all(|header| text.contains(header)), "{script}");
            }
        }
        for entry in std::fs::read_dir(folder).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            let stem = name.trim_end_matches(".sh");
            let is_row = TRAPS.iter().any(|trap| trap.script.as_deref() == Some(stem));
            assert!(
                is_row || ["python", "README.md"].contains(&stem),
                "no row of the table has findings/{name}"
            );
        }
    }

    fn root() -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
    }
}
