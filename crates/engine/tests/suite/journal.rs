//! A threaded run is journalled and replayed bit for bit; lockstep is deterministic by itself; a subscriber
//! to the stream of changes can mirror the map.

use cairn_atlas::{Mirror, Subscription};
use cairn_dense::SubmapConfig;
use cairn_engine::{
    Clock, Config, DenseMapper, Engine, Host, Journal, Output, Phase, ReplayError, Runner, SensorMode,
    Stopped, Timings,
};
use cairn_geometry::Se3;
use cairn_sensor::{Camera, DepthImage, FramePacket, GrayImage, Stamp};
use cairn_sim::{LiveRig, SimConfig, SimSensor, Walker, WorldKind};
use cairn_sources::std_host;
use std::io::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

const RATE_HZ: f64 = 10.0;

fn sim_config(sensor: SimSensor) -> SimConfig {
    SimConfig {
        sensor,
        imu: None,
        camera: Camera::pinhole(320, 240, 210.0, 210.0, 159.5, 119.5),
        rate_hz: RATE_HZ,
        body_from_camera: Se3::identity(),
        walker: Walker { turn_rate: 0.8, ..Walker::default() },
        ..SimConfig::new(WorldKind::Demo, 3)
    }
}

fn packets(sensor: SimSensor, seconds: f64) -> Vec<FramePacket> {
    let config = sim_config(sensor);
    let mut rig = LiveRig::new(&config).unwrap();
    let motion = config.walker.motion(&rig.world().routes()[0].points.clone());
    let frames = (motion.end().min(seconds) * RATE_HZ) as usize;
    let stamp = |k: usize| Stamp::from_seconds(k as f64 / RATE_HZ);
    (0..frames).map(|k| rig.packet(stamp(k), &motion.pose(stamp(k).seconds())).unwrap()).collect()
}

/// Seven seconds: forward, blind for a second, a new map begins farther on, and back to where the first was
/// left.
pub(crate) fn walk() -> &'static [FramePacket] {
    static WALK: OnceLock<Vec<FramePacket>> = OnceLock::new();
    WALK.get_or_init(|| {
        let seen = packets(SimSensor::Rgbd, 6.0);
        let mut blind = seen[0].clone();
        blind.images = vec![Arc::new(GrayImage::new(320, 240))];
        blind.depth = Some(Arc::new(DepthImage::new(320, 240)));
        let order = (0..30).map(|k| &seen[k]);
        let order =
            order.chain(std::iter::repeat_n(&blind, 9)).chain((10..seen.len()).rev().map(|k| &seen[k]));
        let stamped = order
            .enumerate()
            .map(|(k, p)| FramePacket { stamp: Stamp::from_seconds(k as f64 / RATE_HZ), ..p.clone() });
        stamped.collect()
    })
}

pub(crate) fn engine(sensor: SimSensor, runner: Runner, config: &Config) -> Engine {
    let mode = match sensor {
        SimSensor::Stereo => SensorMode::Stereo,
        _ => SensorMode::Rgbd,
    };
    Engine::new(&sim_config(sensor).rig(), mode, RATE_HZ, runner, config, &std_host()).unwrap()
}

/// A buffer that outlives the engine writing to it.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().extend(bytes);
        Ok(bytes.len())
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// A threaded run; `pause_ms` gives for each frame how long to wait before it, or `None` to drop it.
fn live(pause_ms: impl Fn(usize) -> Option<u64>) -> (Engine, Vec<u8>) {
    let mut engine = engine(SimSensor::Rgbd, Runner::Threaded, &Config::default());
    let bytes = Shared::default();
    engine.write_journal("a walk", Box::new(bytes.clone()));
    for (k, packet) in walk().iter().enumerate() {
        let Some(ms) = pause_ms(k) else { continue };
        std::thread::sleep(Duration::from_millis(ms));
        engine.on_packet(packet).unwrap();
    }
    engine.finish();
    assert_eq!(engine.journal_failed(), None);
    let bytes = bytes.0.lock().unwrap().clone();
    (engine, bytes)
}

fn replay(bytes: &[u8], change: impl Fn(&mut FramePacket)) -> Engine {
    let journal = Journal::read(bytes).unwrap();
    let stamps = journal.stamps();
    let engine = engine(SimSensor::Rgbd, Runner::Lockstep, &Config::default());
    let mut engine = engine.replay("a walk", journal).unwrap();
    for packet in walk().iter().filter(|p| stamps.contains(&p.stamp)) {
        let mut packet = packet.clone();
        change(&mut packet);
        engine.on_packet(&packet).unwrap();
        if engine.replayed().unwrap().stopped.is_some() {
            break;
        }
    }
    engine.finish();
    engine
}

