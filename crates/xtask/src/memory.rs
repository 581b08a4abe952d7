//! Resident memory of this process at this moment, from `/proc` on Linux; `None` elsewhere.

/// Megabytes of 10^6 bytes that are resident now (`VmRSS`).
pub fn resident_mb() -> Option<f64> {
    parse(&std::fs::read_to_string("/proc/self/status").ok()?)
}

fn parse(status: &str) -> Option<f64> {
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024.0 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_the_kernels_text() {
        assert_eq!(parse("VmHWM:\t 9 kB\nVmRSS:\t  125000 kB\n"), Some(128.0));
        assert_eq!(parse("Name:\tx\n"), None);
    }
}
