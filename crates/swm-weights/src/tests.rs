//! Files that PyTorch wrote, and such files with one thing wrong: what is read, and what is refused with which words.

use std::path::{Path, PathBuf};

use crate::pickle::Found;
use crate::pickles::{Container, Pickles};
use crate::saved::{number, numbers, save_as, text};
use crate::{Contents, Of, Values, contents};

/// An archive of one tensor `a.weight` of this shape and these strides, all of whose values are the one that is stored.
fn view(path: &Path, function: &str, shape: &[usize]) {
    let mut pickle = b"\x80\x02}".to_vec();
    text(&mut pickle, "a.weight");
    pickle.extend_from_slice(format!("ctorch._utils\n{function}\n((").as_bytes());
    text(&mut pickle, "storage");
    pickle.extend_from_slice(b"ctorch\nFloatStorage\n");
    text(&mut pickle, "0");
    text(&mut pickle, "cpu");
    number(&mut pickle, 1);
    pickle.extend_from_slice(b"tQ");
    number(&mut pickle, 0);
    numbers(&mut pickle, shape);
    numbers(&mut pickle, &vec![0; shape.len()]);
    pickle.extend_from_slice(b"\x89ccollections\nOrderedDict\n)RtRs.");
    let stored = [("a.weight".to_owned(), vec![1], Values::Floats(vec![1.5]))];
    save_as("weights", path, &pickle, &stored).unwrap();
}

fn refused(path: &Path) -> String {
    contents(path, Of::Values).unwrap_err().to_string()
}

#[test]
fn views_of_terabytes_are_refused_by_name_and_small_ones_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("expanded.pt");
    for (shape, size) in [
        (&[1 << 40][..], "4 TiB"),
        (&[1 << 20, 1 << 10], "4 GiB"),
        // More than 64 bits count.
        (&[1 << 40, 1 << 40], "16 EiB"),
    ] {
        view(&path, "_rebuild_tensor_v2", shape);
        let message = refused(&path);
        assert!(
            message.contains(&format!("`a.weight` is a view of {size} over 4 bytes; store")),
            "{message}"
        );
        assert!(!message.contains("neither safetensors"), "{message}");
    }
    view(&path, "_rebuild_tensor_v2", &[2, 3]);
    let found = contents(&path, Of::Values).unwrap().tensors;
    assert_eq!((&found["a.weight"].shape[..], &found["a.weight"].values[..]), (&[2, 3][..], &[1.5; 6][..]));
}

/// Files of the container before zip archives, which PyTorch wrote.
fn legacy(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/checkpoints/legacy").join(name)
}

/// What is in the pickles of a file.
fn found_in(path: &Path) -> Found {
    let mut file = std::fs::File::open(path).unwrap();
    let container = Container::of(&mut file).unwrap();
    Pickles::find(&mut file, container).unwrap().unwrap().found
}

#[test]
fn functions_that_python_would_call_are_named_in_every_container() {
    let Contents { calls, tensors, format, .. } = contents(&legacy("calls.pt"), Of::Values).unwrap();
    // `print` as Python 2 calls its module.
    assert_eq!((&calls[..], format), (&["__builtin__.print".to_owned()][..], "legacy"));
    assert_eq!(tensors["a.weight"].values, [0.0, 1.0, 2.0, 3.0]);

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("more.pt");
    let whole = std::fs::read(legacy("calls.pt")).unwrap();
    // In each of the pickles before the object, too: the magic number, its value lost by a call.
    let mut early = b"\x80\x02cbuiltins\nlen\nX\x01\x00\x00\x00a\x85R0".to_vec();
    early.extend_from_slice(&whole[2..]);
    std::fs::write(&path, early).unwrap();
    assert_eq!(contents(&path, Of::Shapes).unwrap().calls, ["builtins.len", "__builtin__.print"]);
    // A pickle alone, and one in a tar archive.
    let pickle = b"\x80\x02cbuiltins\nlen\nX\x01\x00\x00\x00a\x85R.";
    std::fs::write(&path, pickle).unwrap();
    assert_eq!(found_in(&path).calls, ["builtins.len"]);
    let mut entry = vec![0; 512];
    entry[..6].copy_from_slice(b"pickle");
    entry[124..135].copy_from_slice(format!("{:011o}", pickle.len()).as_bytes());
    entry[257..262].copy_from_slice(b"ustar");
    entry.extend_from_slice(pickle);
    entry.resize(1024, 0);
    std::fs::write(&path, [entry.clone(), entry].concat()).unwrap();
    assert_eq!(found_in(&path).calls[0], "builtins.len");
}

