//! The demo's learned model: a LeWM trained on TwoRoom for a minute, and how much of its success is left when colors or
//! speeds change. The commands are those of docs/robustness.md.

use std::path::Path;

use anyhow::{Context as _, Result};
use serde_json::Value as Json;

use super::Swm;

const ENV: &str = "swm/TwoRoom-v2";
const FACTORS: &str = "background.color,agent.color,agent.speed";

/// What a row has.
pub(super) const HEAD: [&str; 4] = ["change", "success", "difference, points", "p-value (McNemar)"];

/// How much of everything.
pub(super) struct Amount {
    recorded: &'static str,
    trained: &'static str,
    pairs: &'static str,
    planner: &'static str,
}

pub(super) const FULL: Amount =
    Amount { recorded: "1000", trained: "200", pairs: "30", planner: "samples=100,iterations=8,elites=10" };

pub(super) const SHORT: Amount =
    Amount { recorded: "20", trained: "3", pairs: "2", planner: "samples=8,iterations=2,elites=2" };

/// Records, trains, and evaluates under each change. Gives one row per change: its name, success, difference, p-value.
pub(super) fn run(swm: &Swm, amount: &Amount, out: &Path) -> Result<Vec<[String; 4]>> {
    let at = |name: &str| out.join("robustness").join(name);
    let (data, model, task, sweep) = (at("noisy.h5"), at("lewm"), at("tworoom.toml"), at("sweep"));
    if model.exists() {
        std::fs::remove_dir_all(&model).with_context(|| format!("cannot replace {}", model.display()))?;
    }
    let images = ["--image-size", "64x64", "--env-option", "render=fast"];
    let collect =
        ["collect", ENV, "--policy", "noisy-expert:2", "--episodes", amount.recorded, "--seed", "1"];
    let collect = [&collect[..], &images, &["--without", "goal", "--mode", "overwrite"]].concat();
    swm.json(&collect, &[("--out", &data)])?;
    let train = ["train", "lewm", "--preset", "small", "--steps", amount.trained];
    swm.json(&train, &[("--dataset", &data), ("--out", &model)])?;
    let make = ["manifest", "make", ENV, "--tier", "historic", "--episodes", amount.pairs];
    swm.json(&[&make[..], &images].concat(), &[("--dataset", &data), ("--out", &task)])?;
    let policy = format!("mpc:{},{}", model.display(), amount.planner);
    let call = ["sweep", "--policy", &policy, "--factors", FACTORS, "--again"];
    rows(&swm.json(&call, &[("--manifest", &task), ("--out", &sweep)])?)
}

/// The cells of a sweep, as text.
fn rows(sweep: &Json) -> Result<Vec<[String; 4]>> {
    let cells = sweep["cells"].as_array().context("a sweep without cells")?;
    let row = |cell: &Json| {
        let figure = |pointer: &str| cell.pointer(pointer).and_then(Json::as_f64);
        let text = |figure: Option<f64>, show: fn(f64) -> String| figure.map_or("–".to_owned(), show);
        [
            cell["name"].as_str().unwrap_or_default().to_owned(),
            text(figure("/summary/success_rate"), |rate| format!("{rate:.1} %")),
            text(figure("/test/difference"), |points| format!("{points:+.1}")),
            text(figure("/test/p_value"), |p| format!("{p:.4}")),
        ]
    };
    Ok(cells.iter().map(row).collect())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_row_per_change_without_what_could_not_be() {
        let sweep = json!({ "cells": [
            { "name": "unchanged", "summary": { "success_rate": 96.667 }, "test": null },
            { "name": "agent.color", "summary": { "success_rate": 33.333 }, "test": { "difference": -63.333, "p_value": 0.00001 } },
            { "name": "door.size", "summary": null, "test": null },
        ] });
        let rows = rows(&sweep).unwrap();
        assert_eq!(rows[0], ["unchanged", "96.7 %", "–", "–"]);
        assert_eq!(rows[1], ["agent.color", "33.3 %", "-63.3", "0.0000"]);
        assert_eq!(rows[2], ["door.size", "–", "–", "–"]);
        assert!(super::rows(&json!({})).is_err());
    }
}
