//! Cleaning: detours are removed, unwalked ground is never crossed, and the result lies where somebody walked.

use cairn_geometry::Vec3;
use cairn_guide::{CleanConfig, CleanedRoute, Ground, clean_line, largest_distance, length};
use cairn_random::Random;
use proptest::prelude::*;

type Line = Vec<(Vec3, bool)>;

/// A line through corners with a point every 5 cm, swaying a little as people do.
fn walk(corners: &[[f64; 3]], sway: f64, seed: u64) -> Line {
    let mut random = Random::new(seed);
    let mut line: Line = Vec::new();
    let mut wave = 0.0;
    for w in corners.windows(2) {
        let (a, b) = (Vec3::from(w[0]), Vec3::from(w[1]));
        let steps = ((b - a).norm() / 0.05).ceil() as usize;
        let side = (b - a).cross(&Vec3::z());
        let side = if side.norm() > 0.0 { side.normalize() } else { Vec3::zeros() };
        for k in 0..steps {
            wave += random.uniform(0.0, 0.08);
            line.push((a + (b - a) * (k as f64 / steps as f64) + side * (sway * f64::sin(wave)), false));
        }
    }
    line.extend(corners.last().map(|c| (Vec3::from(*c), false)));
    line
}

fn points(line: &Line) -> Vec<Vec3> {
    line.iter().map(|p| p.0).collect()
}

fn cleaned(line: &Line) -> CleanedRoute {
    clean_line(line, line, &Ground::z_up(), &CleanConfig::default())
}

fn again(route: &CleanedRoute, record: &Line) -> CleanedRoute {
    let line: Line = route.points.iter().copied().zip(route.gap_before.iter().copied()).collect();
    clean_line(&line, record, &Ground::z_up(), &CleanConfig::default())
}

#[test]
fn removes_loop_spur_oscillation_and_hub() {
    let cases: [(&str, &[[f64; 3]], f64); 4] = [
        (
            "loop",
            &[[0., 0., 0.], [10., 0., 0.], [10., 8., 0.], [4., 8., 0.], [4., -5., 0.], [4., -12., 0.]],
            16.0,
        ),
        ("spur", &[[0., 0., 0.], [10., 0., 0.], [10., 9., 0.], [10., 0., 0.], [20., 0., 0.]], 20.0),
        (
            "oscillation",
            &[[0., 0., 0.], [9., 0., 0.], [3., 0., 0.], [9., 0., 0.], [2., 0., 0.], [15., 0., 0.]],
            15.0,
        ),
        (
            "hub",
            &[
                [0., 0., 0.],
                [5., 0., 0.],
                [5., 6., 0.],
                [5., 0., 0.],
                [9., 5., 0.],
                [5., 0., 0.],
                [5., -7., 0.],
                [5., 0., 0.],
                [12., 0., 0.],
            ],
            12.0,
        ),
    ];
    for (name, corners, expected) in cases {
        for sway in [0.0, 0.12] {
            let line = walk(corners, sway, 3);
            let route = cleaned(&line);
            assert!(
                (route.after_m - expected).abs() < 0.05 * expected,
                "{name}: {} m, expected {expected}",
                route.after_m
            );
            assert!(!route.cuts.is_empty() && route.before_m > route.after_m + 1.0);
        }
    }
}

#[test]
fn unwalked_ground_is_not_crossed() {
    // Round a wall: the two sides are 0.9 m apart, inside the corridor's metre, but nobody went through.
    let line = walk(&[[0., 0., 0.], [12., 0., 0.], [12., 0.9, 0.], [0., 0.9, 0.]], 0.0, 1);
    let route = cleaned(&line);
    assert!(route.cuts.is_empty(), "{:?}", route.cuts);
    assert!((route.after_m - route.before_m).abs() < 0.5);
    // The same with a third pass through the middle is walked ground.
    let through = walk(&[[0., 0., 0.], [12., 0., 0.], [12., 0.9, 0.], [6., 0.9, 0.], [6., -3., 0.]], 0.0, 1);
    assert!((cleaned(&through).after_m - 9.0).abs() < 0.5);
}

