//! Every search compared with a simple reference on thousands of random grids, and on the Moving AI benchmarks.

use cairn_plan::search::{
    AStar, BLOCKED, DStarLite, GridPath, JumpPoint, LazyTheta, NoPath, Place, WeightedAStar, free_cell,
    line_of_sight,
};
use cairn_plan::{Cell, DistanceField, Grid, GridFrame, Passable, moving_ai};
use cairn_random::Random;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::path::PathBuf;

/// Folder of the recordings, if it exists.
fn data() -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let data = std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    let found = data.join("grids").is_dir().then_some(data);
    if found.is_none() {
        println!("skipped: no folder `grids` among the recordings (CAIRN_DATA)");
    }
    found
}

/// Dijkstra in floating point, checking every step by its definition: the least weighted length from `start` to every
/// cell, infinite where no path leads. Written for simplicity.
fn dijkstra(costs: &Grid<u8>, start: Cell) -> Vec<f64> {
    let frame = costs.frame();
    let (w, h) = (frame.width() as i32, frame.height() as i32);
    let cost = |x: i32, y: i32| match x >= 0 && y >= 0 && x < w && y < h {
        true => costs.get(Cell::new(x as u32, y as u32)).filter(|&c| c != BLOCKED),
        false => None,
    };
    let mut best = vec![f64::INFINITY; frame.len()];
    let mut queue = BinaryHeap::from([(Reverse(0u64), (start.x as i32, start.y as i32))]);
    best[frame.index(start).unwrap()] = 0.0;
    while let Some((Reverse(bits), (x, y))) = queue.pop() {
        let here = f64::from_bits(bits);
        if here > best[(y * w + x) as usize] {
            continue;
        }
        for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|&d| d != (0, 0)) {
            let (Some(a), Some(b)) = (cost(x, y), cost(x + dx, y + dy)) else { continue };
            if cost(x + dx, y).is_none() || cost(x, y + dy).is_none() {
                continue;
            }
            let there = here + f64::from(dx * dx + dy * dy).sqrt() * 0.5 * (f64::from(a) + f64::from(b));
            let place = &mut best[((y + dy) * w + x + dx) as usize];
            if there < *place - 1e-12 {
                *place = there;
                queue.push((Reverse(there.to_bits()), (x + dx, y + dy)));
            }
        }
    }
    best
}

/// A random grid of one of several kinds: noise, rooms, long walls.
fn random_grid(random: &mut Random) -> Grid<bool> {
    let (w, h) = (1 + random.below(140), 1 + random.below(90));
    let mut grid = Grid::filled(GridFrame::unit(w, h).unwrap(), true);
    let noise = [0.0, 0.05, 0.2, 0.35, 0.5][random.below(5)];
    grid.values_mut().iter_mut().for_each(|v| *v = !random.chance(noise));
    for _ in 0..random.below(15) {
        let (x, y, long) = (random.below(w), random.below(h), 1 + random.below(60));
        let along_x = random.chance(0.5);
        for k in 0..long {
            let at = if along_x { (x + k, y) } else { (x, y + k) };
            grid.set(Cell::new(at.0 as u32, at.1 as u32), random.chance(0.03));
        }
    }
    grid
}

fn some_free(random: &mut Random, grid: &Grid<bool>) -> Option<Cell> {
    (0..60).map(|_| grid.frame().cell(random.below(grid.frame().len()))).find(|&c| grid.get(c) == Some(true))
}

/// Asserts that a path leads from start to goal over free neighbours and cuts no corner.
fn assert_sound(passable: &Passable, path: &GridPath, start: Cell, goal: Cell) {
    assert_eq!((path.cells.first(), path.cells.last()), (Some(&start), Some(&goal)));
    assert!(path.cells.iter().all(|&c| passable.is_free(c)));
    for pair in path.cells.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        assert!(a.x.abs_diff(b.x).max(a.y.abs_diff(b.y)) == 1, "{a:?} to {b:?} is no step");
        assert!(
            passable.is_free(Cell::new(a.x, b.y)) && passable.is_free(Cell::new(b.x, a.y)),
            "a corner was cut"
        );
    }
}

