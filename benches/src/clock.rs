//! Time: that of the wall, and that which the CPU spent on this process. On a busy machine only the second
//! says something about the code.

use std::time::{Duration, Instant};

use serde::Serialize;

/// Two times that passed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Elapsed {
    /// CPU time of all threads of this process, seconds.
    pub cpu_s: f64,
    /// Wall time, seconds.
    pub wall_s: f64,
}

/// Adds up the times of several pieces of work, and of nothing between them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Clock {
    cpu: Duration,
    wall: Duration,
}

impl Clock {
    /// Nothing has passed.
    pub fn new() -> Self {
        Self::default()
    }

    /// Does `work` and adds the time that it took.
    pub fn time<R>(&mut self, work: impl FnOnce() -> R) -> R {
        let (cpu, wall) = (cpu_time(), Instant::now());
        let result = work();
        self.wall += wall.elapsed();
        self.cpu += cpu_time().saturating_sub(cpu);
        result
    }

    /// What all pieces of work took together.
    pub fn elapsed(&self) -> Elapsed {
        Elapsed { cpu_s: self.cpu.as_secs_f64(), wall_s: self.wall.as_secs_f64() }
    }
}

#[cfg(unix)]
fn cpu_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::try_from(time).unwrap_or_default()
}

/// Where no such clock is known, the wall's.
#[cfg(not(unix))]
fn cpu_time() -> Duration {
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    START.get_or_init(Instant::now).elapsed()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_counts_in_both_times_and_sleep_in_one() {
        let mut work = Clock::new();
        let mut sum = 0_u64;
        while work.elapsed().cpu_s < 0.02 {
            sum = work.time(|| (0..100_000).fold(sum, |sum, i| std::hint::black_box(sum ^ i)));
        }
        assert!(work.elapsed().wall_s > 0.0);
        let mut sleep = Clock::new();
        sleep.time(|| std::thread::sleep(Duration::from_millis(50)));
        assert!(sleep.elapsed().wall_s >= 0.05);
        #[cfg(unix)]
        assert!(sleep.elapsed().cpu_s < 0.04, "{:?}", sleep.elapsed());
    }
}
