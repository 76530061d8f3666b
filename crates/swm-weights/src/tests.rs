//! Files that PyTorch wrote, and such files with one thing wrong: what is read, and what is refused with which words.

use std::path::Path;

use crate::saved::{number, numbers, save_as, text};
use crate::{Of, Values, contents};

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
