//! What the derive makes of a struct: defaults, TOML, ranges, errors with lines.

use cairn_settings::{Settings, from_toml, to_toml};
use serde::{Deserialize, Serialize};

/// Corners.
#[derive(Clone, Debug, PartialEq, Settings, Serialize, Deserialize)]
struct Corners {
    /// Thresholds in gray levels, tried
    /// one after the other; see [`Self::share`].
    #[setting(default = [20, 7], range = 1..=255)]
    thresholds: [u8; 2],
    /// Share of the image.
    #[setting(default = 0.8, range = 0.0..=1.0)]
    share: f32,
}

/// Everything.
#[derive(Clone, Debug, PartialEq, Settings, Serialize, Deserialize)]
struct Whole {
    /// Where corners are found.
    #[setting(section)]
    corners: Corners,
    /// Whether it is done at all.
    #[setting(default = true)]
    enabled: bool,
    /// Beside these.
    #[setting(flatten)]
    #[serde(flatten)]
    more: More,
}

/// More entries.
#[derive(Clone, Debug, PartialEq, Settings, Serialize, Deserialize)]
struct More {
    /// How often.
    #[setting(default = 3, range = 1..=1_000_000)]
    times: usize,
}

fn why(text: &str) -> String {
    from_toml::<Whole>(text).unwrap_err().to_string()
}

#[test]
fn printed_settings_are_read_as_the_same() {
    let text = to_toml(&Whole::default());
    assert!(text.contains("# Thresholds in gray levels, tried one after the other; see share (1 to 255).\nthresholds = [20, 7]\n"), "{text}");
    assert!(
        text.contains("\n# Where corners are found.\n[corners]\n") && text.contains("share = 0.8\n"),
        "{text}"
    );
    assert_eq!(
        from_toml::<Whole>(&text.replace("= true", "= false")).unwrap(),
        Whole { enabled: false, ..Whole::default() }
    );
}

#[test]
fn left_out_entries_keep_their_defaults() {
    assert_eq!(from_toml::<Whole>("").unwrap(), Whole::default());
    let some = from_toml::<Whole>("times = 9\n[corners]\nshare = 1\n").unwrap();
    assert_eq!((some.more.times, some.corners.share, some.corners.thresholds), (9, 1.0, [20, 7]));
    assert_eq!(from_toml::<Whole>("[corners]\n").unwrap(), Whole::default());
}

#[test]
fn errors_name_entry_and_line() {
    assert_eq!(why("\ntimes = 0"), "line 2: times is 0, it must lie between 1 and 1000000");
    assert_eq!(
        why("[corners]\n\nthresholds = [20, 0]"),
        "line 3: corners.thresholds is 0, it must lie between 1 and 255"
    );
    assert_eq!(why("[corners]\nshare = nan"), "line 2: corners.share is NaN, it must lie between 0 and 1");
    assert!(why("[corners]\ntimes = 3").starts_with("line 2: unknown entry corners.times; there is times"));
    assert!(why("[corner]\n").starts_with("line 1: unknown entry corner"));
    assert!(why("corners = 3").starts_with("line 1: corners is a section"));
    assert!(why("enabled = true\ntimes = \"often\"").starts_with("line 2: times: "));
    assert!(why("[corners]\nthresholds = [20, 700]").starts_with("line 2: corners.thresholds: "));
    assert!(why("enabled = true\ntimes =").starts_with("line 2: "));
}
