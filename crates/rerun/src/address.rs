//! Where a recording goes: into a file, or to a viewer that runs.

use std::path::Path;

/// `HOST:PORT` of the viewer where the name is an address such as `rerun+http://127.0.0.1:9876/proxy`; `None` where it is that
/// of a file.
pub fn viewer(to: &Path) -> Option<&str> {
    let address = to.to_str()?;
    let rest = ["rerun+http://", "rerun+https://"].iter().find_map(|scheme| address.strip_prefix(scheme))?;
    Some(rest.split_once('/').map_or(rest, |(host, _)| host))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_of_viewers_are_told_from_files() {
        let of = |to| viewer(Path::new(to));
        assert_eq!(of("rerun+http://127.0.0.1:9876/proxy"), Some("127.0.0.1:9876"));
        assert_eq!(of("rerun+https://shed.example:1"), Some("shed.example:1"));
        assert_eq!((of("run.rrd"), of("rerun/http.rrd"), of("http://a/b")), (None, None, None));
    }
}
