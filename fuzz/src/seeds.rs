//! `seeds`: writes the inputs that change nothing to `corpus/<target>/`, so that the fuzzer begins with whole files.

use std::fs;
use std::path::Path;

fn main() -> std::io::Result<()> {
    for format in swm_fuzz::FORMATS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(format);
        fs::create_dir_all(&folder)?;
        for (number, input) in swm_fuzz::Seed::new(format).inputs().enumerate() {
            fs::write(folder.join(format!("seed-{number:03}")), input)?;
        }
    }
    Ok(())
}
