//! Searches between random cells of the largest free part of the map.

use crate::{cpu_ms, inflated, repeat, spread};
use cairn_plan::search::{AStar, BLOCKED, DStarLite, GridPath, JumpPoint, LazyTheta, NoPath, WeightedAStar};
use cairn_plan::{Cell, Grid, Passable};
use cairn_random::Random;
use std::hint::black_box;

pub fn figures(willow: &Grid<i8>) {
    let free = inflated(willow, 0.2);
    compare("Willow at 5 cm, inflated by 0.2 m (goals: mean 1.5, max 6 ms)", &free, 200);
    mend(&free, 40);
    let side = 2000;
    let frame = cairn_plan::GridFrame::unit(side, side).expect("a grid");
    let mut random = Random::new(3);
    let mut open = Grid::filled(frame, true);
    open.values_mut().iter_mut().for_each(|v| *v = !random.chance(0.2));
    compare("2000 x 2000 with one cell of five blocked (goal: median 20 ms)", &open, 20);
    let field = cairn_plan::DistanceField::new(&willow.refined(2).expect("a grid").map(|v| v != 0));
    compare(
        "Willow at 2.5 cm, 2432 x 2264, inflated by 0.2 m (goal: median 20 ms)",
        &field.at_least(0.2),
        60,
    );
}

/// Pairs of cells that a path connects, drawn by a seed.
fn tasks(passable: &Passable, count: usize) -> Vec<(Cell, Cell)> {
    let frame = *passable.frame();
    let mut random = Random::new(7);
    let mut astar = AStar::new();
    let mut some = || loop {
        let cell = frame.cell(random.below(frame.len()));
        if passable.is_free(cell) {
            return cell;
        }
    };
    let mut tasks = Vec::new();
    while tasks.len() < count {
        let (start, goal) = (some(), some());
        if astar.search(passable, start, goal).is_ok() {
            tasks.push((start, goal));
        }
    }
    tasks
}

fn compare(title: &str, free: &Grid<bool>, count: usize) {
    println!("search: {title}");
    let passable = Passable::new(free);
    repeat("bits of the free cells", || drop(black_box(Passable::new(free))));
    let tasks = tasks(&passable, count);
    let (mut astar, mut jump, mut theta) = (AStar::new(), JumpPoint::new(), LazyTheta::new());
    let mut weighted = WeightedAStar::new();
    let costs = free.map(|f| if f { 10 } else { BLOCKED });
    time("A*", &tasks, |s, g| astar.search(&passable, s, g));
    time("jump point search", &tasks, |s, g| jump.search(&passable, s, g));
    time("A* over costs, all equal", &tasks, |s, g| weighted.search(&costs, s, g));
    time("Lazy Theta*", &tasks, |s, g| theta.search(&passable, s, g));
}

/// A path that is blocked some distance ahead: repaired by D* Lite, and searched again from scratch.
fn mend(free: &Grid<bool>, count: usize) {
    let passable = Passable::new(free);
    let tasks = tasks(&passable, count);
    let (mut mended, mut again, mut first) = (Vec::new(), Vec::new(), Vec::new());
    let mut astar = AStar::new();
    for (start, goal) in tasks {
        let from = cpu_ms();
        let mut search = DStarLite::new(passable.clone(), start, goal).expect("free ends");
        let path = search.path().expect("a path");
        first.push(cpu_ms() - from);
        let at = path.cells[path.cells.len() / 6];
        let change: Vec<(Cell, bool)> = (0..36)
            .map(|k| (Cell::new(at.x.saturating_sub(3) + k % 6, at.y.saturating_sub(3) + k / 6), false))
            .collect();
        let change: Vec<(Cell, bool)> = change.into_iter().filter(|c| c.0 != start && c.0 != goal).collect();
        let from = cpu_ms();
        search.change(&change);
        let after = search.path();
        mended.push(cpu_ms() - from);
        let mut changed = passable.clone();
        change.iter().for_each(|&(c, free)| {
            changed.set(c, free);
        });
        let from = cpu_ms();
        let truth = astar.search(&changed, start, goal);
        again.push(cpu_ms() - from);
        assert_eq!(
            after.map(|p| (p.length * 1e6) as u64),
            truth.map(|p| (p.length * 1e6) as u64),
            "not as short"
        );
    }
    println!("  D* Lite, the first time    {} ms", spread(&first));
    println!("  mended: 36 cells closed    {} ms", spread(&mended));
    println!("  A* instead                 {} ms", spread(&again));
}

fn time(name: &str, tasks: &[(Cell, Cell)], mut search: impl FnMut(Cell, Cell) -> Result<GridPath, NoPath>) {
    let (mut length, mut expanded) = (0.0, 0);
    let mut times = vec![f64::INFINITY; tasks.len()];
    // The minimum over several runs of each task.
    for run in 0..3 {
        for (time, &(start, goal)) in times.iter_mut().zip(tasks) {
            let from = cpu_ms();
            let path = search(start, goal).expect("a path");
            *time = time.min(cpu_ms() - from);
            if run == 0 {
                length += path.length;
                expanded += path.expanded;
            }
        }
    }
    let n = tasks.len();
    println!(
        "  {name:<26} {} ms; {:6} expanded and {:.3} cells in the mean of {n}",
        spread(&times),
        expanded / n,
        length / n as f64
    );
}
