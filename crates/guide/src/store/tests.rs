//! Routes on disk: round trips, truncation, altered bytes.

use super::*;
use crate::anchor::Anchor;
use crate::ground::Ground;
use crate::route::Stretch;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::Stamp;

fn text() -> String {
    let mut s = serde_json::to_string(&RouteHeader::new(true, &Ground::z_up(), "test")).unwrap() + "\n";
    for k in 0..3 {
        let pose = Se3::new(So3::exp(&Vec3::new(0.1, 0.2, k as f64)), Vec3::new(k as f64, 0.25, -1.0));
        let point = RoutePoint {
            stamp: Stamp(k),
            anchor: Anchor { robot: 1, seq: 7 },
            anchor_from_camera: pose,
            odom_from_camera: pose,
            stretch: Stretch::Tracked,
            quality: 0.5,
        };
        s += &(serde_json::to_string(&point).unwrap() + "\n");
    }
    s
}

#[test]
fn save_and_load_round_trip() {
    let route = Route::read(text().as_bytes()).unwrap();
    assert_eq!(route.points.len(), 3);
    assert!(!route.torn);
    let path = std::env::temp_dir().join(format!("cairn-route-{}.jsonl", std::process::id()));
    let _ = std::fs::remove_file(&path);
    route.save(&path).unwrap();
    let again = Route::load(&path).unwrap();
    assert!(route.save(&path).is_err(), "a recording was overwritten");
    std::fs::remove_file(&path).unwrap();
    assert_eq!(again.header, route.header);
    for (a, b) in again.points.iter().zip(&route.points) {
        assert!((a.odom_from_camera.inverse() * b.odom_from_camera).log().norm() < 1e-12);
        assert_eq!((a.stamp, a.anchor, a.stretch), (b.stamp, b.anchor, b.stretch));
    }
}

#[test]
fn truncated_last_line_is_dropped() {
    let text = text();
    let last = text.trim_end().rfind('\n').unwrap() + 1;
    for cut in last + 1..text.len() - 1 {
        let route = Route::read(&text.as_bytes()[..cut]).unwrap();
        assert_eq!((route.points.len(), route.torn), (2, true), "cut at {cut}");
    }
    // Only the line end is missing: the point itself is complete and is kept.
    assert_eq!(Route::read(&text.as_bytes()[..text.len() - 1]).unwrap().points.len(), 3);
}

#[test]
fn recording_resumes_after_truncation() {
    let text = text();
    let path = std::env::temp_dir().join(format!("cairn-route-resume-{}.jsonl", std::process::id()));
    let header = text.find('\n').unwrap() + 1;
    let mut after = Route::read(text.as_bytes()).unwrap().points[2];
    after.stamp = Stamp(9);
    let ends: Vec<usize> = text.match_indices('\n').map(|(i, _)| i).collect();
    let near_an_end = |cut: &usize| ends.iter().any(|end| end.abs_diff(*cut) < 3);
    for cut in (header..=text.len()).filter(|cut| cut % 37 == 0 || near_an_end(cut)) {
        std::fs::write(&path, &text.as_bytes()[..cut]).unwrap();
        let before = Route::load(&path).unwrap();
        let (so_far, mut writer) = RouteWriter::resume(&path).unwrap();
        assert_eq!((so_far.points.len(), so_far.torn), (before.points.len(), false), "cut at {cut}");
        writer.append(&after).unwrap();
        writer.make_durable().unwrap();
        let again = Route::load(&path).unwrap();
        assert!(!again.torn, "cut at {cut}");
        let (last, others) = again.points.split_last().unwrap();
        assert_eq!((last.stamp, others), (after.stamp, &before.points[..]), "cut at {cut}");
        assert_eq!(Route::read(&again.to_bytes().unwrap()[..]).unwrap().points.len(), again.points.len());
    }
    std::fs::write(&path, &text.as_bytes()[..header - 5]).unwrap();
    assert!(RouteWriter::resume(&path).is_err(), "a file without a header was resumed");
    std::fs::remove_file(&path).unwrap();
}

