//! Two processes that make the same file or folder at once: what is there afterwards is of one of them, and the other one says so.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

use crate::evaluation::manifest;
use crate::support::{Folder, PUSHT, record, swm};

/// The files below a folder, or a file, with their content; without what differs from run to run: times and names of processes.
fn content(path: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    if path.is_file() {
        return vec![(PathBuf::new(), fs::read(path).expect("the folder is ours"))];
    }
    let mut all = Vec::new();
    let mut folders = vec![path.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder)
            .expect("the folder is ours")
            .map(|entry| entry.expect("the folder is ours").path())
        {
            match entry.is_dir() {
                true => folders.push(entry),
                false => {
                    let text = fs::read(&entry).expect("the folder is ours");
                    all.push((
                        entry.strip_prefix(path).expect("the folder is ours").to_owned(),
                        without_times(text),
                    ));
                }
            }
        }
    }
    all.sort();
    all
}

fn without_times(bytes: Vec<u8>) -> Vec<u8> {
    let Ok(text) = String::from_utf8(bytes.clone()) else { return bytes };
    let is_time =
        |line: &&str| ["wall_time_s", "\"modified\"", "seconds"].iter().any(|name| line.contains(name));
    text.lines().filter(|line| !is_time(line)).flat_map(|line| [line, "\n"]).collect::<String>().into_bytes()
}

/// Starts a command; its words are divided at blanks.
fn start(line: &str) -> Child {
    let words: Vec<&str> = line.split_whitespace().collect();
    swm(&words).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the command under test starts")
}

#[test]
fn of_two_commands_that_make_one_result_at_once_one_makes_it() {
    let folder = Folder::new();
    let data = record(&folder, "a.h5", "--episodes 8 --max-steps 6 --image-size none --seed 2");
    let other = record(&folder, "b.h5", "--episodes 8 --max-steps 6 --image-size none --seed 3");
    let task = manifest(&folder, "historic", "m.toml", &[]);
    let receipt = |name: &str, policy: &str| {
        let out = folder.path(name);
        let line = format!("eval --manifest {task} --policy {policy} --reference none --out {out}");
        assert!(start(&line).wait().unwrap().success());
        out
    };
    let [first, second] = [receipt("one", "random"), receipt("two", "no-op")];
    let [one_bundle, another] = [("one-bundle", &first), ("another", &second)].map(|(name, result)| {
        let out = folder.path(name);
        assert!(start(&format!("bundle {result} --out {out}")).wait().unwrap().success());
        out
    });
    let (in_order, reversed) = (format!("{data} {other}"), format!("{other} {data}"));
    let job = "submit --on script --no-copy --shards";
    let short = "collect swm/TwoRoom-v2 --policy expert --max-steps 6 --image-size none --episodes 4";
    // The command with what two requests differ in at `{}`; both; what it makes.
    let commands = [
        (
            format!(
                "collect {PUSHT} --episodes 4 --max-steps 6 --image-size none --seed {{}} --mode error --out"
            ),
            ["1", "2"],
            "c.h5",
        ),
        (
            format!("collect {PUSHT} --episodes 4 --max-steps 6 --seed {{}} --mode error --out"),
            ["1", "2"],
            "c.folder",
        ),
        ("convert {}".to_owned(), [&*data, &*other], "d.mcap"),
        ("merge {} --out".to_owned(), [&*in_order, &*reversed], "e.h5"),
        (
            format!("eval {PUSHT} --policy random --budget 3 --videos 0 --episodes 3 --seed {{}} --out"),
            ["1", "2"],
            "f",
        ),
        (format!("eval --manifest {task} --reference none --policy {{}} --out"), ["random", "no-op"], "g"),
        (
            format!("sweep --manifest {task} --factors block.color --policy {{}} --out"),
            ["random", "no-op"],
            "h",
        ),
        ("report --videos 0 --plans 0 --overwrite {} --out".to_owned(), [&*first, &*second], "i.html"),
        ("new-env {} --out".to_owned(), ["one", "two"], "j"),
        ("bundle {} --out".to_owned(), [&*first, &*second], "m"),
        ("board {} --out".to_owned(), [&*one_bundle, &*another], "n"),
        (format!("{job} {{}} -- {short} --job"), ["2", "4"], "k"),
        (
            format!("manifest make {PUSHT} --tier historic --overwrite --episodes {{}} --out"),
            ["2", "3"],
            "l.toml",
        ),
    ];
    for (line, [one, two], name) in &commands {
        let line = |what: &str, out: &str| {
            let line = line.replace("{}", what);
            match line.split_once(" -- ") {
                // What comes behind the dashes is the command of the job.
                Some((submit, of)) => {
                    let of = of.trim_end_matches(" --job");
                    format!("{submit} --job {out} -- {of}")
                }
                None => format!("{line} {out}"),
            }
        };
        let alone = [one, two].map(|what| {
            let out = folder.path(&format!("alone-{}-{name}", alone_name(what)));
            let output = start(&line(what, &out)).wait_with_output().unwrap();
            assert!(
                output.status.success(),
                "{}: {}",
                line(what, &out),
                String::from_utf8_lossy(&output.stderr)
            );
            (content(Path::new(&out)), out)
        });
        assert_ne!(alone[0].0, alone[1].0, "{name}: the requests differ");
        for round in 0..2 {
            let out = folder.path(&format!("{round}-{name}"));
            let both = [one, two].map(|what| start(&line(what, &out)));
            let ended = both.map(|child| child.wait_with_output().unwrap());
            let messages = ended.each_ref().map(|end| String::from_utf8_lossy(&end.stderr).into_owned());
            assert!(ended.iter().any(|end| end.status.success()), "{name}: {messages:?}");
            for (end, message) in ended.iter().zip(&messages) {
                assert!(matches!(end.status.code(), Some(0..=2)), "{name}: {message}");
                assert!(!message.contains("panicked"), "{name}: {message}");
            }
            // Names of folders are in reports and jobs.
            let plain = |(content, at): &(Vec<(PathBuf, Vec<u8>)>, String)| {
                let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).replace(at.as_str(), "OUT");
                content.iter().map(|(path, bytes)| (path.clone(), text(bytes))).collect::<Vec<_>>()
            };
            let made = plain(&(content(Path::new(&out)), out.clone()));
            let winner = alone.iter().position(|alone| plain(alone) == made);
            assert!(
                winner.is_some(),
                "{name}: it is of neither: {:?}\n{messages:?}",
                made.iter().map(|(path, _)| path).collect::<Vec<_>>()
            );
            let successes = ended.iter().filter(|end| end.status.success()).count();
            if successes == 1 {
                let winner = winner.expect("checked above");
                assert!(ended[winner].status.success(), "{name}: it is of the one that failed: {messages:?}");
                let loser = &messages[1 - winner];
                assert!(loser.contains(&*out) || loser.contains("process "), "{name}: {loser}");
            }
            // Commands that keep what is there never have two winners.
            let replaces = ["report", "manifest", "board"].iter().any(|word| line(one, "").starts_with(word));
            assert!(successes == 1 || replaces, "{name}: both succeeded: {messages:?}");
        }
    }
}

/// A part of a name.
fn alone_name(what: &str) -> String {
    what.chars().filter(char::is_ascii_alphanumeric).collect()
}