#[test]
fn floors_are_not_joined() {
    // Up a flight of stairs and over the place where the walk began.
    let line =
        walk(&[[0., 0., 0.], [8., 0., 0.], [8., 4., 3.], [0., 4., 3.], [0., 0., 3.], [6., 0., 3.]], 0.0, 1);
    let route = cleaned(&line);
    assert!(route.cuts.is_empty());
    assert!(route.after_m > 0.95 * route.before_m);
}

#[test]
fn gaps_stay_gaps() {
    let mut line = walk(&[[0., 0., 0.], [5., 0., 0.]], 0.0, 1);
    let mut rest = walk(&[[9., 0., 0.], [9., 6., 0.], [7., 6., 0.], [7., -4., 0.]], 0.0, 1);
    rest[0].1 = true;
    line.extend(rest);
    let route = cleaned(&line);
    // The last leg crosses the gap at (7, 0): no one is known to have walked there, so no joint.
    assert!(route.cuts.is_empty(), "{:?}", route.cuts);
    assert_eq!(route.gap_before.iter().filter(|g| **g).count(), 1);
}

#[test]
fn degenerate_lines_are_handled() {
    for n in 0..3 {
        let line: Line = (0..n).map(|k| (Vec3::new(k as f64 * 0.01, 0.0, 0.0), false)).collect();
        assert!(cleaned(&line).points.len() <= n);
    }
    let still: Line = vec![(Vec3::x(), false); 50];
    assert_eq!(cleaned(&still).after_m, 0.0);
}