#[test]
fn sparse_tensors_of_old_files_are_refused_by_name() {
    let message = refused(&legacy("sparse.pt"));
    assert!(message.contains("`a.weight` is sparse; store it as a dense tensor"), "{message}");
}

#[test]
fn pickles_longer_than_what_is_looked_through_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.pt");
    // A text of 101 MiB, which takes no place on the disk.
    let len = 101_u32 << 20;
    let file = std::fs::File::create(&path).unwrap();
    std::io::Write::write_all(&mut &file, &[&b"\x80\x02X"[..], &len.to_le_bytes()].concat()).unwrap();
    file.set_len(u64::from(len) + 32).unwrap();
    let message = refused(&path);
    assert!(message.contains("more than 100 MiB"), "{message}");
}

/// What `module.pt` holds, by the names of its `state_dict()`.
fn check_module(found: &Contents, prefix: &str) {
    let names: Vec<&str> = found.tensors.keys().map(|name| name.strip_prefix(prefix).unwrap()).collect();
    assert_eq!(names.len(), 14, "{names:?}");
    let of = |name: &str| &found.tensors[&format!("{prefix}{name}")];
    // Values count up, from 10 times the place of a parameter among all.
    let weight = of("second.linear.weight");
    assert_eq!(
        (&weight.shape[..], &weight.values[..]),
        (&[2, 3][..], &[40.0, 41.0, 42.0, 43.0, 44.0, 45.0][..])
    );
    assert_eq!(of("first.norm.bias").values, [30.0, 31.0]);
    assert_eq!(of("second.norm.running_var").values, [1.0, 1.0]);
}

#[test]
fn whole_modules_of_old_files_are_read_as_their_state_dict() {
    let found = contents(&legacy("module.pt"), Of::Values).unwrap();
    assert_eq!((found.format, &found.calls[..], &found.passed_over[..]), ("legacy", &[][..], &[][..]));
    check_module(&found, "");
    // Beside an optimizer, and with keys that are counted.
    let found = contents(&legacy("trainer.pt"), Of::Values).unwrap();
    assert_eq!(found.passed_over, ["torch.optim.adamw.AdamW"]);
    check_module(&found, "");
}

#[test]
fn modules_of_old_files_in_another_form_are_refused_with_what_reads_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("module.pt");
    let mut bytes = std::fs::read(legacy("module.pt")).unwrap();
    // A tuple that is kept twice.
    let at = bytes.windows(4).position(|code| code == b"tq\x04Q").unwrap();
    bytes.splice(at + 3..at + 3, *b"q\xf0");
    std::fs::write(&path, bytes).unwrap();
    let message = refused(&path);
    assert!(
        message.contains("a whole module in PyTorch's older format") && message.contains(".state_dict()"),
        "{message}"
    );
}

#[test]
fn whole_files_with_something_wrong_are_told_from_files_of_something_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.pt");
    let changed = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let message = refused(&path);
        assert!(message.contains("weights.pt`: ") && !message.contains("`: is "), "{message}");
        message
    };
    let tensors = [("a.weight".to_owned(), vec![4], Values::Floats(vec![1.25; 4]))];
    crate::save(&path, &tensors).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let replaced = |from: &[u8], to: &[u8]| {
        let mut bytes = whole.clone();
        while let Some(at) = bytes.windows(from.len()).position(|window| window == from) {
            bytes[at..at + to.len()].copy_from_slice(to);
        }
        bytes
    };
    let zeroed = changed(&replaced(&1.25_f32.to_le_bytes(), &[0; 4]));
    assert!(
        zeroed.contains("`a.weight` cannot be read (") && zeroed.contains("is damaged: fetch it"),
        "{zeroed}"
    );
    let other = changed(&replaced(b"data.pkl", b"data.txt"));
    assert!(other.contains("a zip archive without `data.pkl`, and none of torch.save; save the"), "{other}");
    let old = std::fs::read(legacy("calls.pt")).unwrap();
    for bytes in [&whole[..whole.len() / 2], &old[..old.len() / 2], &old[..old.len() - 8]] {
        let cut = changed(bytes);
        assert!(
            (cut.contains("damaged") || cut.contains("is cut off")) && cut.contains("fetch it again"),
            "{cut}"
        );
        assert!(!cut.contains("neither safetensors"), "{cut}");
    }
    crate::save(&path, &[]).unwrap();
    let empty = refused(&path);
    assert!(empty.contains("the file holds no tensors; save the model's `state_dict()`"), "{empty}");
    // A text that begins as a pickle could.
    let text = changed(b"config of something");
    assert!(text.contains("the file is neither safetensors nor one of torch.save ("), "{text}");
    let header = changed(b"\x04\0\0\0\0\0\0\0{oh}");
    assert!(header.contains("is damaged") && header.contains("fetch it again"), "{header}");
}
