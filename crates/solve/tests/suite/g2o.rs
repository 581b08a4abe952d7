//! g2o text: what is right is read and written back; what is wrong is told with its line; nothing panics.

use cairn_geometry::{Se2, Vec2, Vec3};
use cairn_solve::Stop;
use cairn_solve::g2o::{G2o, Graph, Named, Replaced, read, read_nearest, write};
use cairn_solve::graph::{GraphConfig, Metric, lowest_start};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

const PLANE: &str = "\
# a square
VERTEX_SE2 10 0 0 0
VERTEX_SE2 2 1 0.5 1.5
VERTEX_XY 4 1 1
VERTEX_CAMERA 5 1 1

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
    assert_eq!(named.ids, [2, 4, 10]);
    assert_eq!(named.graph.fixed(), [true, false, false]);
    assert_eq!((named.graph.values()[0].translation.y, named.graph.values()[0].rotation.log()), (0.5, 1.5));
    let edge = &named.graph.edges()[0];
    assert_eq!((edge.a, edge.b, edge.information[(1, 0)], edge.information[(2, 2)]), (0, 2, 1.0, 400.0));
    assert!(file.has_values);
    assert_eq!(file.unknown.into_iter().collect::<Vec<_>>(), [("VERTEX_CAMERA".to_owned(), 1)]);
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
    let seen = "VERTEX_SE2 0 0 0 0\nVERTEX_XY 7 0 0\n";
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
        (
            format!("{vertex}TUTORIAL_EDGE_SE2 0 1 2\nODD 1\nODD 2\n"),
            4,
            "ODD (2 lines), TUTORIAL_EDGE_SE2 (1 lines)",
        ),
        (format!("{seen}EDGE_SE2 0 7 1 0 0 1 0 0 1 0 1\n"), 3, "vertex 7 is a point"),
        (format!("{seen}EDGE_SE2_XY 7 0 1 0 1 0 1\n"), 3, "vertex 0 is a pose"),
        ("EDGE_SE3_TRACKXYZ 0 7 1 2 1 3 1 0 0 1 0 1\n".into(), 1, "no PARAMS_SE3OFFSET 1"),
        ("EDGE_SE3_PRIOR 0 0 1 2 3 0 0 0 1 1 0 0\n".into(), 1, "missing"),
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

/// A robot on a circle that sees five points: vertices a little off, measurements with a little noise.
fn circle_with_points() -> String {
    let wave = |k: usize, a: f64| (k as f64 * a + a * a).sin();
    let pose = |k: usize| {
        let a = k as f64 / 12.0 * std::f64::consts::PI;
        Se2::from_xy_angle(5.0 * a.cos(), 5.0 * a.sin(), a + std::f64::consts::FRAC_PI_2)
    };
    let points = [[1.0, 0.0], [6.5, 0.5], [-7.0, 1.0], [0.5, 7.0], [1.0, -8.0]].map(Vec2::from);
    let mut text = String::new();
    for k in 0..24 {
        let (t, a) = (pose(k).translation, pose(k).rotation.log());
        let off = if k == 0 { 0.0 } else { 0.2 };
        let (x, y) = (t.x + off * wave(k, 1.1), t.y + off * wave(k, 1.7));
        text += &format!("VERTEX_SE2 {k} {x} {y} {}\n", a + 0.1 * off * wave(k, 2.3));
    }
    for (j, p) in points.iter().enumerate() {
        text += &format!("VERTEX_XY {} {} {}\n", 100 + j, p.x + 0.3 * wave(j, 0.7), p.y + 0.3 * wave(j, 1.9));
    }
    text += "FIX 0\n";
    for k in 0..23 {
        let step = pose(k).inverse() * pose(k + 1);
        let (t, a) = (step.translation, step.rotation.log());
        let noise = [1.3, 2.9, 3.7].map(|f| 0.15 * wave(k, f));
        let numbers = format!("{} {} {}", t.x + noise[0], t.y + noise[1], a + 0.2 * noise[2]);
        text += &format!("EDGE_SE2 {k} {} {numbers} 400 0 0 400 0 2500\n", k + 1);
        for (j, p) in points.iter().enumerate().filter(|(j, _)| (k + j) % 2 == 0) {
            let seen = pose(k).inverse() * *p;
            let (x, y) = (seen.x + 0.02 * wave(5 * k + j, 0.9), seen.y + 0.02 * wave(5 * k + j, 1.5));
            text += &format!("EDGE_SE2_XY {k} {} {x} {y} 2500 100 900\n", 100 + j);
        }
    }
    text
}