#[test]
fn a_star_and_jump_points_are_as_short_as_dijkstra() {
    let mut random = Random::new(11);
    let (mut astar, mut jump) = (AStar::new(), JumpPoint::new());
    let (mut found, mut none) = (0, 0);
    for _ in 0..1500 {
        let grid = random_grid(&mut random);
        let passable = Passable::new(&grid);
        let Some(start) = some_free(&mut random, &grid) else { continue };
        let truth = dijkstra(&grid.map(|free| if free { 1 } else { BLOCKED }), start);
        for _ in 0..4 {
            let Some(goal) = some_free(&mut random, &grid) else { continue };
            let least = truth[grid.frame().index(goal).unwrap()];
            for path in [astar.search(&passable, start, goal), jump.search(&passable, start, goal)] {
                match path {
                    Ok(path) => {
                        assert_sound(&passable, &path, start, goal);
                        assert!((path.length - least).abs() < 1e-9, "{} instead of {least}", path.length);
                        found += 1;
                    }
                    Err(reason) => {
                        assert!(
                            matches!(reason, NoPath::Unreachable { .. }) && least.is_infinite(),
                            "{reason}"
                        );
                        none += 1;
                    }
                }
            }
        }
    }
    assert!(found > 4000 && none > 500, "{found} found and {none} not: the grids test too little");
}

#[test]
fn weighted_a_star_is_as_cheap_as_dijkstra() {
    let mut random = Random::new(12);
    let mut search = WeightedAStar::new();
    for _ in 0..300 {
        let grid = random_grid(&mut random);
        let greatest = [2, 10, 254][random.below(3)];
        let costs = grid.map(|free| if free { 1 + random.below(greatest) as u8 } else { BLOCKED });
        let Some(start) = some_free(&mut random, &grid) else { continue };
        let truth = dijkstra(&costs, start);
        for _ in 0..3 {
            let Some(goal) = some_free(&mut random, &grid) else { continue };
            let least = truth[grid.frame().index(goal).unwrap()];
            match search.search(&costs, start, goal) {
                Ok(path) => {
                    assert_sound(&Passable::new(&grid), &path, start, goal);
                    assert!(
                        (path.cost - least).abs() < 1e-6 * least.max(1.0),
                        "{} instead of {least}",
                        path.cost
                    );
                }
                Err(reason) => assert!(least.is_infinite(), "{reason}"),
            }
        }
    }
}

#[test]
fn lazy_theta_sees_along_its_path_and_is_no_longer_than_a_star() {
    let mut random = Random::new(13);
    let (mut theta, mut astar) = (LazyTheta::new(), AStar::new());
    let (mut shorter, mut sum, mut grid_sum) = (0, 0.0, 0.0);
    for _ in 0..3000 {
        let grid = random_grid(&mut random);
        let passable = Passable::new(&grid);
        let (Some(start), Some(goal)) = (some_free(&mut random, &grid), some_free(&mut random, &grid)) else {
            continue;
        };
        match (theta.search(&passable, start, goal), astar.search(&passable, start, goal)) {
            (Ok(any), Ok(grid)) => {
                assert_eq!((any.cells.first(), any.cells.last()), (Some(&start), Some(&goal)));
                assert!(any.cells.windows(2).all(|w| line_of_sight(&passable, w[0], w[1])));
                assert!(any.length <= grid.length + 1e-9, "{} > {}", any.length, grid.length);
                shorter += usize::from(any.length < grid.length - 1e-9);
                sum += any.length;
                grid_sum += grid.length;
            }
            (any, grid) => assert_eq!(any.is_err(), grid.is_err()),
        }
    }
    assert!(shorter > 1000 && sum < 0.98 * grid_sum, "{shorter} shorter, {sum} of {grid_sum} cells");
}

