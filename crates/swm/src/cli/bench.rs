//! `swm bench`: steps per second on this machine.

use std::sync::LazyLock;

use clap::Args;
use swm_core::{Cancel, Registry};
use swm_tasks::request::{self, Request as _, Throughput};

use super::args::EnvArgs;
use super::output::table;
use super::reporter::Reporter;
use super::{Failure, Output};

/// The defaults of a request, for help and for what is not given.
static DEFAULT: LazyLock<request::Bench> = LazyLock::new(request::Bench::default);

/// Measure steps per second, with and without images, by number of threads.
#[derive(Args)]
#[command(after_help = "Examples:\n  swm bench swm/PushT-v1\n  swm bench swm/PushT-v1 --seconds 5 --json")]
pub(super) struct Bench {
    #[command(flatten)]
    env: EnvArgs,
    /// The policy, as for `swm eval`; its time counts.
    #[arg(long, default_value = DEFAULT.policy.as_str())]
    policy: String,
    /// Seconds of each measurement.
    #[arg(long, default_value_t = DEFAULT.seconds)]
    seconds: f64,
}

impl Bench {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let (env, env_option) = self.env.named(registry)?;
        let request = request::Bench { env, env_option, policy: self.policy, seconds: self.seconds };
        let measured = request.run(registry, &mut Reporter::new(output, Cancel::new()))?;
        output.result(&measured, || {
            let row = |m: &Throughput| {
                let image = if m.pixels { m.image.clone() } else { "none".to_owned() };
                let rate = format!("{:.0}", m.steps_per_second);
                vec![image, m.threads.to_string(), m.num_envs.to_string(), rate]
            };
            table(&["images", "threads", "environments", "steps per second"], measured.iter().map(row))
        })
    }
}
