//! The time that each part of the iterations takes.

use std::fmt::Write;
use std::time::{Duration, Instant};

/// Sums the time between laps for each stage.
#[derive(Clone, Debug)]
pub struct Stopwatch {
    iterations: u32,
    last: Instant,
    stages: Vec<(&'static str, &'static str, Duration)>,
}

impl Default for Stopwatch {
    fn default() -> Self {
        Self { iterations: 0, last: Instant::now(), stages: Vec::new() }
    }
}

impl Stopwatch {
    /// Starts an iteration; the time since the last lap counts for no stage.
    pub fn begin(&mut self) {
        self.iterations += 1;
        self.last = Instant::now();
    }

    /// Adds the time since the last lap to a stage of a part, such as stage "forward" of part "view".
    pub fn lap(&mut self, part: &'static str, stage: &'static str) {
        let now = Instant::now();
        let time = now - self.last;
        self.last = now;
        match self.stages.iter_mut().find(|s| (s.0, s.1) == (part, stage)) {
            Some(found) => found.2 += time,
            None => self.stages.push((part, stage, time)),
        }
    }

    /// A table of the stages in the order of their first laps: milliseconds per iteration, and percentage of the total.
    #[must_use]
    pub fn table(&self) -> String {
        let total: Duration = self.stages.iter().map(|s| s.2).sum();
        let mut text = format!("{:<32} {:>12} {:>7}\n", "stage", "ms/iteration", "share");
        let mut row = |name: &str, time: Duration| {
            let ms = time.as_secs_f64() * 1e3 / f64::from(self.iterations.max(1));
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
    fn laps_of_a_stage_are_summed_and_percentages_add_up_to_100() {
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
