//! Clips in memory, and that equal clips make equal files.

use swm_media::{Clip, Format};

use crate::scene;

#[test]
fn frames_come_back_in_order() {
    let mut clip = Clip::new(1, 2, 10.0);
    assert!(clip.is_empty());
    clip.push(&[1, 2, 3, 4, 5, 6]).unwrap();
    clip.push(&[7; 6]).unwrap();
    assert_eq!(clip.frames().collect::<Vec<_>>(), [&[1, 2, 3, 4, 5, 6], &[7; 6]]);
    assert_eq!((clip.len(), clip.height(), clip.width(), clip.frames_per_second()), (2, 1, 2, 10.0));
}

#[test]
fn upscaling_repeats_pixels() {
    let mut clip = Clip::new(2, 3, 10.0);
    let [a, b, c, d, e, f] = [1, 2, 3, 4, 5, 6].map(|level| [level; 3]);
    clip.push(&[a, b, c, d, e, f].concat()).unwrap();
    clip.push(&[f, e, d, c, b, a].concat()).unwrap();
    let large = clip.upscaled(3);
    assert_eq!((large.height(), large.width(), large.len()), (4, 6, 2));
    let [above, below] = [[a, a, b, b, c, c].concat(), [d, d, e, e, f, f].concat()];
    assert_eq!(large.frames().next().unwrap(), [&above[..], &above, &below, &below].concat());

    assert_eq!(clip.upscaled(2), clip);
    assert_eq!(clip.upscaled(0), clip);
    assert_eq!(Clip::new(0, 0, 1.0).upscaled(224), Clip::new(0, 0, 1.0));
}

#[test]
fn equal_clips_make_equal_files() {
    for clip in [scene::drawn(64, 80, 5), scene::gradient(64, 80, 5)] {
        for format in Format::ALL.into_iter().filter(|format| format.is_built()) {
            let files = [(); 3].map(|()| clip.clone().encode(format).unwrap());
            assert!(files[0] == files[1] && files[1] == files[2], "{format}");
        }
    }
}

#[test]
fn save_picks_the_format_by_extension() {
    let folder = tempfile::tempdir().unwrap();
    let clip = scene::drawn(32, 32, 2);
    let starts: [(&str, usize, &[u8]); 3] =
        [("a.png", 0, b"\x89PNG"), ("b.GIF", 0, b"GIF89a"), ("c.mp4", 4, b"ftyp")];
    for (name, at, magic) in starts {
        let path = folder.path().join(name);
        if !Format::from_path(&path).unwrap().is_built() {
            continue;
        }
        for _ in 0..2 {
            clip.save(&path).unwrap(); // The second time over the first file.
        }
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(&bytes[at..at + magic.len()], magic, "{name}");
        std::fs::remove_file(&path).unwrap();
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "temporary files stay behind");
}
