//! Formats: which are read by position, and which are fetched as a whole.

use crate::testing::mutations::seed;

use super::*;

#[test]
fn our_formats_are_read_from_a_store() {
    let test = Test::new(&[], |settings, url| settings.s3.endpoint = Some(url.to_owned()));
    let folder = tempfile::tempdir().unwrap();
    for format in crate::FORMATS {
        let name = format!("mine.{}", format.extensions[0]);
        let here = folder.path().join(&name);
        seed(&here);
        match here.is_dir() {
            true => {
                for (path, content) in files_of(&here, &format!("/bucket/{name}")) {
                    test.server.put(&path, content);
                }
            }
            false => test.server.put(&format!("/bucket/{name}"), std::fs::read(&here).unwrap()),
        }
        let path = PathBuf::from(format!("s3://bucket/{name}"));
        let mut dataset = test.open(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
        let expected = rows(crate::open(&here).unwrap().as_mut()).unwrap();
        assert!(same(&rows(dataset.as_mut()).unwrap(), &expected), "{name}");
        assert_eq!((dataset.path(), dataset.info().format), (path.as_path(), format.name));
        let is_by_position = dataset.info().notes.iter().any(|note| note.contains("by position"));
        assert_eq!(is_by_position, format.name == "mcap", "{name}");
        // Threads of a loader share what is open.
        assert!(same(&rows(dataset.share().as_mut()).unwrap(), &expected), "{name}");
    }
}
