//! Messages of the core name commands and their options; a Python user is told the functions and arguments that do the same.

/// What the core says, and what it is here.
const WORDS: &[(&str, &str)] = &[
    ("`swm envs` lists", "`swm.envs.WORLDS` lists"),
    ("`swm fovs` lists", "`variation_space` of the environment lists"),
    ("`swm solvers` lists", "`swm.planning` holds"),
    ("`swm convert --help` lists", "`swm.data.list_formats()` lists"),
    ("`swm manifest make`", "`swm.make_manifest`"),
    ("`swm merge`", "`swm.data.merge`"),
    ("`swm eval --manifest TASK --out DIR`", "`swm.evaluate(manifest, policy, out=DIR)`"),
    ("`swm eval --manifest … --out DIR`", "`swm.evaluate(manifest, policy, out=DIR)`"),
    ("evaluate again with --again", "remove it and evaluate again"),
    ("(`--image-size none`)", "(`add_pixels=False`)"),
    // The package brings what it is built with; the rest is the command's.
    ("this program was built without the feature", "this package is built without the feature"),
    (": in a checkout, cargo install", "; the command can have it: in a checkout, cargo install"),
];

/// A message of the core in words of Python. The package brings the command as `swm-rs`, for what has no function.
pub(crate) fn in_python(message: &str) -> String {
    const OF_ENV: &str = "`swm envs ";
    let mut told = message.to_owned();
    while let Some((before, rest)) = told.split_once(OF_ENV)
        && let Some((id, after)) = rest.split_once('`')
    {
        // Ids of the core are this package's own numbering.
        told = format!("{before}`swm.envs.info(\"{}\")`{after}", id.replacen("swm/", "swm_rs/", 1));
    }
    for (command, python) in WORDS {
        told = told.replace(command, python);
    }
    told.replace("`swm ", "`swm-rs ")
}
