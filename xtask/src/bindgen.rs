//! `cargo xtask bindgen`: makes the checked-in declarations of MuJoCo's C interface from the headers of the pinned wheel.
//!
//! For whoever moves to another version of MuJoCo or calls a new function of it; no build runs this. The generator and
//! its libclang are pinned too, so that equal headers give equal bytes; on Windows C's enums are signed, so generate on
//! another system. Building the generator takes minutes, so the file carries a seal: what it was made of, and the hash of
//! the rest. `--check` reads that alone.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};
use sha2::{Digest as _, Sha256};

use crate::process;
use crate::setup::wheel::{Keep, Package, Wheel};
use crate::setup::{self, data::MUJOCO};

/// Options of `cargo xtask bindgen`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Write nothing; exit status 1 if the checked-in file was made of other headers or options, or edited
    #[arg(long)]
    check: bool,
    /// With --check: run the generator, which is built for it, and compare every line
    #[arg(long, requires = "check")]
    anew: bool,
}

/// What is made.
const BINDINGS: &str = "crates/swm-mujoco/src/bindings.rs";

/// Headers below the wheel's include folder.
const HEADERS: &[&str] = &["mujoco/mujoco.h", "mujoco/mjbatch.h"];

/// Functions to declare, as alternatives of a regular expression. Loading fails if the library lacks one of them.
const FUNCTIONS: &[&str] = &[
    "mj_(version|versionString)",
    "mj_(parseXML|compile|deleteSpec|copyModel|saveModel|deleteModel|sizeModel|name2id|id2name|setConst)",
    "mj_(makeData|deleteData|resetData|stateSize|getState|setState)",
    "mj_(forward|step|step1|step2|rnePostConstraint|kinematics|jacSite)",
    "mju_error",
    "mjs_(add(Body|Camera|Frame|FreeJoint|Geom|Light|Site)|as(Body|Geom|Joint|Light|Material|Mesh|Sensor|Site|Texture))",
    "mjs_(attach|delete|findElement|firstElement|nextElement|getError|getName|getParent|getSpecDefault|getString)",
    "mjs_set(Float|Int|Name|String)",
    "mjv_(default(Camera|Option|Perturb|Scene)|makeScene|freeScene|updateScene)",
    "mjr_(defaultContext|makeContext|freeContext|uploadTexture|setBuffer|readPixels|render)",
];

/// Enums that no declared function names.
const TYPES: &str =
    "mjt(State|DisableBit|Integrator|Cone|CatBit|Warning|Sensor|Camera|Framebuffer|FontScale)";

/// Constants of enums that are kept, by their prefix. The generator makes all of them.
const CONSTANTS: &[(&str, &str)] = &[
    ("mjDSBL", "ACTUATION"),
    ("mjJNT", "FREE BALL SLIDE"),
    ("mjGEOM", "PLANE HFIELD SPHERE CAPSULE ELLIPSOID CYLINDER BOX MESH"),
    ("mjCAMLIGHT", "TRACKCOM"),
    ("mjLIGHT", "SPOT DIRECTIONAL"),
    ("mjTEXTURE", "2D SKYBOX"),
    ("mjINT", "RK4 IMPLICITFAST"),
    ("mjCONE", "ELLIPTIC"),
    ("mjOBJ", "BODY JOINT GEOM SITE CAMERA LIGHT MESH TEXTURE MATERIAL TENDON ACTUATOR SENSOR KEY"),
    ("mjSENS", "RANGEFINDER"),
    ("mjSTATE", "INTEGRATION"),
    ("mjWARN", "INERTIA CONTACTFULL CNSTRFULL BADQPOS BADQVEL BADQACC BADCTRL"),
    ("mjBUILTIN", "NONE FLAT"),
    ("mjORIENTATION", "XYAXES ZAXIS"),
    ("mjCAT", "DECOR ALL"),
    ("mjCAMERA", "FIXED"),
    ("mjFB", "OFFSCREEN"),
    ("mjFONTSCALE", "100"),
];

const VARIABLES: &str = "mjVERSION_HEADER|mju_user_(error|warning)";

/// Options of the generator. Functions come as fields of a struct `Api` that opens the library at run time, and may
/// unwind: our handler of MuJoCo's fatal errors does.
const OPTIONS: &str = "--dynamic-loading Api --dynamic-link-require-all --override-abi .*=C-unwind \
    --default-enum-style consts --no-prepend-enum-name --no-layout-tests --no-doc-comments --merge-extern-blocks \
    --rust-edition 2024 --rust-target 1.89 --use-core --formatter prettyplease --disable-header-comment";

const GENERATOR: &str = "0.72.1";

