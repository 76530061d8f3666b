//! What is refused, and in which words.

use std::error::Error as _;
use std::path::Path;

use swm_media::{Clip, Format, MediaError, contact_sheet, png};

use crate::scene;

/// The error's whole message.
fn refusal<T: std::fmt::Debug>(result: Result<T, MediaError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn frames_of_another_size() {
    let mut clip = Clip::new(4, 5, 10.0);
    let message = refusal(clip.push(&[0; 59]));
    assert!(
        message.contains("4 x 5") && message.contains("60 bytes") && message.contains("got 59"),
        "{message}"
    );
    assert!(clip.is_empty(), "a refused frame leaves no trace");
    assert!(refusal(Clip::new(0, 5, 10.0).push(&[])).contains("0 x 5"));
    assert!(refusal(Clip::new(usize::MAX, 2, 10.0).push(&[0; 3])).contains("got 3"));
    assert!(refusal(png::encode(2, 2, &[0; 11])).contains("got 11"));
    assert!(refusal(contact_sheet(&[vec![&[0; 11]]], 2, 2, 0)).contains("got 11"));
}

#[test]
fn nothing_to_write() {
    for format in Format::ALL.into_iter().filter(|format| format.is_built()) {
        assert!(matches!(Clip::new(32, 32, 10.0).encode(format), Err(MediaError::EmptyClip)), "{format}");
    }
    assert!(matches!(contact_sheet(&[], 2, 2, 1), Err(MediaError::EmptySheet)));
    assert!(matches!(contact_sheet(&[vec![], vec![]], 2, 2, 1), Err(MediaError::EmptySheet)));
}

#[test]
fn rates_that_are_none() {
    for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let mut clip = Clip::new(32, 32, rate);
        clip.push(&[0; 32 * 32 * 3]).unwrap();
        for format in [Format::Gif, Format::Mp4].into_iter().filter(|format| format.is_built()) {
            assert!(refusal(clip.encode(format)).contains(&rate.to_string()), "{format} at {rate}");
        }
        assert!(clip.encode(Format::Png).is_ok(), "an image has no rate");
    }
}

#[test]
fn unknown_extensions_list_the_known() {
    for name in ["video.avi", "video", ".gif", "videos/"] {
        let message = refusal(scene::drawn(16, 16, 1).save(name));
        assert!(message.contains(name.trim_end_matches('/')), "{message}");
        for format in Format::ALL {
            assert!(message.contains(&format!("*.{}", format.extension())), "{message}");
        }
    }
}

#[test]
fn frames_too_large_for_a_gif() {
    let mut clip = Clip::new(1, 65_536, 10.0);
    clip.push(&vec![0; 65_536 * 3]).unwrap();
    assert!(refusal(clip.encode(Format::Gif)).contains("65535"));
}

#[cfg(feature = "mp4")]
#[test]
fn frames_too_small_for_an_mp4() {
    let message = refusal(scene::drawn(8, 32, 2).encode(Format::Mp4));
    assert!(message.contains("8 x 32") && message.contains("upscaled"), "{message}");
    assert!(scene::drawn(8, 32, 2).upscaled(224).encode(Format::Mp4).is_ok());
}

#[cfg(not(feature = "mp4"))]
#[test]
fn a_build_without_mp4_says_how_to_get_it() {
    let message = refusal(scene::drawn(32, 32, 2).save("video.mp4"));
    assert!(message.contains("feature `mp4`") && message.contains(".gif"), "{message}");
}

#[test]
fn unwritable_files_are_named_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let clip = scene::drawn(16, 16, 1);
    let missing = folder.path().join("missing").join("a.png");
    let error = clip.save(&missing).unwrap_err();
    assert!(error.to_string().contains(missing.to_str().unwrap()), "{error}");
    assert!(error.source().is_some());

    // A folder in the file's place: the rename fails after the bytes are written.
    let taken = folder.path().join("taken.png");
    std::fs::create_dir(&taken).unwrap();
    std::fs::write(taken.join("note"), "mine").unwrap();
    assert!(matches!(clip.save(&taken), Err(MediaError::Write { path, .. }) if path == taken));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "temporary files stay behind");
    assert!(Path::new(&taken).join("note").exists());
}
