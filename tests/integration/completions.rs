//! Completions by the shells themselves: each reads the script that `swm completions` prints, and completes lines with it. A shell that
//! is not installed is named and left out.

use std::process::Command;

use crate::support::{Folder, swm_ok};

/// Lines, and the word that one press of the tabulator must offer (or complete to) at their end.
const LINES: &[(&str, &str)] = &[
    ("swm verify-r", "verify-result"),
    ("swm manifest m", "make"),
    ("swm eval --manif", "--manifest"),
    ("swm manifest make --tier st", "strict"),
];

/// Prints what is offered for each of the lines that are its arguments: one line each, words with blanks between them.
const BASH: &str = r#"
source "$0"
for line in "$@"; do
    COMP_WORDS=($line) COMP_CWORD=$((${#COMP_WORDS[@]} - 1)) COMPREPLY=()
    _swm swm "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
    echo "${COMPREPLY[@]}"
done
"#;

const FISH: &str = r#"
source $argv[1]
for line in $argv[2..]
    echo (complete --do-complete "$line" | string split --fields 1 \t)
end
"#;

/// Completion happens at a prompt only, so there is one, behind a terminal of its own: a key completes and writes the line to a file.
const ZSH: &str = r#"
zmodload zsh/zpty
folder=${1:h}
shift
zpty shell 'zsh -f -i'
zpty -w shell "fpath=($folder \$fpath); autoload -U compinit; compinit -u -D
    complete-and-show() { zle complete-word; print -r -- \"\$BUFFER\" >> $folder/lines; BUFFER= }
    zle -N complete-and-show; bindkey '^T' complete-and-show; print REA''DY"
zpty -r shell said '*READY*'
for line in "$@"; do zpty -w -n shell "$line"$'\x14'; done
zpty -w shell exit
while zpty -r shell said; do :; done
cat $folder/lines
"#;

/// Completes all lines in a shell that begins with `arguments`, which end before the script's file.
fn completes(shell: &str, file: &str, arguments: &[&str]) {
    if Command::new(shell).arg("--version").output().is_err() {
        return eprintln!("{shell} is not installed: it completes nothing here");
    }
    let folder = Folder::new();
    let script = folder.path(file);
    std::fs::write(&script, swm_ok(&["completions", shell])).expect("the script is written");
    let lines = LINES.iter().map(|(line, _)| line);
    let output = Command::new(shell).args(arguments).arg(script).args(lines).output();
    let output = output.expect("it has just told its version");
    let printed = String::from_utf8_lossy(&output.stdout);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(printed.lines().count(), LINES.len(), "{shell} printed\n{printed}{said}");
    for ((line, word), offered) in LINES.iter().zip(printed.lines()) {
        // zsh writes the sign before an option's value, too.
        let mut offers = offered.split_whitespace().map(|offer| offer.trim_end_matches('='));
        assert!(offers.any(|offer| offer == *word), "{shell}: `{line}`: {offered}");
    }
}

#[test]
fn bash_completes() {
    completes("bash", "swm", &["--norc", "-c", BASH]);
}

#[test]
fn fish_completes() {
    completes("fish", "swm.fish", &["--no-config", "-c", FISH]);
}

#[test]
fn zsh_completes() {
    completes("zsh", "_swm", &["-f", "-c", ZSH, "zsh"]);
}