/// The least squares of such a text by dense Gauss-Newton with differences: the last pose.
fn dense_last_pose(text: &str) -> Vec2 {
    let numbers = |line: &str| -> Vec<f64> { line.split(' ').skip(1).map(|w| w.parse().unwrap()).collect() };
    let lines = |tag: &str| -> Vec<Vec<f64>> {
        text.lines().filter(|l| l.split(' ').next() == Some(tag)).map(numbers).collect()
    };
    let (poses, points) = (lines("VERTEX_SE2"), lines("VERTEX_XY"));
    let (steps, seen) = (lines("EDGE_SE2"), lines("EDGE_SE2_XY"));
    let mut x: Vec<f64> = poses.iter().chain(&points).flat_map(|v| v[1..].to_vec()).collect();
    let pose = |x: &[f64], k: f64| {
        let at = 3 * k as usize;
        Se2::from_xy_angle(x[at], x[at + 1], x[at + 2])
    };
    // Whitened by the root of each diagonal, and by a Cholesky factor for points.
    let residuals = |x: &[f64]| {
        let mut r = Vec::new();
        for e in &steps {
            let measured = Se2::from_xy_angle(e[2], e[3], e[4]);
            let error = measured.inverse() * (pose(x, e[0]).inverse() * pose(x, e[1]));
            r.extend([20.0 * error.translation.x, 20.0 * error.translation.y, 50.0 * error.rotation.log()]);
        }
        for e in &seen {
            let at = 3 * poses.len() + 2 * (e[1] as usize - 100);
            let d = pose(x, e[0]).inverse() * Vec2::new(x[at], x[at + 1]) - Vec2::new(e[2], e[3]);
            r.extend([50.0 * d.x + 2.0 * d.y, (900.0f64 - 4.0).sqrt() * d.y]);
        }
        DVector::from_vec(r)
    };
    for _ in 0..20 {
        let r = residuals(&x);
        let mut j = DMatrix::zeros(r.len(), x.len() - 3);
        for c in 3..x.len() {
            let (mut up, mut down) = (x.clone(), x.clone());
            (up[c], down[c]) = (x[c] + 1e-6, x[c] - 1e-6);
            j.set_column(c - 3, &((residuals(&up) - residuals(&down)) / 2e-6));
        }
        let step = (j.transpose() * &j).cholesky().unwrap().solve(&(j.transpose() * r));
        step.iter().enumerate().for_each(|(c, v)| x[c + 3] -= v);
    }
    Vec2::new(x[3 * 23], x[3 * 23 + 1])
}

fn solved(text: &str) -> G2o {
    solved_from(read(text).expect("good text"))
}

fn solved_from(mut file: G2o) -> G2o {
    let report = match &mut file.graph {
        Graph::Plane(named) => named.graph.solve(&GraphConfig::default(), || false),
        Graph::Space(named) => named.graph.solve(&GraphConfig::default(), || false),
    };
    assert_eq!(report.stop, Stop::Converged, "{report:?}");
    file
}

#[test]
fn points_that_were_seen_are_used_as_any_least_squares_uses_them() {
    let text = circle_with_points();
    let file = solved(&text);
    let Graph::Plane(named) = &file.graph else { panic!("{file:?}") };
    assert_eq!((named.points.len(), named.relative, named.parts().len()), (5, 23, 1));
    let last = named.graph.values()[23].translation;
    let batch = dense_last_pose(&text);
    assert!((last - batch).norm() < 1e-6, "{last} by the graph, {batch} by the batch");
    // Without the points the robot is elsewhere.
    let odometry: String = text.lines().filter(|l| !l.contains("XY")).map(|l| format!("{l}\n")).collect();
    let Graph::Plane(alone) = &solved(&odometry).graph.clone() else { panic!() };
    assert!((alone.graph.values()[23].translation - batch).norm() > 1e-3, "as if nothing was seen");
    // What is written is solved already, with the same measurements.
    let again = solved(&write(&file));
    let Graph::Plane(again) = &again.graph else { panic!() };
    assert_eq!(again.graph.edges().len(), named.graph.edges().len());
    assert!((again.graph.values()[23].translation - last).norm() < 1e-9);
}

