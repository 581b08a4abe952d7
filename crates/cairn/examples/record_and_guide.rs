//! Records a route in a simulated world, then guides a simulated walker back along it. The walker knows nothing but the
//! words; the engine gets nothing but the images seen from where the walker really is.
//!
//! `cargo run --release -p cairn --example record_and_guide`

use cairn::Slam;
use cairn::geometry::Vec2;
use cairn::guide::Facing;
use cairn::sensor::Stamp;
use cairn::session::Event;
use cairn::sim::{LiveRig, SimConfig, Stride};
use cairn_trial::Walker;
use std::error::Error;

const RATE_HZ: f64 = 10.0;

fn main() -> Result<(), Box<dyn Error>> {
    // A depth camera on the chest of someone who turns slowly.
    let mut sim = SimConfig::parse("sim:demo?seed=3&sensor=rgbd&resolution=320x240&focal=210&rate=10")?;
    sim.walker.turn_rate = 0.8;
    let mut camera = LiveRig::new(&sim)?;
    let mut slam = Slam::builder(camera.rig()).rate_hz(RATE_HZ).build()?;

    // The way out: to the first corner of the world's route and 2 m beyond it.
    let route = camera.world().routes().first().ok_or("the world has no route")?.points.clone();
    let [start, corner, next, ..] = route[..] else { return Err("the route has no corner".into()) };
    let heading = (next - corner).normalize();
    let end = corner + heading * 2.0;
    let motion = sim.walker.motion(&[start, corner, end]);
    let file = std::env::temp_dir().join(format!("cairn-example-{}.route", std::process::id()));
    slam.record(&file)?;
    let mut now = Stamp::from_seconds(0.0);
    while now.seconds() < motion.end() {
        now = now.plus_seconds(1.0 / RATE_HZ);
        slam.track(&camera.packet(now, &motion.pose(now.seconds()))?)?;
    }
    let points = slam.stop_recording()?.points.len();
    // What was said on the way out is not for the way home.
    slam.heard();
    println!("recorded  {points} points over {:.1} s", now.seconds());

    // The way home: the walker hears the words, turns and walks, and the camera goes along.
    let began = now;
    slam.guide_home(Facing::Home)?;
    let mut walker = Walker::new(1, (end.x, end.y, heading.y.atan2(heading.x)));
    let mut stride = Stride::new(sim.walker.clone());
    while !slam.has_arrived() && now - began < 180.0 {
        now = now.plus_seconds(1.0 / RATE_HZ);
        let (x, y, _) = walker.pose();
        let (to_x, to_y, facing) = walker.step(1.0 / RATE_HZ, now);
        // A wall stops the walker.
        let free = camera.world().clearance(to_x, to_y) >= 0.25;
        let at = if free { Vec2::new(to_x, to_y) } else { Vec2::new(x, y) };
        walker.held_at(at.x, at.y);
        let pose = stride.pose(at, facing, 1.0 / RATE_HZ);
        slam.track(&camera.packet(now, &pose)?)?;
        for event in slam.heard() {
            match event {
                Event::Said(said) => {
                    println!("{:5.1} s  {}", now - began, said.text);
                    walker.hear(&said.text, said.stamp);
                }
                // Short sounds between the words: on course, turn, arrived.
                Event::Sound(_) => {}
            }
        }
    }
    std::fs::remove_file(&file)?;
    let (x, y, _) = walker.pose();
    let error_m = (Vec2::new(x, y) - start).norm();
    println!("arrived   {}, {error_m:.2} m from the start", slam.has_arrived());
    if slam.has_arrived() && error_m < 1.0 { Ok(()) } else { Err("the walker did not come home".into()) }
}