#[test]
fn no_altered_byte_changes_a_route_unseen() {
    let route = Route::read(text().as_bytes()).unwrap();
    let bytes = route.to_bytes().unwrap();
    let same = Route::read(&bytes[..]).unwrap();
    assert_eq!((same.points.len(), same.torn), (3, false));
    for at in 0..bytes.len() - 1 {
        // White space where there was none, another digit, another letter.
        for flip in [0x01, 0x10, 0x20] {
            let mut damaged = bytes.clone();
            damaged[at] ^= flip;
            match Route::read(&damaged[..]) {
                // In the name of the header's checksum: then the file reads as one without, and is the same.
                Ok(read) => assert_eq!(read, same, "byte {at} flipped by {flip}"),
                Err(e) => assert!(matches!(e, RouteError::Line { .. } | RouteError::Header(_)), "{e}"),
            }
        }
    }
    let error = Route::read(&bytes[..].replace_first(b"\"q\":0.5", b"\"q\":0.6")[..]).unwrap_err();
    assert_eq!(error.to_string(), "line 2: its checksum does not match: bytes were altered");
}

#[test]
fn routes_with_checksums_resume_after_truncation() {
    let bytes = Route::read(text().as_bytes()).unwrap().to_bytes().unwrap();
    let second = bytes.iter().enumerate().filter(|(_, b)| **b == b'\n').nth(1).unwrap().0 + 1;
    for cut in second..bytes.len() {
        let route = Route::read(&bytes[..cut]).unwrap();
        assert!((1..=3).contains(&route.points.len()), "cut at {cut}");
    }
}

#[test]
fn notes_and_names_round_trip_and_old_files_have_none() {
    let old = Route::read(text().as_bytes()).unwrap();
    assert!(old.notes.is_empty() && old.header.name.is_none());
    let p = old.points[1];
    let note = RouteNote {
        text: "door to the yard".into(),
        side: Some(crate::Side::Left),
        stamp: p.stamp,
        anchor: p.anchor,
        anchor_from_camera: p.anchor_from_camera,
        odom_from_camera: p.odom_from_camera,
    };
    let mut bytes = old.to_bytes().unwrap();
    // A note may be taken before the last point, and the name come last.
    write_line(&mut bytes, &note).unwrap();
    let header =
        RouteHeader { name: Some("to the kitchen".into()), recorded_s: Some(5), ..old.header.clone() };
    write_line(&mut bytes, &header).unwrap();
    let read = Route::read(&bytes[..]).unwrap();
    assert_eq!((read.header.name.as_deref(), read.header.recorded_s), (Some("to the kitchen"), Some(5)));
    assert_eq!((&read.notes[0].text, read.notes[0].side, read.points.len()), (&note.text, note.side, 3));
    assert_eq!(Route::read(&read.to_bytes().unwrap()[..]).unwrap().notes.len(), 1);
    // Every altered byte of the note is found, a torn one is left out.
    let from = bytes.windows(7).position(|w| w == b"{\"note\"").unwrap();
    let to = from + bytes[from..].iter().position(|b| *b == b'\n').unwrap();
    for at in from..to {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        assert!(Route::read(&damaged[..]).is_err(), "byte {at}");
    }
    for cut in from + 1..to - 1 {
        let torn = Route::read(&bytes[..cut]).unwrap();
        assert_eq!((torn.notes.len(), torn.points.len(), torn.torn), (0, 3, true), "cut at {cut}");
    }
    for wrong in ["", "a\nb", &"x".repeat(121)] {
        assert!(RouteNote { text: wrong.into(), ..note.clone() }.check().is_err(), "{wrong:?}");
    }
}

trait Replace {
    fn replace_first(&self, from: &[u8], to: &[u8]) -> Vec<u8>;
}

impl Replace for [u8] {
    fn replace_first(&self, from: &[u8], to: &[u8]) -> Vec<u8> {
        let at = self.windows(from.len()).position(|w| w == from).expect("it is there");
        [&self[..at], to, &self[at + from.len()..]].concat()
    }
}

#[test]
fn malformed_files_are_errors_with_line() {
    let message = |s: String| Route::read(s.as_bytes()).unwrap_err().to_string();
    assert!(message(String::new()).contains("empty"));
    assert!(message("hello\n".into()).contains("first line"));
    assert!(message(text().replace("\"version\":1", "\"version\":9")).contains("version 9"));
    assert!(message(text().replace("cairn-route", "other")).contains("other"));
    assert!(message(text().replace("[0.0,0.0,1.0]", "[0.0,0.0,0.0]")).contains("up"));
    assert!(message(text().replace("\"t\":1,", "\"t\":0,")).contains("line 3: time"));
    assert!(message(text().replace("\"t\":1,", "\"t\":x,")).contains("line 3"));
    assert!(message(text().replace("\"rel\":[0.0", "\"rel\":[1e999")).contains("line 2"));
}
