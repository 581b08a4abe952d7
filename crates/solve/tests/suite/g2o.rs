//! g2o text: what is right is read and written back; what is wrong is told with its line; nothing panics.

use cairn_solve::g2o::{Graph, Replaced, read, read_nearest, write};
use proptest::prelude::*;

const PLANE: &str = "\
# a square
VERTEX_SE2 10 0 0 0
VERTEX_SE2 2 1 0.5 1.5
VERTEX_XY 4 1 1

EDGE_SE2 2 10 1 0 0.1 100 1 0 100 0 400
FIX 2
";

const SPACE: &str = "\
EDGE_SE3:QUAT 0 1 1 2 3 0 0 0.6 0.8 10 0 0 0 0 0 10 0 0 0 0 10 0 0 0 400 0 0 400 0 400
EDGE_SE3:QUAT 1 3 1 2 3 0.5 0.5 0.5 0.5 10 0 0 0 0 0 10 0 0 0 0 10 0 0 0 400 0 0 400 0 400
";

#[test]
fn planes_are_read() {
    let file = read(PLANE).expect("good text");
    let Graph::Plane(named) = &file.graph else { panic!("{file:?}") };
    assert_eq!(named.ids, [2, 10]);
    assert_eq!(named.graph.fixed(), [true, false]);
    assert_eq!((named.graph.values()[0].translation.y, named.graph.values()[0].rotation.log()), (0.5, 1.5));
    let edge = &named.graph.edges()[0];
    assert_eq!((edge.a, edge.b, edge.information[(1, 0)], edge.information[(2, 2)]), (0, 1, 1.0, 400.0));
    assert!(file.has_values);
    assert_eq!(file.unknown.into_iter().collect::<Vec<_>>(), [("VERTEX_XY".to_owned(), 1)]);
}

#[test]
fn vertices_come_from_edges_where_there_are_none() {
    let file = read(SPACE).expect("good text");
    let Graph::Space(named) = &file.graph else { panic!("{file:?}") };
    assert_eq!(named.ids, [0, 1, 3]);
    assert!(!file.has_values);
    assert_eq!(named.graph.edges()[0].a_from_b.translation.z, 3.0);
}

#[test]
fn what_is_written_reads_the_same() {
    for text in [PLANE, SPACE] {
        let once = write(&read(text).expect("good text"));
        let again = write(&read(&once).expect("our own text"));
        // Quaternions and angles are normalised on the way: the last digit may turn once.
        let numbers =
            |text: &str| -> Vec<f64> { text.split_whitespace().filter_map(|w| w.parse().ok()).collect() };
        let (a, b) = (numbers(&once), numbers(&again));
        assert_eq!(a.len(), b.len());
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-15 * (1.0 + a.abs())), "{once}\n{again}");
    }
}

#[test]
fn errors_name_the_line_and_the_reason() {
    let vertex = "VERTEX_SE2 0 0 0 0\n";
    let edge = "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1";
    for (text, line, words) in [
        (String::new(), 1, "without an edge"),
        ("VERTEX_SE2 0 0 0\n".into(), 1, "angle is missing"),
        ("VERTEX_SE2 0 0 0 0 0\n".into(), 1, "too many"),
        ("VERTEX_SE2 -1 0 0 0\n".into(), 1, "whole number"),
        ("VERTEX_SE2 0 0 NaN 0\n".into(), 1, "not finite"),
        ("VERTEX_SE2 0 0 1e999 0\n".into(), 1, "not finite"),
        (format!("{vertex}VERTEX_SE2 1 x 0 0\n"), 2, "not a number: x"),
        (format!("{vertex}{vertex}"), 2, "twice"),
        (format!("{vertex}{edge}\n"), 2, "no vertex 1"),
        (format!("{edge}\nFIX 9\n"), 2, "no vertex 9"),
        (format!("{edge}\nFIX\n"), 2, "id is missing"),
        ("EDGE_SE2 0 0 1 0 0 1 0 0 1 0 1\n".into(), 1, "itself"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 -1 0 1\n".into(), 1, "semi-definite"),
        ("EDGE_SE2 0 1 1 0 0 1 5 0 1 0 1\n".into(), 1, "semi-definite"),
        (format!("{edge}\n{SPACE}"), 2, "mixed"),
        ("EDGE_SE3:QUAT 0 1 1 2 3 0 0 0 0 1 0 0 0 0 0 1".into(), 1, "norm 0"),
    ] {
        let error = read(&text).expect_err(&text);
        assert_eq!(error.line, line, "{text}: {error}");
        assert!(error.to_string().contains(words), "{text}: {error}");
    }
}

proptest! {
    #[test]
    fn damaged_text_never_panics(
        cuts in prop::collection::vec((0..400usize, 0..12usize, "[ -~\n]{0,8}"), 0..6),
        space: bool,
    ) {
        let mut text = if space { SPACE } else { PLANE }.as_bytes().to_vec();
        for (at, drop, put) in cuts {
            let at = at.min(text.len());
            let end = (at + drop).min(text.len());
            text.splice(at..end, put.bytes());
        }
        if let Ok(file) = read(&String::from_utf8_lossy(&text)) {
            prop_assert!(read(&write(&file)).is_ok());
        }
    }

    #[test]
    fn any_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = read(&String::from_utf8_lossy(&bytes));
    }
}

#[test]
fn indefinite_information_is_replaced_only_when_asked() {
    let text = "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 1 0 0 1 2 0 1 0 5\n";
    assert_eq!(read(text).expect_err("indefinite").line, 2);
    let file = read_nearest(text).expect("readable");
    assert_eq!(file.replaced, Some(Replaced { edges: 1, first_line: 2 }));
    let Graph::Plane(named) = &file.graph else { panic!("{file:?}") };
    let information = named.graph.edges()[1].information;
    assert!((information[(0, 0)] - 1.5).abs() < 1e-12 && (information[(0, 1)] - 1.5).abs() < 1e-12);
    assert_eq!(read_nearest(PLANE).expect("good text").replaced, None);
}
