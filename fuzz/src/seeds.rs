//! `seeds`: writes the inputs that change nothing to `corpus/<target>/`, so that the fuzzer begins with whole files.

use std::fs;
use std::path::Path;

fn main() -> std::io::Result<()> {
    for format in swm_fuzz::FORMATS {
        write(format, swm_fuzz::Seed::new(format).inputs())?;
    }
    write("foreign", swm_fuzz::foreign::samples().inputs())?;
    write("tables", swm_fuzz::tables::samples().inputs())?;
    write("results", swm_fuzz::results::samples().inputs())?;
    #[cfg(feature = "cli")]
    write("jobs", swm_fuzz::jobs::samples().inputs())?;
    #[cfg(feature = "baselines")]
    write("runs", swm_fuzz::runs::samples().inputs())?;
    #[cfg(feature = "baselines")]
    write("weights", swm_fuzz::weights::Seeds::new().inputs())?;
    Ok(())
}

fn write(target: &str, inputs: impl Iterator<Item = Vec<u8>>) -> std::io::Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
    fs::create_dir_all(&folder)?;
    for (number, input) in inputs.enumerate() {
        fs::write(folder.join(format!("seed-{number:03}")), input)?;
    }
    Ok(())
}
