//! Constructor settings of Piecewise.

use serde_json::{Map, Value as Json};

use crate::settings::Render;

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub(super) struct Settings {
        /// Zones along each axis, 1 to 8.
        grid_n: usize = 2,
        /// `exact`: the reference's images; `fast`: rendered at the requested size.
        render: Render = Render::Exact => "exact",
        /// Other defaults of factors, {name: value}.
        init_value: Map<String, Json> = Map::new() => "{}",
    }
}

impl Settings {
    /// Checks what the types cannot express.
    pub(super) fn check(&self) -> Result<(), String> {
        match self.grid_n {
            1..=8 => Ok(()),
            other => Err(format!("grid_n {other} is not in 1 to 8")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documented_defaults_are_the_defaults() {
        swm_core::testing::assert_documented_defaults::<Settings>();
    }

    #[test]
    fn grids_of_no_zones_and_of_too_many_are_refused() {
        for grid_n in [0, 9] {
            let wrong = Settings { grid_n, ..Settings::default() };
            assert!(wrong.check().unwrap_err().contains("1 to 8"));
        }
    }
}
