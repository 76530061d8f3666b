//! Smooth random policies: actions that change little from step to step, and so move a body further than noise that
//! cancels itself out. For boxes of real numbers; integers have no between.

use std::f64::consts::TAU;

use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal};

use crate::batch::SliceMut;
use crate::error::PolicyError;
use crate::policy::{Actor, PerEpisode, Policy, SlotView};
use crate::settings;
use crate::settings::Settings as _;
use crate::space::Space;

settings! {
    /// An Ornstein-Uhlenbeck process per element of the action: `x += -theta x + sigma n` with standard normal n, starting in
    /// its stationary distribution. The action is the middle of its bounds plus x times half their range, clipped.
    ///
    /// The defaults have a memory of about 7 steps and a standard deviation of 0.57 of half the range. Source: Lillicrap et
    /// al., *Continuous Control with Deep Reinforcement Learning* (2016), who use a sigma of 0.2.
    #[derive(Copy)]
    pub struct OrnsteinUhlenbeck {
        /// Fraction of the distance to the middle that a step covers, above 0 and up to 1 (white noise).
        theta: f64 = 0.15,
        /// Standard deviation of a step's noise, in halves of the action's range.
        sigma: f64 = 0.3,
    }
}

settings! {
    /// A sum of sines per element of the action. Frequencies, phases and weights are sampled once per episode: frequencies
    /// uniform between those of the two periods, weights uniform and scaled to add up to `amplitude`.
    #[derive(Copy)]
    pub struct Sines {
        /// Sines per element of the action, 1 to 100.
        waves: usize = 2,
        /// Largest value that the sum can take, in halves of the action's range; the action is clipped.
        amplitude: f64 = 1.0,
        /// Shortest period in steps (2 or more).
        shortest: f64 = 10.0,
        /// Longest period in steps.
        longest: f64 = 100.0,
    }
}

/// A policy of [`OrnsteinUhlenbeck`] processes.
///
/// # Errors
///
/// [`PolicyError::Argument`]: theta is not above 0 and up to 1, or sigma is not positive.
pub fn ornstein_uhlenbeck(settings: OrnsteinUhlenbeck) -> Result<impl Policy, PolicyError> {
    const NAME: &str = "ou";
    let OrnsteinUhlenbeck { theta, sigma } = settings;
    require(NAME, theta > 0.0 && theta <= 1.0, || format!("theta {theta} is not above 0 and up to 1"))?;
    require(NAME, sigma > 0.0 && sigma.is_finite(), || format!("sigma {sigma} is not a positive number"))?;
    let keep = 1.0 - theta;
    // Where variance gained and lost are equal.
    let long_run = sigma / (1.0 - keep * keep).sqrt();
    Ok(PerEpisode::new(settings.describe_as(NAME), move |view: &SlotView<'_>| {
        let scale = Scale::of(NAME, view)?;
        let mut stream = view.episode.seed.stream("policy ou start");
        let process = scale.0.iter().map(|_| long_run * normal(&mut stream)).collect();
        Ok(Box::new(Process { scale, process, keep, sigma }) as Box<dyn Actor>)
    }))
}

/// A policy of [`Sines`].
///
/// # Errors
///
/// [`PolicyError::Argument`]: not 1 to 100 waves, an amplitude that is not positive, or periods below 2 steps or in
/// the wrong order.
pub fn sines(settings: Sines) -> Result<impl Policy, PolicyError> {
    const NAME: &str = "sine";
    let Sines { waves, amplitude, shortest, longest } = settings;
    require(NAME, (1..=100).contains(&waves), || format!("waves {waves} is not in 1 to 100"))?;
    require(NAME, amplitude > 0.0 && amplitude.is_finite(), || {
        format!("amplitude {amplitude} is not a positive number")
    })?;
    require(NAME, 2.0 <= shortest && shortest <= longest && longest.is_finite(), || {
        format!(
            "periods from {shortest} to {longest} steps; the shortest is 2 or more, the longest no shorter"
        )
    })?;
    Ok(PerEpisode::new(settings.describe_as(NAME), move |view: &SlotView<'_>| {
        let scale = Scale::of(NAME, view)?;
        let mut stream = view.episode.seed.stream("policy sine");
        let mut all = Vec::with_capacity(scale.0.len() * waves);
        for _ in 0..scale.0.len() {
            let first = all.len();
            for _ in 0..waves {
                let [share, place, phase] = std::array::from_fn(|_| stream.random::<f64>());
                let (slow, fast) = (1.0 / longest, 1.0 / shortest);
                all.push(Wave { share, frequency: slow + (fast - slow) * place, phase });
            }
            let sum: f64 = all[first..].iter().map(|wave| wave.share).sum();
            all[first..].iter_mut().for_each(|wave| wave.share *= amplitude / sum.max(f64::MIN_POSITIVE));
        }
        Ok(Box::new(Waves { scale, waves: all, each: waves }) as Box<dyn Actor>)
    }))
}

