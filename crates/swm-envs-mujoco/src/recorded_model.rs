//! For tests: whether a compiled model is the reference's, array by array. `tests/golden/models/` has their checksums.

use swm_mujoco::Model;

/// The name of each array of a model, how many bytes it takes in a file, and a checksum of them.
#[derive(serde::Deserialize)]
struct Recorded {
    sections: Vec<(String, usize, u64)>,
}

/// Unnamed objects have made-up names in the reference, and paths of files are others; sizes count their bytes. The
/// reference's size of a window is among the visual settings.
const OF_NAMES: &[&str] = &["sizes", "visual", "names", "names_map", "paths"];

/// Panics where an array differs from that of the recorded model `file`.
pub(crate) fn assert_is_recorded(model: &Model, file: &str) {
    let path = format!("{}/../../tests/golden/models/{file}.json", env!("CARGO_MANIFEST_DIR"));
    let recorded: Recorded = serde_json::from_str(&std::fs::read_to_string(path).expect("it is committed"))
        .expect("a recorded model");
    let bytes = model.to_bytes().expect("memory");
    let of_names =
        |name: &str| OF_NAMES.contains(&name) || name.starts_with("name_") || name.ends_with("pathadr");
    let [names, paths] = model.text_bytes();
    let (mut rest, mut compared) = (bytes.as_slice(), 0);
    for (name, length, checksum) in &recorded.sections {
        let length = match name.as_str() {
            "names" => names,
            "paths" => paths,
            _ => *length,
        };
        let (section, tail) = rest.split_at(length);
        rest = tail;
        if !of_names(name) {
            assert_eq!(fnv1a(section), *checksum, "{file}: {name} ({length} bytes)");
            compared += 1;
        }
    }
    assert!(rest.is_empty(), "{file}: {} bytes too many", rest.len());
    assert!(compared > 250, "{file}: {compared} arrays");
}

fn fnv1a(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}