/// A staircase-shaped route, x then y, with a detour on each leg along x, and the length of the route without detours.
/// Detours take `share` of the total length; they lie on the free side, so that none of them creates a short cut.
fn with_detours() -> impl Strategy<Value = (Line, f64, f64)> {
    let legs = proptest::collection::vec((6.0..9.0f64, 3.0..6.0f64, 0..4usize), 2..5);
    (legs, 0.56..0.89f64, 0.0..0.12f64, 0.0..6.2f64, any::<u64>()).prop_map(
        |(legs, share, sway, angle, seed)| {
            let direct: f64 = legs.iter().map(|(x, y, _)| x + y).sum();
            // Metres of each detour.
            let each = direct * share / (1.0 - share) / legs.len() as f64;
            let mut at = [0.0, 0.0];
            let mut corners = vec![at];
            for (x, y, kind) in legs {
                let fork = [at[0] + 2.5, at[1]];
                let mut visit = |dx: f64, dy: f64| corners.push([fork[0] + dx, fork[1] + dy]);
                visit(0.0, 0.0);
                match kind {
                    // A loop, a spur, an oscillation, a hub with three spokes.
                    0 => [(0.0, 1.5 - each / 2.0), (1.5, 1.5 - each / 2.0), (1.5, 0.0), (0.0, 0.0)]
                        .iter()
                        .for_each(|(dx, dy)| visit(*dx, *dy)),
                    1 => [-each / 2.0, 0.0].iter().for_each(|dy| visit(0.0, *dy)),
                    2 => {
                        let rounds = (each / 4.0).ceil();
                        let back = -each / (2.0 * rounds);
                        (0..rounds as usize).for_each(|_| [back, 0.0].iter().for_each(|dx| visit(*dx, 0.0)));
                    }
                    _ => [-1.0, 0.0, 1.0].iter().for_each(|side| {
                        let dx: f64 = side * (each / 12.0).min(1.2);
                        visit(dx, -((each / 6.0).powi(2) - dx * dx).sqrt());
                        visit(0.0, 0.0);
                    }),
                }
                at = [at[0] + x, at[1]];
                corners.push(at);
                at = [at[0], at[1] + y];
                corners.push(at);
            }
            let (s, c) = angle.sin_cos();
            let turned: Vec<[f64; 3]> =
                corners.iter().map(|[x, y]| [c * x - s * y, s * x + c * y, 0.0]).collect();
            (walk(&turned, sway, seed), direct, share)
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    #[test]
    fn removes_exactly_the_detours((line, direct, share) in with_detours()) {
        let route = cleaned(&line);
        prop_assert!(!route.cuts.is_empty());
        prop_assert!((route.after_m - direct).abs() <= 0.05 * direct + 0.5, "{} of {direct} m", route.after_m);
        let shorter = 1.0 - route.after_m / route.before_m;
        prop_assert!((0.55..=0.90).contains(&shorter) && (shorter - share).abs() < 0.04, "{shorter} of {share}");
        prop_assert!(largest_distance(&route.points, &points(&line)) <= 0.30 + 0.01);
        for cut in route.cuts {
            prop_assert!(largest_distance(&[cut.from, cut.to], &points(&line)) <= 0.30 + 0.01);
        }
    }
}

/// Corners of a random walk that often returns: to places it visited, along legs it came by.
fn wandering() -> impl Strategy<Value = Line> {
    (proptest::collection::vec((-8.0..8.0f64, -8.0..8.0f64, 0..4usize), 2..9), 0.0..0.15f64, any::<u64>())
        .prop_map(|(steps, sway, seed)| {
            let mut corners = vec![[0.0, 0.0, 0.0]];
            for (x, y, kind) in steps {
                let last = corners[corners.len() - 1];
                let next = match kind {
                    0 if corners.len() > 2 => corners[corners.len() - 2],
                    1 => [0.0, 0.0, 0.0],
                    _ => [last[0] + x, last[1] + y, 0.0],
                };
                if (Vec3::from(next) - Vec3::from(last)).norm() > 0.3 {
                    corners.push(next);
                }
            }
            corners.push([12.0, 3.0, 0.0]);
            walk(&corners, sway, seed)
        })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    #[test]
    fn result_stays_within_tolerance_of_the_recording(line in wandering()) {
        let route = cleaned(&line);
        // Half of one 5 cm sampling step is allowed for, in the cleaning's own check and in this one.
        prop_assert!(largest_distance(&route.points, &points(&line)) <= 0.30 + 0.01);
    }

    #[test]
    fn keeps_end_points_and_never_lengthens(line in wandering()) {
        let route = cleaned(&line);
        prop_assert_eq!(route.points[0], line[0].0);
        prop_assert_eq!(route.points[route.points.len() - 1], line[line.len() - 1].0);
        prop_assert!(route.after_m <= length(points(&line).into_iter()) + 1e-9);
        let kept: f64 = route.cuts.iter().map(|c| c.saved_m).sum();
        prop_assert!(route.cuts.is_empty() || kept >= 1.0);
    }

    #[test]
    fn cuts_cross_only_walked_ground(line in wandering()) {
        for cut in cleaned(&line).cuts {
            prop_assert!((cut.to - cut.from).norm() <= 1.0);
            prop_assert!(largest_distance(&[cut.from, cut.to], &points(&line)) <= 0.30 + 0.01);
        }
    }

    #[test]
    fn cleaning_is_idempotent(line in wandering()) {
        let once = cleaned(&line);
        let twice = again(&once, &line);
        prop_assert_eq!(twice.points, once.points);
        prop_assert!(twice.cuts.is_empty());
    }

    #[test]
    fn inserted_loop_is_removed(at in 3.0..9.0f64, wide in 2.0..6.0f64, long in 2.0..6.0f64, left in any::<bool>()) {
        let s = if left { 1.0 } else { -1.0 };
        let plain = walk(&[[0., 0., 0.], [12., 0., 0.]], 0.0, 1);
        let looped = walk(
            &[[0., 0., 0.], [at + long, 0., 0.], [at + long, s * wide, 0.], [at, s * wide, 0.], [at, -0.1 * s, 0.], [at + 0.3, 0.0, 0.], [at + long, 0., 0.], [14., 0., 0.]],
            0.0,
            1,
        );
        let route = cleaned(&looped);
        prop_assert!(route.after_m < 14.5, "{} m", route.after_m);
        prop_assert!(cleaned(&plain).cuts.is_empty());
    }
}
