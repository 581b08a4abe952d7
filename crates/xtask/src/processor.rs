//! How long a thread has been on the processor, from `/proc` on Linux; `None` elsewhere. Other programs lengthen it less than
//! they lengthen the time on a clock.

/// Milliseconds that the calling thread has run so far.
pub fn on_processor_ms() -> Option<f64> {
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
    fn reads_the_kernels_text() {
        assert_eq!(parse("155545530 485286161 59\n"), Some(155.54553));
        assert_eq!(parse(""), None);
    }
}
