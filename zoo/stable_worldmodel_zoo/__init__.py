"""Trained models of stable-worldmodel for Rust: files alone, which ``stable_worldmodel_rs.zoo`` finds and loads."""

from pathlib import Path

# A folder per model, by its name.
MODELS: Path = Path(__file__).parent / "models"
