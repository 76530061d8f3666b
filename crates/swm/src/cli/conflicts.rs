//! Options that exclude each other, are missing, do not exist or are no numbers: what to do instead.

use std::error::Error as StdError;
use std::num::{ParseFloatError, ParseIntError};

use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue, Error, ErrorKind};

use super::work::is_divided;

/// An option, and the remedy for whoever gives it with one that it excludes.
const REMEDIES: &[(&str, &str)] = &[
    (
        "--seed",
        "a manifest fixes the seeds of its episodes; `swm eval --policy-seed N` repeats them with other noise of the policy, and `swm manifest make --seed N` \
         makes other episodes",
    ),
    (
        "--manifest",
        "a manifest fixes the environment, its episodes, budget, factors and images; `swm manifest make` makes another one",
    ),
    (
        "--resume",
        "a run that is resumed goes on with its own settings and data: `swm train --resume RUN`; for others, start a new one with another \
         --out",
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

/// An option that is required, and what else there is.
const REQUIRED: &[(&str, &str)] = &[(
    "--episodes",
    "--episodes N records N new episodes; --total N with --mode append records what is missing of N",
)];

/// An option that some commands do not have, and where it is.
const ELSEWHERE: &[(&str, &str)] = &[
    ("--set", "factors are set where episodes are made: `swm manifest make --set`, `swm collect --set`"),
    ("--vary", "factors vary where episodes are made: `swm manifest make --vary`, `swm collect --vary`"),
    (
        "--overwrite",
        "`swm collect` replaces a dataset by --mode overwrite, `swm eval` and `swm sweep` replace a result by --again",
    ),
    ("--out", "`swm convert SOURCE TARGET` names what it writes without an option"),
    ("--dataset", "starts and goals of a dataset: `swm manifest make --dataset`, `swm eval --dataset`"),
    ("--key-frames", "`swm convert --key-frames` sets the period of key frames of a video"),
];

/// For a command that `swm submit` divides.
const DIVIDED: &str =
    "the command to divide comes after `--`: swm submit --shards 4 -- collect swm/PushT-v1 --episodes 1000";

/// The error with a tip, where there is one for the options that it is about.
pub(super) fn explained(mut error: Error) -> Error {
    let named = |kind| match error.get(kind) {
        Some(ContextValue::String(name)) => name.clone(),
        Some(ContextValue::Strings(names)) => names.join(" "),
        _ => String::new(),
    };
    let names = named(ContextKind::InvalidArg) + " " + &named(ContextKind::PriorArg);
    let of = |tips: &'static [(&str, &str)]| {
        let is_named = |(option, _): &&(&str, &str)| names.split(' ').any(|word| word == *option);
        tips.iter().find(is_named).map(|(_, tip)| *tip)
    };
    let tip = match error.kind() {
        ErrorKind::ArgumentConflict => of(REMEDIES),
        ErrorKind::MissingRequiredArgument => of(REQUIRED),
        // Where an argument of another name is near, that is said already.
        ErrorKind::UnknownArgument if error.get(ContextKind::SuggestedArg).is_some() => None,
        ErrorKind::UnknownArgument if names.trim().parse::<f64>().is_ok() => {
            Some("most options take numbers of 0 or more; one that takes others is written --option=-3")
        }
        ErrorKind::UnknownArgument if is_divided(names.trim()) => Some(DIVIDED),
        ErrorKind::UnknownArgument => of(ELSEWHERE),
        ErrorKind::ValueValidation => error.source().and_then(number_tip),
        _ => None,
    };
    if let Some(tip) = tip {
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![StyledStr::from(tip)]));
    }
    error
}

/// What to write in place of what is no number.
fn number_tip(source: &(dyn StdError + 'static)) -> Option<&'static str> {
    if source.is::<ParseIntError>() {
        Some("write a whole number of 0 or more, such as 100, without unit, point or exponent")
    } else if source.is::<ParseFloatError>() {
        Some("write a number, such as 0.5 or 1e-3")
    } else {
        None
    }
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
            ("swm eval --manifest a.toml --policy weak --seed 3", "--policy-seed N"),
            (
                "swm collect swm/PushT-v1 --policy weak --out a.h5 --replayable --image-size 64x64",
                "renders them",
            ),
            ("swm collect swm/PushT-v1 --policy weak --out a.h5 --total 5 --episodes 3", "give one of them"),
            ("swm sweep --manifest a.toml --policy weak --out b --shard 1/2 --again", "joins the parts"),
            ("swm train lewm --resume --out b", "swm train --resume RUN"),
        ] {
            let message = message(line);
            assert!(message.contains("cannot be used with") && message.contains("tip: "), "{message}");
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn what_is_missing_or_elsewhere_is_said() {
        for (line, words) in [
            ("swm collect swm/PushT-v1 --policy weak --out a.h5", "--total N"),
            (
                "swm sweep --manifest a.toml --policy weak --out b --set agent.color=red",
                "swm manifest make --set",
            ),
            ("swm eval swm/PushT-v1 --policy weak --episodes -3", "--option=-3"),
            ("swm collect swm/PushT-v1 --episodes 3 --out a.h5 --overwrite", "--mode overwrite"),
            ("swm convert a.h5 --out b.mcap", "swm convert SOURCE TARGET"),
            ("swm submit --shards 2 collect swm/PushT-v1 --episodes 3", "comes after `--`"),
        ] {
            let message = message(line);
            assert!(message.contains("tip: ") && message.contains(words), "{message}");
        }
        assert!(!message("swm eval swm/PushT-v1 --epsodes 3").contains("--option="));
    }

    #[test]
    fn what_is_no_number_is_told_with_one() {
        for (line, words) in [
            ("swm train sac --steps=-3", "whole number of 0 or more"),
            ("swm eval swm/PushT-v1 --policy weak --episodes ten", "such as 100"),
            ("swm train lewm --split half", "such as 0.5"),
        ] {
            let message = message(line);
            assert!(message.contains("tip: ") && message.contains(words), "{message}");
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
