//! Options that exclude each other: what to do instead.

use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue, Error, ErrorKind};

/// An option, and the remedy for whoever gives it with one that it excludes.
const REMEDIES: &[(&str, &str)] = &[
    (
        "--manifest",
        "a manifest fixes the environment, its episodes, budget, factors and images; `swm manifest make` makes another one",
    ),
    (
        "--resume",
        "a run that is resumed goes on with its own settings and data; for others, start a new one with another --out",
    ),
    (
        "--replayable",
        "a replayable recording holds no images: whatever reads it renders them, in the size asked for then",
    ),
    ("--pairs", "the pairs say episodes, starts and goals; leave the other options out"),
    (
        "--join",
        "--shard computes one part, --join joins the parts once all are there, --again replaces a whole result",
    ),
    (
        "--shard",
        "--shard computes one part, --join joins the parts once all are there, --again replaces a whole result",
    ),
    ("--each", "each line of the file is a shard; leave --shards out"),
    ("--total", "--total counts the episodes that are there, --episodes only the new ones; give one of them"),
];

/// The error with a remedy, where it is about options that exclude each other.
pub(super) fn explained(mut error: Error) -> Error {
    if error.kind() == ErrorKind::ArgumentConflict {
        let named = |kind| match error.get(kind) {
            Some(ContextValue::String(name)) => name.clone(),
            Some(ContextValue::Strings(names)) => names.join(" "),
            _ => String::new(),
        };
        let names = named(ContextKind::InvalidArg) + " " + &named(ContextKind::PriorArg);
        let is_named = |(option, _): &&(&str, &str)| names.split(' ').any(|word| word == *option);
        if let Some((_, remedy)) = REMEDIES.iter().find(is_named) {
            let tip = ContextValue::StyledStrs(vec![StyledStr::from(*remedy)]);
            error.insert(ContextKind::Suggested, tip);
        }
    }
    error
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;
    use crate::cli::Cli;

    fn message(line: &str) -> String {
        explained(Cli::command().try_get_matches_from(line.split(' ')).unwrap_err()).to_string()
    }

    #[test]
    fn options_that_exclude_each_other_name_a_remedy() {
        for (line, words) in [
            ("swm eval --manifest a.toml --policy weak --episodes 3", "swm manifest make"),
            (
                "swm collect swm/PushT-v1 --policy weak --out a.h5 --replayable --image-size 64x64",
                "renders them",
            ),
            ("swm collect swm/PushT-v1 --policy weak --out a.h5 --total 5 --episodes 3", "give one of them"),
            ("swm sweep --manifest a.toml --policy weak --out b --shard 1/2 --again", "joins the parts"),
        ] {
            let message = message(line);
            assert!(message.contains("cannot be used with") && message.contains("tip: "), "{message}");
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn every_option_of_the_table_exists() {
        let all = Cli::command();
        let options: Vec<String> = std::iter::once(&all)
            .chain(all.get_subcommands())
            .chain(all.get_subcommands().flat_map(clap::Command::get_subcommands))
            .flat_map(clap::Command::get_arguments)
            .filter_map(|argument| argument.get_long().map(|long| format!("--{long}")))
            .collect();
        for (option, _) in REMEDIES {
            assert!(options.iter().any(|known| known == option), "{option}");
        }
    }
}