/// The compiler library that the generator loads.
const LIBCLANG: Package = Package {
    name: "libclang",
    version: "18.1.1",
    wheels: &[
        Wheel {
            platforms: &["linux-x86_64"],
            tag: "manylinux2010_x86_64",
            sha256: "c533091d8a3bbf7460a00cb6c1a71da93bffe148f172c7d03b1c31fbf8aa2a0b",
        },
        Wheel {
            platforms: &["linux-aarch64"],
            tag: "manylinux2014_aarch64",
            sha256: "54dda940a4a0491a9d1532bf071ea3ef26e6dbaf03b5000ed94dd7174e8f9592",
        },
        Wheel {
            platforms: &["macos-x86_64"],
            tag: "macosx_10_9_x86_64",
            sha256: "6f14c3f194704e5d09769108f03185fce7acaf1d1ae4bbb2f30a72c2400cb7c5",
        },
        Wheel {
            platforms: &["macos-aarch64"],
            tag: "macosx_11_0_arm64",
            sha256: "0b2e143f0fac830156feb56f9231ff8338c20aecfe72b4ffe96f19e5a1dbb69a",
        },
    ],
    keep: &[
        Keep { from: &["libclang-18.1.1.data/platlib/clang/native/*"], to: "" },
        Keep { from: &["libclang-18.1.1.dist-info/LICENSE.TXT"], to: "" },
    ],
};

/// The headers of the library that `setup` installs: the same wheel.
const MUJOCO_HEADERS: Package = Package {
    name: MUJOCO.name,
    version: MUJOCO.version,
    wheels: MUJOCO.wheels,
    keep: &[Keep { from: &["mujoco/include/mujoco/*.h"], to: "include/mujoco" }],
};

/// Generates the declarations, and writes them or compares.
pub(crate) fn run(args: &Args) -> Result<()> {
    let place = process::root().join(BINDINGS);
    let present = || fs::read_to_string(&place).with_context(|| format!("failed to read {BINDINGS}"));
    if args.check && !args.anew {
        return check_seal(&present()?);
    }
    let tools = process::root().join(".tools/bindgen");
    let headers = setup::ensure_in(&MUJOCO_HEADERS, &tools)?.join("include");
    let libclang = setup::ensure_in(&LIBCLANG, &tools)?;
    let generator = generator(&tools)?;
    let generated = sealed(&generate(&generator, &libclang, &headers, &tools.join("all.h"))?);
    if args.check {
        return compare(&present()?, &generated);
    }
    fs::write(&place, &generated).with_context(|| format!("failed to write {BINDINGS}"))?;
    println!("bindgen: wrote {} lines to {BINDINGS}", generated.lines().count());
    Ok(())
}

/// Builds the pinned generator, unless it is there.
fn generator(tools: &Path) -> Result<PathBuf> {
    let binary = tools.join("bin/bindgen");
    let version = |binary: &Path| process::output(Command::new(binary).arg("--version")).ok();
    if version(&binary).is_some_and(|said| said.trim_ascii() == format!("bindgen {GENERATOR}").as_bytes()) {
        return Ok(binary);
    }
    let mut install =
        process::cargo(["install", "bindgen-cli", "--version", GENERATOR, "--locked", "--root"]);
    process::run(install.arg(tools))
        .context("the generator could not be built; it comes from the registry of crates")?;
    Ok(binary)
}

/// Runs the generator on all headers, which `input` is written to include.
fn generate(generator: &Path, libclang: &Path, headers: &Path, input: &Path) -> Result<String> {
    let mut all = String::new();
    for header in HEADERS {
        all += &format!("#include <{header}>\n");
    }
    fs::write(input, all).with_context(|| format!("failed to write {}", input.display()))?;
    let first = format!(
        "//! Generated by `cargo xtask bindgen` from the headers of MuJoCo {}; not edited by hand.",
        MUJOCO.version
    );
    let mut command = Command::new(generator);
    command.env("LIBCLANG_PATH", libclang).args(OPTIONS.split_whitespace()).args(["--raw-line", &first]);
    command.args(["--allowlist-function", &FUNCTIONS.join("|")]);
    command.args(["--allowlist-type", TYPES, "--allowlist-var", VARIABLES]);
    command.arg(input).arg("--").arg("-I").arg(headers);
    // The wheel of libclang lacks the headers that belong to a compiler, like stddef.h.
    command.arg("-I").arg(compiler_headers()?);
    let generated = process::output(&mut command).context("the generator failed")?;
    let generated = String::from_utf8(generated).context("the generator wrote no text")?;
    Ok(generated.split_inclusive('\n').filter(|line| is_kept(line)).collect())
}

/// Whether a generated line is anything but a constant of an enum that nobody names.
fn is_kept(line: &str) -> bool {
    let name = line.strip_prefix("pub const mj").and_then(|rest| rest.split_once(": mjt"));
    let Some((name, _)) = name else { return true };
    CONSTANTS.iter().any(|(prefix, names)| {
        let name = name.strip_prefix(&prefix[2..]).and_then(|rest| rest.strip_prefix('_'));
        name.is_some_and(|name| names.split(' ').any(|kept| kept == name))
    })
}

fn compiler_headers() -> Result<PathBuf> {
    let compiler = std::env::var_os("CC").filter(|name| !name.is_empty()).unwrap_or_else(|| "cc".into());
    let said = process::output(Command::new(&compiler).arg("-print-file-name=include"))
        .context("a C compiler is needed for its headers (tried $CC, else cc)")?;
    let folder = PathBuf::from(String::from_utf8_lossy(&said).trim());
    if !folder.join("stddef.h").is_file() {
        bail!(
            "`{} -print-file-name=include` names no folder with stddef.h: {}",
            compiler.display(),
            folder.display()
        );
    }
    Ok(folder)
}

