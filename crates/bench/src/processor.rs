//! CPU time of the calling thread, from `/proc` on Linux; `None` elsewhere. Other load on the machine affects it less
//! than wall time.

/// CPU time of the calling thread so far, milliseconds.
pub fn thread_cpu_ms() -> Option<f64> {
    parse(&std::fs::read_to_string("/proc/thread-self/schedstat").ok()?)
}

fn parse(schedstat: &str) -> Option<f64> {
    let nanoseconds: f64 = schedstat.split(' ').next()?.parse().ok()?;
    Some(nanoseconds / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedstat_is_parsed() {
        assert_eq!(parse("155545530 485286161 59\n"), Some(155.54553));
        assert_eq!(parse(""), None);
    }
}
