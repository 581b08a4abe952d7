//! Speed and quality of planning, as one table: `cargo bench -p cairn-plan --bench figures [SECTION]`, where the
//! section is `distance`, `search`, `costmap`, `control` or `routes`. Times are CPU times of the thread, not wall-clock
//! times, so that other work on the machine counts less. The minimum and the median over many repetitions are printed;
//! for searches the minimum over three runs of each task.
//!
//! The map is Willow Garage in `grids/` of the recordings (`CAIRN_DATA`, else `../shared/data`), doubled to 5 cm.

mod control;
mod costmap;
mod distance;
mod routes;
mod search;

use cairn_plan::{DistanceField, Grid, map_server};
use std::path::PathBuf;

fn main() {
    let only = std::env::args().skip(1).find(|a| !a.starts_with('-')).unwrap_or_default();
    let wanted = |name: &str| only.is_empty() || name == only;
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let data = std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    let file = data.join("grids/willow-2010-02-18-0.10.yaml");
    let Ok((map, _)) = map_server::load(&file) else {
        println!("skipped: no map in {}", file.display());
        return;
    };
    let willow = map.refined(2).expect("a larger grid");
    if wanted("distance") {
        distance::figures(&willow);
    }
    if wanted("search") {
        search::figures(&willow);
    }
    if wanted("costmap") {
        costmap::figures(&willow);
    }
    if wanted("control") {
        control::figures(&willow);
    }
    if wanted("routes") {
        routes::figures(&willow, 200);
    }
}

/// Every cell that is not known to be free.
pub fn obstacles(map: &Grid<i8>) -> Grid<bool> {
    map.map(|v| v != 0)
}

/// The cells whose centre is at least this far from everything that is not free.
pub fn inflated(map: &Grid<i8>, radius_m: f64) -> Grid<bool> {
    DistanceField::new(&obstacles(map)).at_least(radius_m)
}

/// A start pose and a goal some distance away, drawn by a seed.
pub fn a_route(costs: &cairn_plan::Costmap) -> (cairn_geometry::Se2, cairn_geometry::Vec2) {
    let (frame, passable) = (*costs.frame(), costs.passable());
    let mut random = cairn_random::Random::new(4);
    let mut astar = cairn_plan::search::AStar::new();
    loop {
        let [a, b] = [(); 2].map(|()| frame.cell(random.below(frame.len())));
        if astar.search(&passable, a, b).is_ok_and(|p| p.length > 400.0) {
            let at = frame.centre(a);
            return (cairn_geometry::Se2::from_xy_angle(at.x, at.y, 0.0), frame.centre(b));
        }
    }
}

/// Times one operation and prints the line.
pub fn repeat(name: &str, mut run: impl FnMut()) {
    let (mut times, began) = (Vec::new(), cpu_ms());
    while times.len() < 10 || (times.len() < 400 && cpu_ms() - began < 500.0) {
        let from = cpu_ms();
        run();
        times.push(cpu_ms() - from);
    }
    times.sort_by(f64::total_cmp);
    let (least, median) = (times[0], times[times.len() / 2]);
    println!("  {name:<58} min {least:8.4} ms, median {median:8.4} ms");
}

/// Mean, median, 99th percentile and maximum of some times in milliseconds.
pub fn spread(times: &[f64]) -> String {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |part: f64| sorted[((sorted.len() - 1) as f64 * part) as usize];
    let mean = sorted.iter().sum::<f64>() / sorted.len() as f64;
    format!("mean {mean:7.3}, median {:7.3}, p99 {:7.3}, max {:7.3}", at(0.5), at(0.99), at(1.0))
}

/// CPU time of this thread in milliseconds.
pub fn cpu_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}
