//! `swm train --track`: metrics in trackers.

use clap::{Args, ValueEnum};

use crate::jobs::Tracking;

/// Where metrics go beside the run's folder.
#[derive(Args, Clone, Default)]
#[command(next_help_heading = "Tracking")]
pub(super) struct TrackArgs {
    /// Send metrics to a tracker as they come; several with commas. tensorboard reads the run's own event files, the others need the
    /// Python package.
    #[arg(long, value_name = "TRACKER", value_delimiter = ',')]
    track: Vec<Tracker>,
    /// What the tracker groups runs by. Default: stable-worldmodel.
    #[arg(long, value_name = "NAME", requires = "track")]
    track_project: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Tracker {
    Trackio,
    Wandb,
    Mlflow,
    Tensorboard,
}

impl Tracker {
    fn name(self) -> &'static str {
        match self {
            Self::Trackio => "trackio",
            Self::Wandb => "wandb",
            Self::Mlflow => "mlflow",
            Self::Tensorboard => "tensorboard",
        }
    }
}

impl TrackArgs {
    /// What follows the training.
    pub(super) fn tracking(&self) -> Tracking {
        let trackers = self.track.iter().map(|tracker| tracker.name().to_owned()).collect();
        Tracking { trackers, project: self.track_project.clone() }
    }
}
