//! Time of one control step.

use crate::repeat;
use cairn_geometry::{Se2, Vec2};
use cairn_plan::control::{
    Limits, Mppi, MppiConfig, Navigator, NavigatorConfig, Pursuit, PursuitConfig, ReferencePath,
    Surroundings, Twist,
};
use cairn_plan::{CostConfig, Costmap, Grid};
use std::hint::black_box;

pub fn figures(willow: &Grid<i8>) {
    println!("control: a step in the middle of a route on Willow");
    let costs = Costmap::new(willow.clone(), CostConfig::default()).expect("costs");
    let (pose, goal) = crate::a_route(&costs);
    let mut navigator =
        Navigator::new(NavigatorConfig::new(PursuitConfig::new(Limits::differential_drive())));
    navigator.set_goal(goal);
    let mut search = cairn_plan::search::WeightedAStar::new();
    let cell = |p| costs.frame().cell_at(p).expect("inside");
    let found = search.search(costs.costs(), cell(pose.translation), cell(goal)).expect("a path");
    repeat("searched over costs", || {
        black_box(search.search(costs.costs(), cell(pose.translation), cell(goal)).is_ok());
    });
    println!("    {} expanded, {} cells", found.expanded, found.cells.len());
    repeat("smoothed", || {
        black_box(cairn_plan::smooth::smooth(costs.field(), &found.cells, &Default::default()).length_m);
    });
    repeat("planned, smoothed, and the first steps", || {
        navigator.set_goal(goal);
        black_box(navigator.step(0.0, &pose, Twist::stop(), &costs, None));
    });
    let path: ReferencePath = navigator.path().expect("a path").clone();
    println!("    {:.1} m", path.length_m());
    let (at, direction) = path.at(3.0);
    let along: Vec2 = path.at(3.0).1;
    let pose =
        Se2::from_xy_angle(at.x - 0.05 * direction.y, at.y + 0.05 * direction.x, along.y.atan2(along.x));
    let around = Surroundings { field: costs.field(), moving: None, radius_m: 0.2 };
    let motion = Twist::new(1.0, 0.0);
    let mut pursuit = Pursuit::new(PursuitConfig::new(Limits::differential_drive()));
    (0..5).for_each(|_| assert!(!pursuit.step(&pose, motion, &path, &around).reached));
    repeat("pure pursuit, regulated, 1 s looked ahead (goal: 0.05 ms)", || {
        black_box(pursuit.step(black_box(&pose), motion, &path, &around));
    });
    let mut now = 0.0;
    repeat("navigator: that, and the whole path looked at", || {
        now += 0.05;
        black_box(navigator.step(now, &pose, motion, &costs, None));
    });
    let mut mppi = Mppi::new(MppiConfig::new(Limits::differential_drive()));
    repeat("path integral, 400 roll-outs of 20 steps (goal: 0.3 ms)", || {
        black_box(mppi.step(black_box(&pose), motion, &path, &around));
    });
}
