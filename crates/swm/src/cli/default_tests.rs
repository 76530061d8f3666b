//! The defaults that help texts name, compared with those of the requests: the table of each request is the one source.

use clap::{Arg, Command, CommandFactory as _};
use serde_json::Value as Json;
use swm_core::Setting;
use swm_core::settings::Settings;
use swm_tasks::request::{
    Bench, Convert, Diff, Evaluate, Inspect, MakeBoard, MakeBundle, MakeManifest, Measure, Merge, Plan,
    Preview, Record, Render, Replay, Split, Stats, Sweep, Train, Verify,
};

use super::Cli;

/// A command, and the settings of its request.
struct Table {
    command: &'static str,
    settings: &'static [Setting],
    values: Json,
}

fn table<T: Settings>(command: &'static str) -> Table {
    let values = serde_json::to_value(T::default()).expect("settings are JSON");
    Table { command, settings: T::SETTINGS, values }
}

fn tables() -> Vec<Table> {
    vec![
        table::<Bench>("bench"),
        table::<Convert>("convert"),
        table::<Diff>("diff"),
        table::<Evaluate>("eval"),
        table::<Inspect>("inspect"),
        table::<MakeBoard>("board"),
        table::<MakeBundle>("bundle"),
        table::<MakeManifest>("manifest make"),
        table::<Measure>("quality"),
        table::<Merge>("merge"),
        table::<Plan>("plan"),
        table::<Preview>("preview"),
        table::<Record>("collect"),
        table::<Render>("render"),
        table::<Replay>("replay"),
        table::<Split>("split"),
        table::<Stats>("stats"),
        table::<Sweep>("sweep"),
        table::<Train>("train"),
        table::<Verify>("verify"),
    ]
}

fn command(path: &str) -> Command {
    let mut command = Cli::command();
    command.build();
    path.split(' ').fold(command, |command, name| {
        let below = command.find_subcommand(name);
        below.unwrap_or_else(|| panic!("no command `{path}`")).clone()
    })
}

/// Whether two texts are the same value: numbers by value, `1` is `1.0`.
fn is_same(first: &str, other: &str) -> bool {
    let number = |text: &str| text.parse::<f64>().ok();
    first == other || number(first).is_some_and(|value| number(other) == Some(value))
}

/// The numbers in a text, sizes of images among them.
fn numbers(text: &str) -> Vec<&str> {
    let is_part = |c: char| c.is_alphanumeric() || "._-".contains(c);
    let words = text.split(|c| !is_part(c)).map(|word| word.trim_end_matches('.'));
    words.filter(|word| word.starts_with(|c: char| c.is_ascii_digit())).collect()
}

/// What a help text calls the default: the sentence behind `Default:`.
fn stated(help: &str) -> Option<&str> {
    let (_, rest) = help.split_once("efault: ")?;
    let ends = |(at, _): &(usize, &str)| rest[at + 2..].starts_with(char::is_uppercase);
    let end = rest.match_indices(". ").find(ends).map_or(rest.len(), |(at, _)| at);
    Some(rest[..end].trim_end_matches('.'))
}

/// What is wrong with the default of a help text, where it names one.
fn difference(help: &str, default: &str) -> Option<String> {
    let stated = stated(help)?;
    let first = stated.split([' ', ',', ';', ':']).next().unwrap_or_default().trim_matches('`');
    let is_word = !default.contains(' ');
    let agrees = match is_word {
        true => is_same(first, default),
        false => numbers(stated) == numbers(default),
    };
    (!agrees).then(|| format!("`{stated}` in the help, `{default}` in the request"))
}

fn help(argument: &Arg) -> String {
    argument.get_long_help().or(argument.get_help()).map(ToString::to_string).unwrap_or_default()
}

#[test]
fn help_names_the_defaults_of_the_requests() {
    let (mut wrong, mut stating, mut filled) = (Vec::new(), Vec::new(), Vec::new());
    for table in tables() {
        for argument in command(table.command).get_arguments() {
            let Some(name) = argument.get_long().map(|long| long.replace('-', "_")) else { continue };
            let Some(setting) = table.settings.iter().find(|setting| setting.name == name) else { continue };
            let place = format!("{} --{}", table.command, name.replace('_', "-"));
            let help = help(argument);
            wrong.extend(difference(&help, setting.default).map(|text| format!("swm {place}: {text}")));
            let values = argument.get_default_values().iter().map(|value| value.to_string_lossy());
            let value = values.collect::<Vec<_>>().join(",");
            if !value.is_empty() && !is_same(&value, setting.default) {
                wrong.push(format!("swm {place}: `{value}` of clap, `{}` in the request", setting.default));
            }
            if stated(&help).is_some() {
                stating.push(place);
            } else if !value.is_empty() {
                filled.push(place);
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    for known in ["train --epochs", "train --seed", "train --keep", "eval --budget", "manifest make --budget"]
    {
        assert!(stating.iter().any(|place| place == known), "{known}: {stating:?}");
    }
    for known in ["eval --num-envs", "board --num-envs", "train --split", "collect --max-steps"] {
        assert!(filled.iter().any(|place| place == known), "{known}: {filled:?}");
    }
}

#[test]
fn tables_of_requests_name_the_values_of_their_defaults() {
    for Table { command, settings, values } in tables() {
        for setting in settings {
            let value = match &values[setting.name] {
                Json::Number(number) => number.to_string(),
                Json::Bool(value) => value.to_string(),
                Json::String(text) if !text.is_empty() => text.clone(),
                _ => continue,
            };
            assert!(
                is_same(&value, setting.default),
                "{command}, {}: the default is `{value}`, and its text `{}`",
                setting.name,
                setting.default
            );
        }
    }
}

#[test]
fn another_default_is_found() {
    let wrong = |help: &str, default: &str| difference(help, default).is_some();
    assert!(!wrong("Steps. Default: 200, or 50 with --dataset.", "200, or 50 with a dataset"));
    assert!(wrong("Steps. Default: 100, or 50 with --dataset.", "200, or 50 with a dataset"));
    assert!(wrong("Steps. Default: 20.", "20, of an agent 500; or the run's"));
    assert!(!wrong("How. Default: `drop`. It has 3 of them.", "drop"));
    assert!(wrong("How. Default: keep", "drop"));
    assert!(!wrong("Size; default: 64x64 where there is none", "64x64"));
    assert!(!wrong("Frames, of 1 to 10", "8"));
    assert!(is_same("1", "1.0") && is_same("0.000001", "1e-6") && !is_same("1", "2") && !is_same("a", "b"));
}
