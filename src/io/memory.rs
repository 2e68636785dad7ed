//! Memory of the machine, and the peak memory of this process, where the system tells them.

use std::fs;
use std::path::Path;

/// Bytes in a megabyte, and in a kilobyte of Linux.
const MEGABYTE: f64 = 1e6;
const KIBIBYTE: f64 = 1024.0;
/// Where control groups are, and the files with their limits of memory: version 2 and version 1.
const GROUPS: [(&str, &str); 2] =
    [("/sys/fs/cgroup", "memory.max"), ("/sys/fs/cgroup/memory", "memory.limit_in_bytes")];

/// Memory of the machine, or of the control groups that the process runs in, as batch systems and containers set them,
/// megabytes.
#[must_use]
pub fn available_memory_mb() -> Option<f64> {
    let machine = field(Path::new("/proc/meminfo"), "MemTotal:");
    let own = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    // Lines are `0::/path` in version 2, `4:memory:/path` in version 1.
    let paths = own.lines().filter_map(|line| line.rsplit_once(':')).map(|(_, path)| Path::new(path));
    let groups = paths.flat_map(Path::ancestors).filter_map(|path| path.strip_prefix("/").ok());
    let limits = groups.flat_map(|group| GROUPS.map(|(root, file)| Path::new(root).join(group).join(file)));
    let bytes = limits.filter_map(|path| fs::read_to_string(path).ok()?.trim().parse::<f64>().ok());
    bytes.map(|bytes| bytes / MEGABYTE).chain(machine).min_by(f64::total_cmp)
}

/// Largest memory that this process had since [`reset_peak_memory`], megabytes.
#[must_use]
pub fn peak_memory_mb() -> Option<f64> {
    field(Path::new("/proc/self/status"), "VmHWM:")
}

/// Begins a new measurement of the peak memory. Where the system does not allow it, the peak is that of the process.
pub fn reset_peak_memory() {
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// A field in kilobytes of a file of the system, in megabytes.
fn field(path: &Path, name: &str) -> Option<f64> {
    let text = fs::read_to_string(path).ok()?;
    let value = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kilobytes: f64 = value.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kilobytes * KIBIBYTE / MEGABYTE)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn the_peak_follows_an_allocation_and_can_be_reset() {
        let before = peak_memory_mb().unwrap();
        let block = std::hint::black_box(vec![1u8; 300_000_000]);
        assert!(peak_memory_mb().unwrap() > before.max(250.0));
        drop(block);
        assert!(available_memory_mb().unwrap() > 300.0);
    }
}