fn require(policy: &str, holds: bool, reason: impl FnOnce() -> String) -> Result<(), PolicyError> {
    if holds { Ok(()) } else { Err(PolicyError::Argument { policy: policy.to_owned(), reason: reason() }) }
}

/// Middle and half width of every number of an action.
struct Scale(Vec<[f64; 2]>);

impl Scale {
    fn of(policy: &str, view: &SlotView<'_>) -> Result<Self, PolicyError> {
        let unsupported = |reason: &str| PolicyError::Unsupported {
            policy: policy.to_owned(),
            reason: format!("the actions of {} {reason}; use `random`", view.spec.id),
        };
        let Space::Box { low, high, .. } = &view.spec.action else {
            return Err(unsupported("are integers, between which nothing is smooth"));
        };
        if low.iter().chain(high).any(|bound| !bound.is_finite()) {
            return Err(unsupported("have no bounds"));
        }
        Ok(Self(low.iter().zip(high).map(|(low, high)| [(low + high) / 2.0, (high - low) / 2.0]).collect()))
    }

    /// Writes values in -1..1 as an action; what is beyond is clipped.
    fn write(&self, values: impl Iterator<Item = f64>, action: &mut SliceMut<'_>) {
        let scaled = self.0.iter().zip(values).map(|([middle, half], x)| middle + half * x.clamp(-1.0, 1.0));
        match action {
            SliceMut::F32(out) => out.iter_mut().zip(scaled).for_each(|(out, value)| *out = value as f32),
            SliceMut::F64(out) => out.iter_mut().zip(scaled).for_each(|(out, value)| *out = value),
            _ => unreachable!("boxes hold real numbers"),
        }
    }
}

struct Process {
    scale: Scale,
    /// `[A]`, in half widths.
    process: Vec<f64>,
    keep: f64,
    sigma: f64,
}

impl Actor for Process {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        self.scale.write(self.process.iter().copied(), &mut action);
        let mut stream = view.episode.seed.indexed("policy ou", [view.episode.step, 0]);
        self.process.iter_mut().for_each(|x| *x = self.keep * *x + self.sigma * normal(&mut stream));
        Ok(())
    }
}

fn normal(stream: &mut crate::seed::Stream) -> f64 {
    StandardNormal.sample(stream)
}

/// One sine: its part of the sum, turns per step, and turns at the first step.
struct Wave {
    share: f64,
    frequency: f64,
    phase: f64,
}

struct Waves {
    scale: Scale,
    /// `[A, each]`.
    waves: Vec<Wave>,
    each: usize,
}

impl Actor for Waves {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let step = view.episode.step as f64;
        let at = |wave: &Wave| wave.share * sine_of_turns(wave.frequency * step + wave.phase);
        let sums = self.waves.chunks_exact(self.each).map(|waves| waves.iter().map(at).sum());
        self.scale.write(sums, &mut action);
        Ok(())
    }
}