#[test]
fn points_and_priors_in_space_use_the_offset_of_their_sensor() {
    // A sensor 0.1 m ahead on a robot at (1, -2, 0.5) that is turned to the left saw a point at (2, 1, 3).
    let turned = "1 -2 0.5 0 0 0.7071067811865476 0.7071067811865476";
    let text = format!(
        "EDGE_SE3_TRACKXYZ 7 9 1 2 1 3 70 -10 -40 90 -20 40\nVERTEX_TRACKXYZ 9 0 0 3.5\nVERTEX_SE3:QUAT 7 {turned}\n\
         FIX 7\nPARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\nPARAMS_SE3OFFSET 1 0.1 0 0 0 0 0 1\n"
    );
    let file = solved(&text);
    let Graph::Space(named) = &file.graph else { panic!("{file:?}") };
    let point = named.graph.values()[1].translation;
    assert!((point - Vec3::new(0.0, 0.1, 3.5)).norm() < 1e-9, "{point}");
    let text = write(&file);
    assert!(text.contains("VERTEX_TRACKXYZ 9 ") && text.contains("PARAMS_SE3OFFSET 1 0.1 0 0"), "{text}");
    // The same sensor is known to be in the world where the robot's pose puts it; the robot's vertex is elsewhere.
    let ones = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1";
    let text = format!(
        "VERTEX_SE3:QUAT 7 0 0 0 0 0 0 1\nPARAMS_SE3OFFSET 1 0.1 0 0 0 0 0 1\n\
         EDGE_SE3_PRIOR 7 1 1 -1.9 0.5 0 0 0.7071067811865476 0.7071067811865476 {ones}\n"
    );
    let Graph::Space(named) = &solved(&text).graph.clone() else { panic!() };
    let robot = named.graph.values()[0];
    assert!((robot.translation - Vec3::new(1.0, -2.0, 0.5)).norm() < 1e-9, "{robot:?}");
    assert!((robot.rotation.angle() - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
}

#[test]
fn what_is_known_in_the_world_weighs_as_it_says() {
    // Odometry says 0, the world says 1 with three times the information.
    for prior in [
        "EDGE_SE2_PRIOR 1 1 0 0 3 0 0 3 0 3",
        "EDGE_PRIOR_SE2 1 1 0 0 3 0 0 3 0 3",
        "EDGE_PRIOR_SE2_XY 1 1 0 3 0 3",
    ] {
        let text = format!(
            "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 0 0 0\nFIX 0\nEDGE_SE2 0 1 0 0 0 1 0 0 1 0 1e9\n{prior}\n"
        );
        let file = solved(&text);
        let Graph::Plane(named) = &file.graph else { panic!("{file:?}") };
        assert!((named.graph.values()[1].translation - Vec2::new(0.75, 0.0)).norm() < 1e-6, "{prior}");
        assert_eq!((named.priors, named.ids.len(), named.parts().len()), (1, 2, 1));
        assert!(write(&file).ends_with(&format!("{prior}\n")));
    }
    let ones = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1e9 0 0 1e9 0 1e9";
    let text = format!(
        "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 0 0 0 0 0 0 1\nFIX 0\nEDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 {ones}\n\
         PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\nEDGE_SE3_XYZPRIOR 1 0 0 1 0 3 0 0 3 0 3\n"
    );
    let Graph::Space(named) = &solved(&text).graph.clone() else { panic!() };
    assert!((named.graph.values()[1].translation - Vec3::new(0.0, 0.75, 0.0)).norm() < 1e-6);
}

#[test]
fn parts_are_counted_and_laid_apart() {
    let ring = |from: usize| -> String {
        let edge = |k: usize| {
            format!("EDGE_SE2 {} {} 1 0 1.5707963267948966 100 0 0 100 0 400\n", from + k, from + (k + 1) % 4)
        };
        (0..4).map(edge).collect()
    };
    let parts = |text: &str| match read(text).expect("good text").graph {
        Graph::Plane(named) => named.parts().len(),
        Graph::Space(named) => named.parts().len(),
    };
    let two = ring(0) + &ring(10);
    assert_eq!((parts(&ring(0)), parts(&two)), (1, 2));
    assert_eq!(parts(&format!("{two}EDGE_SE2 3 10 1 0 0 0 0 0 0 0 0\n")), 2, "an edge without information");
    assert_eq!(parts(&format!("{two}EDGE_SE2 3 10 1 0 0 1 0 0 1 0 1\n")), 1);
    assert_eq!(parts(&format!("{two}FIX 0\n")), 2);
    assert_eq!(parts(&format!("{two}FIX 0 10\n")), 1, "both are in the world");
    let mut file = read(&two).expect("good text");
    let Graph::Plane(named) = &mut file.graph else { panic!() };
    assert!(lowest_start(&mut named.graph, false, Metric::Geodesic)[0].cost < 1e-9);
    let gap = |named: &Named<Se2, 3>| {
        let x = |k: usize| named.graph.values()[k].translation.x;
        (4..8).map(x).fold(f64::INFINITY, f64::min) - (0..4).map(x).fold(f64::NEG_INFINITY, f64::max)
    };
    assert!(gap(named) < 0.0, "on one spot");
    named.lay_apart();
    assert!(gap(named) >= 1.0, "{}", gap(named));
    assert!(named.graph.cost(Metric::Geodesic) < 1e-9, "within a part nothing moved");
}

/// A square of a metre, walked to the left; the last edge closes it.
const SQUARE: [(u64, u64); 4] = [(0, 1), (1, 2), (2, 3), (3, 0)];

fn positions(text: &str) -> Vec<Vec2> {
    let mut file = read(text).expect("good text");
    let has_values = file.has_values;
    match &mut file.graph {
        Graph::Plane(named) => drop(lowest_start(&mut named.graph, has_values, Metric::Geodesic)),
        Graph::Space(named) => drop(lowest_start(&mut named.graph, has_values, Metric::Geodesic)),
    }
    match solved_from(file).graph {
        Graph::Plane(named) => named.graph.values().iter().map(|v| v.translation).collect(),
        Graph::Space(named) => named.graph.values().iter().map(|v| v.translation.xy()).collect(),
    }
}

#[test]
fn graphs_of_toro_and_isam_are_those_of_g2o() {
    let quarter = std::f64::consts::FRAC_PI_2;
    let edges = |tag: &str, step: String, swapped: bool| -> String {
        let ends = |(a, b): (u64, u64)| if swapped { (b, a) } else { (a, b) };
        SQUARE.map(ends).iter().map(|(a, b)| format!("{tag} {a} {b} {step}\n")).collect()
    };
    let corners = [(0.0, 0.0, 0.0), (1.1, 0.0, 1.5), (1.0, 1.1, 3.1), (0.1, 0.9, -1.6)];
    let vertices = |tag: &str, z: &str| -> String {
        let line = |(k, (x, y, angle)): (usize, &(f64, f64, f64))| format!("{tag} {k} {x} {y} {z}{angle}\n");
        corners.iter().enumerate().map(line).collect()
    };
    let of_g2o = edges("EDGE_SE2", format!("1 0 {quarter} 4 0 0 9 0 25"), false);
    let wanted = positions(&of_g2o);
    assert!((wanted[2] - Vec2::new(1.0, 1.0)).norm() < 1e-9, "{wanted:?}");
    let in_space = format!("1 0 0 0 0 {quarter}");
    for (name, text) in [
        ("TORO", vertices("VERTEX2", "") + &edges("EDGE2", format!("1 0 {quarter} 4 0 9 25 0 0"), false)),
        (
            "observed first",
            vertices("VERTEX2", "") + &edges("EDGE2", format!("1 0 {quarter} 4 0 9 25 0 0"), true),
        ),
        ("iSAM", edges("ODOMETRY", format!("1 0 {quarter} 2 0 0 3 0 5"), false)),
        ("without information", edges("EDGE2", format!("1 0 {quarter}"), false)),
        ("TORO in space", vertices("VERTEX3", "0 0 0 ") + &edges("EDGE3", in_space.clone(), false)),
        ("iSAM in space", edges("EDGE3", in_space + " 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 2 0 0 2 0 3", false)),
    ] {
        let found = positions(&text);
        assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).norm() < 1e-6), "{name}: {found:?}");
        assert!(read(&write(&read(&text).expect(name))).is_ok(), "{name} as g2o");
    }
}