/// The declarations with their seal as second line.
fn sealed(generated: &str) -> String {
    let (first, rest) = generated.split_once('\n').unwrap_or((generated, ""));
    format!("{first}\n{}\n{rest}", seal(generated))
}

/// What declarations are made of, and their hash.
fn seal(generated: &str) -> String {
    let hash = |text: &str| -> String {
        Sha256::digest(text).iter().take(16).map(|byte| format!("{byte:02x}")).collect()
    };
    let versions = [LIBCLANG.version, GENERATOR, MUJOCO.version];
    let constants: Vec<String> =
        CONSTANTS.iter().map(|(prefix, names)| format!("{prefix} {names}")).collect();
    let constants = constants.join("\n");
    let others = [TYPES, constants.as_str(), VARIABLES, OPTIONS];
    let parts = [&versions[..], HEADERS, FUNCTIONS, &others[..]].map(|part| part.join("\n"));
    format!("//! Made of {}, is {}.", hash(&parts.join("\n")), hash(generated))
}

/// Whether the declarations are what was generated, with the present options.
fn check_seal(present: &str) -> Result<()> {
    let mut lines: Vec<&str> = present.split('\n').collect();
    let found = if lines.len() > 1 { lines.remove(1) } else { "" };
    let expected = seal(&lines.join("\n"));
    if found == expected {
        println!("bindgen: {BINDINGS} is as it was generated from the headers of MuJoCo {}", MUJOCO.version);
        return Ok(());
    }
    let made_of = |seal: &str| seal.split(',').next().map(str::to_owned);
    let what = if made_of(found) == made_of(&expected) {
        "was edited by hand"
    } else {
        "was made of other headers, by other options or by another generator"
    };
    bail!("{BINDINGS} {what}\nfix: cargo xtask bindgen")
}

/// Names the first line that differs.
fn compare(present: &str, generated: &str) -> Result<()> {
    if present == generated {
        println!("bindgen: {BINDINGS} is what the headers of MuJoCo {} give", MUJOCO.version);
        return Ok(());
    }
    let lines = present.lines().count().max(generated.lines().count());
    let (mut ours, mut theirs) = (present.lines(), generated.lines());
    for number in 1..=lines {
        let (ours, theirs) = (ours.next(), theirs.next());
        if ours != theirs {
            let text =
                |line: Option<&str>| line.map_or("nothing".to_owned(), |line| format!("`{}`", line.trim()));
            bail!(
                "{BINDINGS}:{number} has {}, the headers of MuJoCo {} give {}\nfix: cargo xtask bindgen",
                text(ours),
                MUJOCO.version,
                text(theirs)
            );
        }
    }
    bail!("{BINDINGS} differs in its line ends from what the generator gives\nfix: cargo xtask bindgen")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_difference_is_named() {
        let message = |present, generated| compare(present, generated).unwrap_err().to_string();
        assert!(compare("a\nb\n", "a\nb\n").is_ok());
        assert!(
            message("a\nb\n", "a\nc\n")
                .contains("bindings.rs:2 has `b`, the headers of MuJoCo 3.17.0 give `c`")
        );
        assert!(message("a\n", "a\nc\n").contains("bindings.rs:2 has nothing"));
        assert!(message("a\nb\n", "a\n").contains("give nothing"));
        assert!(message("a\r\n", "a\n").contains("line ends"));
    }

    #[test]
    fn constants_that_nobody_names_are_left_out() {
        assert!(
            is_kept("pub const mjVERSION_HEADER: u32 = 3017000;\n") && is_kept("pub type mjtNum = f64;\n")
        );
        assert!(is_kept("pub const mjGEOM_PLANE: mjtGeom = 0;\n"));
        assert!(
            !is_kept("pub const mjGEOM_SDF: mjtGeom = 8;\n")
                && !is_kept("pub const mjNGEOMTYPES: mjtGeom = 9;\n")
        );
    }

    #[test]
    fn a_seal_tells_edits_and_other_origins() {
        let whole = sealed("//! first\npub const A: u32 = 1;\n");
        assert_eq!(whole.lines().count(), 3);
        assert!(check_seal(&whole).is_ok());
        let message = |text: &str| check_seal(text).unwrap_err().to_string();
        assert!(message(&whole.replace("= 1", "= 2")).contains("edited by hand"));
        assert!(message(&whole.replace("Made of ", "Made of 0")).contains("other headers"));
        assert!(message("//! first\n").contains("other headers"));
    }

    #[test]
    fn the_checked_in_declarations_carry_their_seal() {
        let present = fs::read_to_string(process::root().join(BINDINGS)).unwrap();
        check_seal(&present).unwrap();
    }

    #[test]
    fn the_functions_of_one_kind_are_listed_once() {
        let mut sorted = FUNCTIONS.to_vec();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), FUNCTIONS.len());
        assert_eq!(LIBCLANG.keep[1].from, [format!("libclang-{}.dist-info/LICENSE.TXT", LIBCLANG.version)]);
    }
}