/// sin(2π turns), to 1e-9: by its power series, as the functions of math libraries differ between machines.
fn sine_of_turns(turns: f64) -> f64 {
    let turns = turns - turns.round();
    let turns = if turns.abs() > 0.25 { 0.5 * turns.signum() - turns } else { turns };
    let x = TAU * turns;
    let series = (1..=6).rev().fold(1.0, |rest, k| {
        let k = f64::from(2 * k);
        1.0 - x * x / (k * (k + 1.0)) * rest
    });
    x * series
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry::Registry;
    use crate::testing::{DISCRETE_TOY, TOY, assert_documented_defaults};
    use crate::{
        BoxError, EnvEntry, EpisodeEnd, LiveStep, Recorder, Rollout, World, WorldError, WorldOptions,
    };

    /// The actions of each episode.
    #[derive(Default)]
    struct Log(Vec<(u64, u64, f32)>);

    impl Recorder for Log {
        fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
            let action = row.values.get::<f32>("action")?[0];
            self.0.push((row.episode.index, row.episode.step, action));
            Ok(())
        }

        fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
            Ok(())
        }
    }

    fn actions(env: &'static EnvEntry, policy: &str, num_envs: usize) -> Result<Vec<Vec<f32>>, WorldError> {
        const STEPS: u64 = 400;
        let options = WorldOptions::new(num_envs).max_episode_steps(STEPS);
        let mut world = World::new(env, options)?;
        world.set_policy(Registry::new().policy(policy, &world)?)?;
        let mut log = Log::default();
        world.run(&Rollout::new(0..6).seed(7), &mut log)?;
        log.0.sort_by_key(|row| (row.0, row.1));
        let mut episodes = vec![Vec::new(); 6];
        log.0.iter().filter(|row| !row.2.is_nan()).for_each(|row| episodes[row.0 as usize].push(row.2));
        Ok(episodes)
    }

    fn mean_step(episodes: &[Vec<f32>]) -> f64 {
        let steps =
            episodes.iter().flat_map(|actions| actions.windows(2).map(|w| f64::from((w[1] - w[0]).abs())));
        let (sum, count) = steps.fold((0.0, 0), |(sum, count), step| (sum + step, count + 1));
        sum / f64::from(count)
    }

    #[test]
    fn actions_are_smooth_and_reach_both_sides() {
        let noise = mean_step(&actions(&TOY, "random", 1).unwrap());
        for (policy, share) in [("ou", 0.5), ("sine", 0.4), ("ou:theta=0.02,sigma=0.1", 0.2)] {
            let episodes = actions(&TOY, policy, 1).unwrap();
            assert!(mean_step(&episodes) < share * noise, "{policy}: {}", mean_step(&episodes));
            let all = || episodes.iter().flatten();
            assert!(all().any(|&a| a > 0.8) && all().any(|&a| a < -0.8), "{policy}");
            assert!(all().all(|a| a.abs() <= 1.0), "{policy}");
            assert!(episodes[0] != episodes[1], "{policy} repeats itself");
        }
    }

    #[test]
    fn an_episode_does_not_see_its_neighbors() {
        for policy in ["ou", "sine:waves=3"] {
            assert_eq!(actions(&TOY, policy, 1).unwrap(), actions(&TOY, policy, 4).unwrap(), "{policy}");
        }
    }

    #[test]
    fn the_process_has_the_std_of_its_formula() {
        // sigma / sqrt(1 - (1 - theta)²), small enough that nothing is clipped.
        let episodes = actions(&TOY, "ou:theta=0.5,sigma=0.1", 1).unwrap();
        let values: Vec<f64> = episodes.iter().flatten().map(|&value| f64::from(value)).collect();
        let std = (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt();
        assert!((std - 0.1 / 0.75_f64.sqrt()).abs() < 0.01, "{std}");
    }

    #[test]
    fn sines_are_sines() {
        for index in -40..=40 {
            let turns = f64::from(index) / 16.0;
            assert!((sine_of_turns(turns) - (TAU * turns).sin()).abs() < 1e-8, "{turns}");
        }
    }

    #[test]
    fn wrong_settings_and_integers_are_refused() {
        for (policy, part) in [
            ("ou:theta=0", "theta 0 is not above 0"),
            ("ou:sigma=-1", "sigma -1 is not a positive number"),
            ("ou:speed=1", "setting `speed`: unknown; known are theta, sigma"),
            ("sine:waves=0", "waves 0 is not in 1 to 100"),
            ("sine:shortest=1", "the shortest is 2 or more"),
            ("sine:shortest=9,longest=3", "periods from 9 to 3 steps"),
        ] {
            let message = actions(&TOY, policy, 1).unwrap_err().to_string();
            assert!(message.contains(part), "{policy}: {message}");
        }
        let message = actions(&DISCRETE_TOY, "ou", 1).unwrap_err().to_string();
        assert!(
            message.contains("swm/DiscreteToy-v0 are integers") && message.contains("`random`"),
            "{message}"
        );
    }

    #[test]
    fn documented_defaults_are_the_defaults() {
        assert_documented_defaults::<OrnsteinUhlenbeck>();
        assert_documented_defaults::<Sines>();
        let changed = ornstein_uhlenbeck(OrnsteinUhlenbeck { sigma: 0.5, ..Default::default() }).unwrap();
        assert_eq!(changed.describe(), "ou:sigma=0.5");
    }
}