#[test]
fn threaded_run_is_replayed_bit_for_bit() {
    // As fast as possible; at leisure; with dropped frames and pauses of all lengths.
    let paces: [fn(usize) -> Option<u64>; 3] =
        [|_| Some(0), |_| Some(20), |k| (k % 5 != 3).then_some((k * 7919 % 31) as u64)];
    let mut committed = 0;
    for (nth, pace) in paces.into_iter().enumerate() {
        let (recorded, bytes) = live(pace);
        let replayed = replay(&bytes, |_| ());
        let progress = replayed.replayed().unwrap().clone();
        assert_eq!(progress.stopped, None, "run {nth}: {progress:?}");
        assert!(
            progress.equal == progress.of
                && progress.of == recorded.log().frames().len()
                && progress.map_equal,
            "{progress:?}"
        );
        assert_eq!(replayed.live_trajectory(), recorded.live_trajectory());
        assert_eq!(replayed.trajectory(), recorded.trajectory());
        assert_eq!(replayed.digest(), recorded.digest());
        assert!(recorded.log().tracked() > 40, "{} frames have a pose", recorded.log().tracked());
        let text = String::from_utf8(bytes).unwrap();
        let count = |name: &str| text.matches(name).count();
        let stopped = count(" offer ") - count(" offer -");
        println!(
            "run {nth}: {} frames, {} requests, {stopped} told to stop, {} jobs, {} committed, {} maps at the end",
            progress.of,
            count(" offer "),
            count(" job "),
            count(" closed "),
            recorded.snapshot().maps().count()
        );
        committed += count(" closed ");
    }
    assert!(committed > 0, "closing had no part in any of the runs");
}

#[test]
fn cut_journal_is_replayed_to_its_end_and_wrong_ones_are_refused() {
    let (_, bytes) = live(|k| (k < 25).then_some(5));
    // Cut within the line of the 17th frame, however many requests and jobs the threads had before it.
    let text = std::str::from_utf8(&bytes).unwrap();
    let is_frame = |line: &&str| line.split(' ').nth(1) == Some("frame");
    let line = text.lines().filter(is_frame).nth(16).unwrap();
    let cut = line.as_ptr() as usize - text.as_ptr() as usize + line.len() / 2;
    let replayed = replay(&bytes[..cut], |_| ());
    let progress = replayed.replayed().unwrap();
    assert!(matches!(&progress.stopped, Some(Stopped::Cut(_))), "{progress:?}");
    assert_eq!((progress.equal, progress.of), (16, 16), "{progress:?}");
    // Another image than in the run is detected at that frame.
    let at = walk()[12].stamp;
    let wrong = replay(&bytes, |packet| {
        if packet.stamp == at {
            packet.images = walk()[2].images.clone();
        }
    });
    let progress = wrong.replayed().unwrap();
    assert!(
        matches!(&progress.stopped, Some(Stopped::Differs { stamp: Some(t), .. }) if *t == at),
        "{progress:?}"
    );
    assert_eq!(progress.equal, 12);
    // Another source, another configuration, threads.
    let journal = Journal::read(&bytes).unwrap();
    let lockstep = |config: &Config| engine(SimSensor::Rgbd, Runner::Lockstep, config);
    let why = lockstep(&Config::default()).replay("a street", journal.clone()).err().unwrap().to_string();
    assert!(why.contains("a walk") && why.contains("a street"), "{why}");
    let mut config = Config::default();
    config.tracker.min_inliers += 1;
    let why = lockstep(&config).replay("a walk", journal.clone()).err().unwrap().to_string();
    assert!(why.contains("min_inliers"), "{why}");
    let threads = engine(SimSensor::Rgbd, Runner::Threaded, &Config::default());
    assert_eq!(threads.replay("a walk", journal).err(), Some(ReplayError::NotLockstep));
}

