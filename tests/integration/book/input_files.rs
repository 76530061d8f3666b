//! Input files of pages that no block of the page makes: made once per run of the test, and copied to the pages' folders.

use std::path::Path;
use std::sync::Mutex;

use super::shell::Machine;

/// Puts a copy of the file `name` into `folder`.
pub(super) fn put(machine: &Machine, name: &str, folder: &Path) -> Result<(), String> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let command = swm_tests::book::command(name).ok_or_else(|| format!("no file {name} is ever given"))?;
    let made = machine.shared().join(name);
    {
        let _guard = ONE_AT_A_TIME.lock().map_err(|_| "another page failed")?;
        if !made.is_file() {
            machine.run(&format!("swm {command}"), machine.shared())?;
        }
    }
    std::fs::copy(&made, folder.join(name)).map(|_| ()).map_err(|error| error.to_string())
}
