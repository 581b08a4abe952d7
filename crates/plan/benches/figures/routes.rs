//! Whole drives on the map: planned, smoothed and followed by a simulated robot with a delay and noisy odometry.

use crate::spread;
use cairn_geometry::{Se2, Vec2};
use cairn_plan::control::trial::{Drive, SimulatedBody, drive};
use cairn_plan::control::{Limits, MppiConfig, Navigator, NavigatorConfig, PursuitConfig, State};
use cairn_plan::search::BLOCKED;
use cairn_plan::{CostConfig, Costmap, Grid};
use cairn_random::Random;
use std::collections::BTreeMap;

pub fn figures(willow: &Grid<i8>, count: usize) {
    let costs = Costmap::new(willow.clone(), CostConfig::default()).expect("costs");
    println!(
        "routes: {count} on Willow at 5 cm, radius 0.2 m, up to 1 m/s, 50 ms delay, odometry off by 2 %"
    );
    println!("  goals: nothing touched, beside the path by 0.05 m RMS at most, no oscillation at the goal");
    let mut config = NavigatorConfig::new(PursuitConfig::new(Limits::differential_drive()));
    println!("  pure pursuit, odometry put right to 1 cm and 0.003 rad every second:");
    tell(&drives(&costs, config, count, 1.0));
    println!("  pure pursuit, odometry never put right:");
    tell(&drives(&costs, config, count / 4, f64::INFINITY));
    config.predictive = Some(MppiConfig::new(Limits::differential_drive()));
    println!("  path integral control, odometry put right to 1 cm and 0.003 rad every second:");
    tell(&drives(&costs, config, count, 1.0));
}

fn tell(drives: &[Drive]) {
    let many = |of: fn(&Drive) -> f64| drives.iter().map(of).collect::<Vec<_>>();
    let mut states: BTreeMap<String, usize> = BTreeMap::new();
    drives.iter().for_each(|d| *states.entry(d.state.to_string()).or_default() += 1);
    println!("  states {states:?}, plans {}", drives.iter().map(|d| d.plans).sum::<usize>());
    println!("  length                 {} m", spread(&many(|d| d.length_m)));
    println!("  mean speed             {} m/s", spread(&many(|d| d.length_m / d.seconds)));
    println!("  beside the path, RMS   {} m", spread(&many(|d| d.lateral_rms_m)));
    println!("  RMS by its own odometry {} m", spread(&many(|d| d.own_lateral_rms_m)));
    println!("  beside the path, most  {} m", spread(&many(|d| d.lateral_max_m)));
    let least = drives.iter().map(|d| d.clearance_m).fold(f64::INFINITY, f64::min);
    println!(
        "  clearance to the squares of walls, least {least:.3} m; touched in {}",
        drives.iter().filter(|d| d.clearance_m < 0.0).count()
    );
    println!("  to the goal at the end {} m", spread(&many(|d| d.to_goal_m)));
    println!(
        "  turns that changed side in the last metre: {} at most",
        drives.iter().map(|d| d.reversals).max().unwrap_or(0)
    );
    let odd = |d: &&Drive| d.state != State::Reached || d.clearance_m < 0.0;
    drives.iter().filter(odd).take(3).for_each(|d| println!("  not so: {d:?}"));
}

fn drives(costs: &Costmap, config: NavigatorConfig, count: usize, fix_s: f64) -> Vec<Drive> {
    let frame = *costs.frame();
    let mut random = Random::new(17);
    let mut navigator = Navigator::new(config);
    let mut drives = Vec::new();
    let some = |random: &mut Random| loop {
        let cell = frame.cell(random.below(frame.len()));
        if costs.costs().get(cell).is_some_and(|c| c != BLOCKED) {
            return frame.centre(cell);
        }
    };
    let passable = costs.passable();
    let mut astar = cairn_plan::search::AStar::new();
    while drives.len() < count {
        let (start, goal): (Vec2, Vec2) = (some(&mut random), some(&mut random));
        let cell = |p| frame.cell_at(p).expect("inside");
        if !astar.search(&passable, cell(start), cell(goal)).is_ok_and(|p| p.length > 40.0) {
            continue;
        }
        let heading = random.uniform(-3.1, 3.1);
        let pose = Se2::from_xy_angle(start.x, start.y, heading);
        let limits = Limits::differential_drive();
        let mut body = SimulatedBody::new(pose, limits, 0.05, 0.02, fix_s, 100 + drives.len() as u64);
        drives.push(drive(&mut navigator, &mut body, goal, costs, |_| None, 400.0));
    }
    drives
}
