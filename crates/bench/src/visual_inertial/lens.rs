//! The lens of a drawn phone that nobody calibrated: in lockstep, how it is estimated while the phone is carried along, against
//! the truth.

use super::drawn::DrawnPhone;
use super::phone::{Noise, STATED};
use crate::MeasureError;
use cairn_engine::{Config, Engine, Runner, SensorMode};
use cairn_lens::LensProblem;
use cairn_sensor::{Camera, Distortion, Rig, Source};
use cairn_session::Slam;
use cairn_sim::{PhoneTraits, SimConfig, SimSource, Walker, WorldKind};
use cairn_sources::std_host;

/// Carries the phone of a seed along the demo's route, and prints every 4 s what is estimated of its lens and by how much that
/// is off.
///
/// # Errors
/// When the phone or the engine fails.
pub fn walk(seed: u64, noise: Noise, metres: f64, config: &Config) -> Result<(), MeasureError> {
    let mut sim = SimConfig::new(WorldKind::Demo, seed);
    sim.camera = Camera::pinhole(480, 360, 315.0, 315.0, 239.5, 179.5);
    sim.walker = Walker { turn_rate: 0.8, ..Walker::default() };
    let plain = SimSource::new(&sim)?;
    let route = plain.world().routes().first().ok_or("the world has no route")?.points.clone();
    let corners = super::walked::cut(&route, metres);
    let mut traits = PhoneTraits::new(seed, 640, 480);
    let mut config = config.clone();
    config.inertial.enabled = true;
    config.tracker.estimate_readout = noise == Noise::DrawnRollingEstimated;
    if noise == Noise::Drawn {
        traits.readout_s = 0.0;
    }
    let mut source = DrawnPhone::new(&sim, plain.world(), sim.walker.motion(&corners), &traits, 1)?;
    let guess = cairn_sensor::Camera::guessed(640, 480);
    let mut rig = Rig { imu: source.rig().imu.clone(), ..Rig::mono(guess) };
    if let Some(imu) = &mut rig.imu {
        imu.noise = STATED;
    }
    let mut engine =
        Engine::new(&rig, SensorMode::Mono, source.info().rate_hz, Runner::Lockstep, &config, &std_host())?;
    let truth = [
        traits.camera.fx / guess.fx,
        match traits.camera.distortion {
            Distortion::RadialTangential([k1, ..]) => -k1,
            _ => 0.0,
        },
    ];
    println!(
        "seed {seed} f {:.4} radial {:+.4} readout {:.1} delay {:.1}",
        truth[0],
        truth[1],
        1e3 * traits.readout_s,
        1e3 * traits.stamp_delay_s
    );
    let (mut begin, mut last) = (None, -10.0);
    while let Some(packet) = source.next_packet()? {
        engine.on_packet(&packet)?;
        let now = packet.stamp.seconds();
        let t = now - *begin.get_or_insert(now);
        if t - last < 4.0 {
            continue;
        }
        let map = engine.snapshot();
        let Some(newest) = map.key_frames().max_by_key(|k| k.id).map(|k| k.map) else { continue };
        if map.key_frames_of(newest).count() < 30 {
            continue;
        }
        let Some(p) = LensProblem::of(&map, newest, engine.camera(), &cairn_geometry::So3::identity()) else {
            continue;
        };
        if p.turned_rad() < 1.0 {
            continue;
        }
        last = t;
        let began = std::time::Instant::now();
        let e = p.solve();
        let took = began.elapsed().as_secs_f64();
        match e {
            None => println!(
                "{t:5.1} kf {:3} obs {:6} turned {:.2} none, {took:.2} s",
                p.bundle.poses.len(),
                p.bundle.observations.len(),
                p.turned_rad()
            ),
            Some(e) => println!(
                "{t:5.1} kf {:3} obs {:6} turned {:.2} f {:+.2} % ({:.2}) radial {:+.4} ({:.4}) rms {:.3} {} readout {:.1} offset {:.1}, {took:.2} s",
                p.bundle.poses.len(),
                p.bundle.observations.len(),
                p.turned_rad(),
                100.0 * (e.lens.focal / truth[0]).ln(),
                100.0 * e.sigma[0],
                e.lens.radial - truth[1],
                e.sigma[1],
                e.rms_px,
                e.converged,
                1e3 * engine.readout().seconds,
                1e3 * map.imu_offset()
            ),
        }
    }
    Ok(())
}
