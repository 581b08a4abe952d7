//! Resource usage of this process: peak memory and CPU time, read from `/proc` on Linux; `None` on other systems.

use std::fs;

/// Peak resident memory of this process so far, in megabytes of 10^6 bytes (`VmHWM`).
pub fn peak_rss_mb() -> Option<f64> {
    parse_peak_rss_mb(&fs::read_to_string("/proc/self/status").ok()?)
}

/// CPU time of all threads so far, user and system, in seconds. Resolution 10 ms.
pub fn cpu_s() -> Option<f64> {
    parse_cpu_s(&fs::read_to_string("/proc/self/stat").ok()?)
}

/// The CPU model name, for timing reports.
pub fn cpu_model() -> Option<String> {
    let info = fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = info.lines().find(|l| l.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

fn parse_peak_rss_mb(status: &str) -> Option<f64> {
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024.0 / 1e6)
}

/// Fields 14 and 15 of proc(5), in clock ticks; USER_HZ is 100 on every Linux that Rust's standard
/// library supports. The name in field 2 may contain spaces and brackets, so counting starts after it.
fn parse_cpu_s(stat: &str) -> Option<f64> {
    let mut fields = stat.get(stat.rfind(')')? + 1..)?.split_ascii_whitespace().skip(11);
    let user: f64 = fields.next()?.parse().ok()?;
    let system: f64 = fields.next()?.parse().ok()?;
    Some((user + system) / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_proc_files() {
        assert_eq!(parse_peak_rss_mb("Name:\tx\nVmHWM:\t  125000 kB\nVmRSS:\t 1 kB\n"), Some(128.0));
        assert_eq!(parse_peak_rss_mb("Name:\tx\n"), None);
        let stat = "7 (a b) c) S 1 7 7 0 -1 4194304 100 0 0 0 250 50 9 9 20 0 1 0 100 1 1";
        assert_eq!(parse_cpu_s(stat), Some(3.0));
        assert_eq!(parse_cpu_s("7 (x"), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn peak_memory_includes_a_touched_block() {
        let before = peak_rss_mb().unwrap();
        let block = vec![1u8; 64_000_000];
        assert_eq!(block.iter().map(|b| u64::from(*b)).sum::<u64>(), 64_000_000);
        let after = peak_rss_mb().unwrap();
        assert!(after >= 64.0 && after >= before, "{before} MB, then {after} MB");
        assert!(cpu_s().unwrap() >= 0.0);
    }
}