#[test]
fn numbers_of_toro_and_isam_are_the_information_that_they_mean() {
    let information = |text: &str| match read(text).expect("a graph").graph {
        Graph::Plane(named) => DMatrix::from_fn(3, 3, |r, c| named.graph.edges()[0].information[(r, c)]),
        Graph::Space(named) => DMatrix::from_fn(6, 6, |r, c| named.graph.edges()[0].information[(r, c)]),
    };
    let plane = DMatrix::from_row_slice(3, 3, &[4.0, 0.5, 0.1, 0.5, 9.0, 0.2, 0.1, 0.2, 25.0]);
    // TORO: 11, 12, 22, 33, 13, 23.
    let toro = information("VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1 0 0 4 0.5 9 25 0.1 0.2\n");
    assert!((&toro - &plane).amax() < 1e-12, "{toro}");
    let rows = information("EDGE2 0 1 1 0 0 44.7 0 0 44.7 0 30.9\n");
    assert!((rows[(1, 1)] - 44.7).abs() + (rows[(2, 2)] - 30.9).abs() < 1e-12, "{rows}");
    // iSAM: the upper half of a square root.
    let isam = information("ODOMETRY 0 1 1 0 0 2 1 0 3 0 5\n");
    let root = DMatrix::from_row_slice(3, 3, &[2.0, 1.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 5.0]);
    assert!((&isam - root.transpose() * &root).amax() < 1e-12, "{isam}");
    // Information of roll, pitch and yaw, as that of a rotation vector of the second pose: with a pitch of 60 degrees, yaw about
    // the vertical is half about z and the rest about x.
    let edge =
        format!("EDGE3 0 1 0 0 0 0 {} 0 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n", 60f64.to_radians());
    let space = information(&edge);
    let rates = nalgebra::Matrix3::new(1.0, 0.0, -0.75f64.sqrt(), 0.0, 1.0, 0.0, 0.0, 0.0, 0.5);
    let inverse = rates.try_inverse().expect("regular");
    let wanted = inverse.transpose() * inverse;
    assert!((space.view((3, 3), (3, 3)) - wanted).amax() < 1e-9, "{space}");
}

#[test]
fn points_of_isam_have_numbers_of_their_own() {
    let file = read("ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\nLANDMARK 0 1 2 1 10 0 10\nLANDMARK 1 1 1 1 10 0 10\n")
        .expect("a graph");
    let Graph::Plane(named) = &file.graph else { panic!("{file:?}") };
    assert_eq!((named.graph.values().len(), named.points.len()), (3, 1));
    for (text, line, why) in [
        ("EDGE2 0 1 1 0 0 1 2\n", 1, "needs 3 or 9 numbers"),
        ("VERTEX2 0 0 0 0\nVERTEX2 1 0 0\n", 2, "needs 3 numbers"),
        ("EDGE2 0 1 1 0 nan\n", 1, "not finite"),
        ("EDGE3 0 1 0 0 0 0 1.5707963267948966 0\n", 1, "pitch of 90 degrees"),
    ] {
        let error = read(text).expect_err(text);
        assert!(error.line == line && error.reason.contains(why), "{text}: {error}");
    }
}
