//! Datasets: formats, readers, writers, windowed loader.