/// Whether the segment between the centres of two cells touches the closed square of a third one, in whole numbers (half cells).
fn touches(a: Cell, b: Cell, square: Cell) -> bool {
    let double = |c: Cell| (2 * i64::from(c.x), 2 * i64::from(c.y));
    let ((ax, ay), (bx, by), (x, y)) = (double(a), double(b), double(square));
    let (ax, ay, bx, by) = (ax + 1, ay + 1, bx + 1, by + 1);
    let apart = |a: i64, b: i64, from: i64| a.max(b) < from || a.min(b) > from + 2;
    let side = |x: i64, y: i64| ((bx - ax) * (y - ay) - (by - ay) * (x - ax)).signum();
    let corners = [side(x, y), side(x + 2, y), side(x, y + 2), side(x + 2, y + 2)];
    let beside = corners.iter().all(|&s| s > 0) || corners.iter().all(|&s| s < 0);
    !apart(ax, bx, x) && !apart(ay, by, y) && !beside
}

#[test]
fn line_of_sight_is_exactly_over_the_cells_that_the_line_touches() {
    let mut random = Random::new(14);
    let (mut seen_lines, mut blocked_lines) = (0, 0);
    for _ in 0..800 {
        let grid = random_grid(&mut random);
        let passable = Passable::new(&grid);
        let (Some(a), Some(b)) = (some_free(&mut random, &grid), some_free(&mut random, &grid)) else {
            continue;
        };
        let (from, to) = (Cell::new(a.x.min(b.x), a.y.min(b.y)), Cell::new(a.x.max(b.x), a.y.max(b.y)));
        let around = (from.y..=to.y).flat_map(|y| (from.x..=to.x).map(move |x| Cell::new(x, y)));
        let free = around.filter(|&c| touches(a, b, c)).all(|c| passable.is_free(c));
        assert_eq!(line_of_sight(&passable, a, b), free, "{a:?} {b:?}");
        assert_eq!(line_of_sight(&passable, b, a), free, "{b:?} {a:?}");
        (seen_lines, blocked_lines) = (seen_lines + usize::from(free), blocked_lines + usize::from(!free));
    }
    assert!(seen_lines > 100 && blocked_lines > 100, "{seen_lines} free, {blocked_lines} blocked");
}

#[test]
fn d_star_lite_stays_as_short_as_searching_again() {
    let mut random = Random::new(15);
    let mut astar = AStar::new();
    let (mut mended, mut again, mut paths, mut reasons) = (0, 0, 0, 0);
    for _ in 0..150 {
        let mut grid = random_grid(&mut random);
        let (Some(mut start), Some(goal)) = (some_free(&mut random, &grid), some_free(&mut random, &grid))
        else {
            continue;
        };
        let mut search = DStarLite::new(Passable::new(&grid), start, goal).unwrap();
        let first = search.path();
        for _ in 0..12 {
            let cells = 1 + random.below(8);
            let change: Vec<(Cell, bool)> = (0..cells)
                .map(|_| (grid.frame().cell(random.below(grid.frame().len())), random.chance(0.5)))
                .collect();
            // Now and then an end closes, and opens again later.
            let ends = [start, goal].map(|c| (c, random.chance(0.8)));
            let change: Vec<(Cell, bool)> = change.into_iter().chain(ends).collect();
            change.iter().for_each(|&(c, free)| {
                grid.set(c, free);
            });
            search.change(&change);
            let passable = Passable::new(&grid);
            match (search.path(), astar.search(&passable, start, goal)) {
                (Ok(path), Ok(truth)) => {
                    assert_sound(&passable, &path, start, goal);
                    assert!(
                        (path.length - truth.length).abs() < 1e-9,
                        "{} not {}",
                        path.length,
                        truth.length
                    );
                    (mended, again, paths) = (mended + path.expanded, again + truth.expanded, paths + 1);
                    start = path.cells[random.below(path.cells.len().min(4))];
                    search.move_start(start).unwrap();
                }
                (Err(mine), Err(truth)) => {
                    let without_count = |e| match e {
                        NoPath::Unreachable { .. } => NoPath::Unreachable { expanded: 0 },
                        other => other,
                    };
                    assert_eq!(without_count(mine), without_count(truth));
                    reasons += 1;
                }
                (mine, truth) => panic!("{mine:?} {truth:?} after {first:?}"),
            }
        }
    }
    assert!(paths > 500 && reasons > 200, "{paths} paths, {reasons} reasons");
    println!("{paths} paths: {mended} expanded for mending, {again} for searching again");
}

