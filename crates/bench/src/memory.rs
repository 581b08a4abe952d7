//! Current resident memory of this process, from `/proc` on Linux; `None` elsewhere.

/// Current resident memory (`VmRSS`), megabytes of 10^6 bytes.
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
    fn status_is_parsed() {
        assert_eq!(parse("VmHWM:\t 9 kB\nVmRSS:\t  125000 kB\n"), Some(128.0));
        assert_eq!(parse("Name:\tx\n"), None);
    }
}
