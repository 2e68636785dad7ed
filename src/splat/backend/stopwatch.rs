//! Where the time of the iterations goes.

use std::fmt::Write;
use std::time::{Duration, Instant};

/// Sums the time between laps by stage.
#[derive(Clone, Debug)]
pub struct Stopwatch {
    rounds: u32,
    last: Instant,
    stages: Vec<(&'static str, &'static str, Duration)>,
}

impl Default for Stopwatch {
    fn default() -> Self {
        Self { rounds: 0, last: Instant::now(), stages: Vec::new() }
    }
}

impl Stopwatch {
    /// Begins a round: what went before belongs to no stage.
    pub fn begin(&mut self) {
        self.rounds += 1;
        self.last = Instant::now();
    }

    /// Adds the time since the last lap to a stage of a part, `("sun", "forward")`.
    pub fn lap(&mut self, part: &'static str, stage: &'static str) {
        let now = Instant::now();
        let time = now - self.last;
        self.last = now;
        match self.stages.iter_mut().find(|s| (s.0, s.1) == (part, stage)) {
            Some(found) => found.2 += time,
            None => self.stages.push((part, stage, time)),
        }
    }

    /// A table of the stages, in the order in which they first came: milliseconds a round, share of the total.
    #[must_use]
    pub fn table(&self) -> String {
        let total: Duration = self.stages.iter().map(|s| s.2).sum();
        let mut text = format!("{:<32} {:>12} {:>7}\n", "stage", "ms/iteration", "share");
        let mut row = |name: &str, time: Duration| {
            let ms = time.as_secs_f64() * 1e3 / f64::from(self.rounds.max(1));
            let share = 100.0 * time.as_secs_f64() / total.as_secs_f64().max(f64::MIN_POSITIVE);
            let _ = writeln!(text, "{name:<32} {ms:>12.2} {share:>5.1} %");
        };
        for (part, stage, time) in &self.stages {
            row(&format!("{part}: {stage}"), *time);
        }
        row("total", total);
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn laps_of_a_stage_add_up_and_shares_to_the_whole() {
        let mut watch = Stopwatch::default();
        for _ in 0..2 {
            watch.begin();
            std::thread::sleep(Duration::from_millis(2));
            watch.lap("view", "forward");
            watch.lap("view", "backward");
        }
        let table = watch.table();
        let numbers = |name: &str| -> Vec<f64> {
            let line = table.lines().find(|l| l.starts_with(name)).unwrap();
            line[name.len()..].split_whitespace().filter_map(|w| w.parse().ok()).collect()
        };
        assert_eq!(table.lines().count(), 4, "{table}");
        assert!(numbers("view: forward")[0] >= 2.0 && numbers("total")[1] == 100.0, "{table}");
    }
}
