//! The time that each part of the iterations takes.

use std::fmt::Write;
use std::time::{Duration, Instant};

/// Stages that take less time in an iteration are not shown.
const LEAST: Duration = Duration::from_micros(5);

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

    /// A table of the stages in the order of their first laps: milliseconds per iteration, and percentage of the total. Stages
    /// that take no time, such as loss terms without a weight, are left out.
    #[must_use]
    pub fn table(&self) -> String {
        let total: Duration = self.stages.iter().map(|s| s.2).sum();
        let mut text = format!("{:<32} {:>12} {:>7}\n", "stage", "ms/iteration", "share");
        let mut row = |name: &str, time: Duration| {
            let ms = time.as_secs_f64() * 1e3 / f64::from(self.iterations.max(1));
            let share = 100.0 * time.as_secs_f64() / total.as_secs_f64().max(f64::MIN_POSITIVE);
            let _ = writeln!(text, "{name:<32} {ms:>12.2} {share:>5.1} %");
        };
        let least = LEAST * self.iterations;
        for (part, stage, time) in self.stages.iter().filter(|stage| stage.2 >= least) {
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
    fn laps_of_a_stage_are_summed() {
        let mut watch = Stopwatch::default();
        for _ in 0..2 {
            watch.begin();
            std::thread::sleep(Duration::from_millis(2));
            watch.lap("view", "forward");
            watch.lap("view", "backward");
        }
        assert!(watch.stages.len() == 2 && watch.stages[0].2 >= Duration::from_millis(4), "{watch:?}");
    }

    #[test]
    fn the_table_has_times_of_an_iteration_and_no_stages_without_work() {
        let stages = [("view", "forward", 30_000), ("loss", "opacity", 3), ("view", "backward", 10_000)];
        let stages = stages.map(|(part, stage, us)| (part, stage, Duration::from_micros(us)));
        let watch = Stopwatch { iterations: 10, stages: stages.to_vec(), ..Stopwatch::default() };
        let table = watch.table();
        let words: Vec<Vec<&str>> = table.lines().map(|line| line.split_whitespace().collect()).collect();
        let expected = [
            vec!["view:", "forward", "3.00", "75.0", "%"],
            vec!["view:", "backward", "1.00", "25.0", "%"],
            vec!["total", "4.00", "100.0", "%"],
        ];
        assert_eq!(words[1..], expected);
    }
}
