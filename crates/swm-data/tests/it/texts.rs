//! Long texts: kept, or refused with the column, the episode and what to do.

use swm_core::{Batch, Dtype, Field, Schema, SliceMut};
use swm_data::testing::metadata;
use swm_data::{WriteMode, create_in};

use crate::support::contents;
use crate::{FORMATS, registry};

/// Writes two episodes, of which the second has a text of so many characters in its last row.
fn write(path: &std::path::Path, text: &str) -> Result<(), String> {
    let schema =
        Schema::new(vec![Field::step("action", Dtype::F32, &[1]), Field::step("task", Dtype::Str, &[])]);
    let schema = schema.unwrap();
    let mut writer = create_in(registry(), path, &WriteMode::Error.into(), None).unwrap();
    writer.begin(&schema, &metadata()).unwrap();
    for last in ["push", text] {
        let mut rows = Batch::new(schema.clone(), 3);
        let SliceMut::Str(out) = rows.column_mut(1) else { panic!() };
        out[2] = last.to_owned();
        writer.write_episode(&rows).map_err(|error| error.to_string())?;
    }
    writer.finish().map_err(|error| error.to_string())
}

#[test]
fn texts_of_any_length_are_kept_or_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    // Of two bytes each.
    let text = |characters: usize| "é".repeat(characters);
    for format in FORMATS.iter().filter(|format| format.name != "video") {
        let extension = format.extensions[0];
        let limit = match format.name {
            "hdf5" => Some((128, "bytes")),
            "folder" => Some((256, "characters")),
            _ => None,
        };
        let path = |name: &str| folder.path().join(name).with_extension(extension);
        let fits = text(limit.map_or(5000, |(most, _)| most));
        write(&path("fits"), &fits).unwrap();
        assert_eq!(contents(&path("fits"))[1].get::<String>("task").unwrap()[2], fits, "{extension}");
        let Some((most, unit)) = limit else { continue };
        let message = write(&path("long"), &text(most + 1)).unwrap_err();
        let length = if unit == "bytes" { 2 * (most + 1) } else { most + 1 };
        for part in [
            "episode 1",
            "`task`",
            &format!("a text of {length} {unit}"),
            "at most 256",
            "shorten it",
            "`mcap`",
            "`lerobot`",
        ] {
            assert!(message.contains(part), "{extension}: {part}: {message}");
        }
    }
}