#[test]
fn every_moving_ai_scenario_at_its_optimal_length() {
    let Some(data) = data() else { return };
    let (mut astar, mut jump, mut count) = (AStar::new(), JumpPoint::new(), 0);
    for name in ["maze-100-1.map", "room-100-10.map"] {
        let text = std::fs::read_to_string(data.join("grids").join(name)).unwrap();
        let map = moving_ai::read_map(&text).unwrap();
        let passable = Passable::new(&map);
        let text = std::fs::read_to_string(data.join("grids").join(format!("{name}.scen"))).unwrap();
        for task in moving_ai::read_scenarios(&text).unwrap() {
            assert_eq!((task.map.as_str(), task.size), (name, (map.frame().width(), map.frame().height())));
            for path in [
                astar.search(&passable, task.start, task.goal).unwrap(),
                jump.search(&passable, task.start, task.goal).unwrap(),
            ] {
                assert_sound(&passable, &path, task.start, task.goal);
                // The lengths in the files are rounded to six digits.
                let rounding = 0.5 * 10f64.powf(task.optimal_length.max(1.0).log10().floor() - 5.0);
                let off = (path.length - task.optimal_length).abs();
                assert!(
                    off <= 1e-6_f64.max(rounding * 1.0001),
                    "{} not {}",
                    path.length,
                    task.optimal_length
                );
            }
            count += 1;
        }
    }
    assert_eq!(count, 2850);
}

#[test]
fn every_moving_ai_map_is_searched_alike() {
    let Some(data) = data() else { return };
    let (mut astar, mut jump, mut random, mut found) = (AStar::new(), JumpPoint::new(), Random::new(8), 0);
    for name in ["Berlin_1_256", "den312d", "maze-128-128-2", "room-64-64-8", "warehouse-10-20-10-2-1"] {
        let text = std::fs::read_to_string(data.join("grids").join(format!("{name}.map"))).unwrap();
        let map = moving_ai::read_map(&text).unwrap();
        let (passable, costs) = (Passable::new(&map), map.map(|free| if free { 1 } else { BLOCKED }));
        for _ in 0..4 {
            let Some(start) = some_free(&mut random, &map) else { continue };
            let truth = dijkstra(&costs, start);
            for _ in 0..20 {
                let Some(goal) = some_free(&mut random, &map) else { continue };
                let least = truth[map.frame().index(goal).unwrap()];
                for path in [astar.search(&passable, start, goal), jump.search(&passable, start, goal)] {
                    match path {
                        Ok(path) => {
                            assert_sound(&passable, &path, start, goal);
                            assert!(
                                (path.length - least).abs() < 1e-9,
                                "{name}: {} not {least}",
                                path.length
                            );
                            found += 1;
                        }
                        Err(reason) => assert!(least.is_infinite(), "{name}: {reason}"),
                    }
                }
            }
        }
    }
    assert!(found > 500, "{found}");
}

#[test]
fn thousands_of_searches_do_not_see_each_other() {
    // More searches than the stamps of the packed words can count.
    let mut grid = Grid::filled(GridFrame::unit(9, 9).unwrap(), true);
    (0..8).for_each(|y| assert!(grid.set(Cell::new(4, y), false)));
    let passable = Passable::new(&grid);
    let (mut astar, mut jump) = (AStar::new(), JumpPoint::new());
    let mut random = Random::new(5);
    for _ in 0..6000 {
        let start = Cell::new(random.below(4) as u32, random.below(8) as u32);
        let goal = Cell::new(5 + random.below(4) as u32, random.below(8) as u32);
        let [a, b] =
            [astar.search(&passable, start, goal), jump.search(&passable, start, goal)].map(Result::unwrap);
        assert_sound(&passable, &a, start, goal);
        assert!((a.length - b.length).abs() < 1e-9, "{start:?} {goal:?}");
    }
}