#[test]
fn lockstep_does_not_depend_on_front_end_threads() {
    let seen = packets(SimSensor::Stereo, 3.5);
    let run = |two_threads| {
        let mut config = Config::default();
        config.front_end.two_threads = two_threads;
        let mut engine = engine(SimSensor::Stereo, Runner::Lockstep, &config);
        seen.iter().for_each(|packet| drop(engine.on_packet(packet).unwrap()));
        engine.finish();
        let (tracked, key_frames) = (engine.log().tracked(), engine.snapshot().key_frame_count());
        assert!(tracked > 25 && key_frames > 1, "{tracked} frames tracked, {key_frames} key frames");
        engine.digest()
    };
    let digests = [true, false, true, false].map(run);
    assert!(digests.iter().all(|d| *d == digests[0]), "{digests:x?}");
}

#[test]
fn subscriber_mirrors_the_map_in_lockstep_and_threaded() {
    for runner in [Runner::Lockstep, Runner::Threaded] {
        let mut engine = engine(SimSensor::Rgbd, runner, &Config::default());
        let first: Subscription = engine.subscribe().unwrap();
        let mut later = None;
        for (k, packet) in walk().iter().enumerate() {
            engine.on_packet(packet).unwrap();
            if k == 20 {
                later = engine.subscribe();
            }
        }
        engine.finish();
        for subscription in [first, later.unwrap()] {
            let mut mirror = Mirror::of(&subscription.start);
            subscription.changes.try_iter().for_each(|published| mirror.take(&published));
            assert_eq!(mirror, Mirror::of(&engine.snapshot()), "{runner:?}");
        }
    }
}

/// A clock that goes on by a millisecond each time it is read.
fn counting() -> Clock {
    let readings = AtomicU64::new(0);
    Clock::new(move || Duration::from_millis(readings.fetch_add(1, Ordering::Relaxed)))
}

#[test]
fn times_are_those_of_the_given_clock_and_poses_do_not_depend_on_it() {
    let run = |clock: Clock| {
        let (mode, config) = (SensorMode::Rgbd, Config::default());
        let (rig, host) = (sim_config(SimSensor::Rgbd).rig(), Host::bare().with_clock(clock));
        let mut engine = Engine::new(&rig, mode, RATE_HZ, Runner::Lockstep, &config, &host).unwrap();
        let outputs: Vec<Output> = walk().iter().map(|packet| engine.on_packet(packet).unwrap()).collect();
        let finished = engine.finish();
        let sum = |ms: &dyn Fn(&Timings) -> f64| outputs.iter().map(|o| ms(&o.timings)).sum::<f64>();
        let mapped = outputs.iter().map(|o| o.timings.map_ms.len()).sum::<usize>();
        let in_stages = sum(&|t| t.map_ms.iter().chain(&t.close_ms).sum());
        assert_eq!((finished.timings.step_ms(), finished.stage_failed()), (0.0, None));
        assert!(mapped > 5, "{mapped} key frames");
        (engine.digest(), [sum(&|t| t.extract_ms), sum(&|t| t.track_ms)], in_stages / mapped as f64)
    };
    let (digest, [extract_ms, track_ms], stages_ms) = run(counting());
    let frames = walk().len() as f64;
    assert_eq!([extract_ms, track_ms], [frames; 2], "one reading before, one after");
    assert!(stages_ms >= 2.0, "mapping and closing: {stages_ms} ms a key frame");
    assert_eq!(run(Clock::still()), (digest, [0.0; 2], 0.0));
}

#[test]
fn threads_that_the_host_does_not_have_are_a_failure_that_is_told_once() {
    let rig = sim_config(SimSensor::Rgbd).rig();
    let (mode, config, host) = (SensorMode::Rgbd, Config::default(), Host::bare());
    let mut engine = Engine::new(&rig, mode, RATE_HZ, Runner::Threaded, &config, &host).unwrap();
    let outputs: Vec<Output> = walk()[..3].iter().map(|packet| engine.on_packet(packet).unwrap()).collect();
    let told: Vec<&str> = outputs.iter().filter_map(Output::stage_failed).collect();
    assert!(matches!(told[..], [why] if why.contains("mapping could not begin")), "{told:?}");
    assert!(
        outputs.iter().all(|o| o.pose.is_none() && o.status.phase == Phase::Error),
        "{}",
        engine.status()
    );
    assert!(engine.subscribe().is_none());
    engine.finish();
    let mut engine = Engine::new(&rig, mode, RATE_HZ, Runner::Threaded, &config, &host).unwrap();
    assert!(DenseMapper::new(&mut engine, &rig, SubmapConfig::default()).is_err());
}