#[test]
fn willow_doubled_and_inflated() {
    let Some(data) = data() else { return };
    let file = data.join("grids/willow-2010-02-18-0.10.yaml");
    let (map, description) = cairn_plan::map_server::load(&file).unwrap();
    let count = |value: i8| map.values().iter().filter(|&&v| v == value).count();
    assert_eq!((map.frame().width(), map.frame().height(), description.resolution_m), (566, 608, 0.1));
    assert_eq!((count(0), count(100), count(-1)), (109_207, 544, 234_377));
    let free = DistanceField::new(&map.refined(2).unwrap().map(|v| v != 0)).at_least(0.2);
    let passable = Passable::new(&free);
    let mut random = Random::new(3);
    let (mut astar, mut jump, mut found) = (AStar::new(), JumpPoint::new(), 0);
    for _ in 0..60 {
        let (Some(start), Some(goal)) = (some_free(&mut random, &free), some_free(&mut random, &free)) else {
            continue;
        };
        match (astar.search(&passable, start, goal), jump.search(&passable, start, goal)) {
            (Ok(a), Ok(b)) => {
                assert_sound(&passable, &a, start, goal);
                assert_sound(&passable, &b, start, goal);
                assert!((a.length - b.length).abs() < 1e-6 && b.expanded < a.expanded / 4 + 50);
                found += 1;
            }
            (a, b) => assert_eq!(a.is_err(), b.is_err()),
        }
    }
    assert!(found > 40, "{found} of 60 found");
}

#[test]
fn bad_ends_have_their_reasons() {
    let mut grid = Grid::filled(GridFrame::unit(9, 7).unwrap(), true);
    (0..7).for_each(|y| assert!(grid.set(Cell::new(4, y), false)));
    let passable = Passable::new(&grid);
    let [left, right, wall] = [(1, 1), (7, 5), (4, 3)].map(|(x, y)| Cell::new(x, y));
    let outside = Cell::new(9, 0);
    let mut astar = AStar::new();
    assert_eq!(astar.search(&passable, outside, left), Err(NoPath::Outside(Place::Start)));
    assert_eq!(astar.search(&passable, left, outside), Err(NoPath::Outside(Place::Goal)));
    let blocked = |place| Err(NoPath::Blocked { place, cell: wall });
    assert_eq!(astar.search(&passable, wall, left), blocked(Place::Start));
    assert_eq!(JumpPoint::new().search(&passable, left, wall), blocked(Place::Goal));
    assert_eq!(LazyTheta::new().search(&passable, left, wall), blocked(Place::Goal));
    assert_eq!(astar.search(&passable, left, right), Err(NoPath::Unreachable { expanded: 28 }));
    assert!(matches!(JumpPoint::new().search(&passable, left, right), Err(NoPath::Unreachable { .. })));
    assert!(matches!(LazyTheta::new().search(&passable, left, right), Err(NoPath::Unreachable { .. })));
    let same = astar.search(&passable, left, left).unwrap();
    assert_eq!((same.cells.as_slice(), same.length), (&[left][..], 0.0));
    let walls = Passable::new(&grid.map(|_| false));
    assert_eq!(astar.search(&walls, left, right), Err(NoPath::NoFreeCell));
    let nan = cairn_geometry::Vec2::new(f64::NAN, 1.0);
    assert_eq!(free_cell(&passable, Place::Goal, nan), Err(NoPath::NotFinite(Place::Goal)));
    let costs = grid.map(|free| if free { 5 } else { BLOCKED });
    assert_eq!(WeightedAStar::new().search(&costs, wall, left), blocked(Place::Start));
    assert!(matches!(
        WeightedAStar::new().search(&costs, left, right),
        Err(NoPath::Unreachable { expanded: 28 })
    ));
}
