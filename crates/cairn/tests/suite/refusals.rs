//! What cannot be used is refused with a typed error, and the next frame is taken.

use cairn::geometry::Vec3;
use cairn::guide::Facing;
use cairn::sensor::Camera;
use cairn::{Config, Error, GrayImage, ImuSample, Rig, SensorMode, Slam, Stamp};

fn rig() -> Rig {
    Rig::mono(Camera::pinhole(320, 240, 210.0, 210.0, 159.5, 119.5))
}

fn slam() -> Slam {
    Slam::new(&rig(), SensorMode::Mono, &Config::default()).unwrap()
}

#[test]
fn bad_frames_are_refused_and_the_next_one_is_taken() {
    let mut slam = slam();
    let mut track = |t: f64, width: usize, imu: Vec<ImuSample>| {
        slam.track_images(Stamp::from_seconds(t), vec![GrayImage::new(width, 240)], None, imu)
    };
    let sample = |t: f64, rate: f64| {
        ImuSample::new(Stamp::from_seconds(t), Vec3::new(rate, 0.0, 0.0), Vec3::new(0.0, 0.0, 9.8))
    };
    assert!(track(1.0, 320, vec![sample(0.9, 0.0), sample(1.0, 0.0)]).is_ok());
    for (t, width, imu, why) in [
        (1.0, 320, vec![], "not later"),
        (1.1, 300, vec![], "300"),
        (1.2, 320, vec![sample(1.15, f64::NAN)], "not finite"),
        (1.3, 320, vec![sample(1.25, 0.0), sample(1.25, 0.0)], "follows one"),
    ] {
        match track(t, width, imu) {
            Err(e @ Error::Frame { .. }) => assert!(e.to_string().contains(why), "{e}"),
            other => panic!("{why}: {:?}", other.map(|o| o.state)),
        }
    }
    assert!(track(1.1, 320, vec![]).is_ok(), "a refused frame does not use up its time");
    assert!(track(2.0, 320, vec![]).unwrap().pose.is_none(), "there is nothing to see");
}

#[test]
fn what_cannot_be_built_says_why() {
    let refused = |built: Result<Slam, Error>| built.err().expect("refused");
    assert!(matches!(refused(Slam::builder(&rig()).rate_hz(f64::NAN).build()), Error::Rate(_)));
    assert!(matches!(refused(Slam::builder(&rig()).sensor(SensorMode::Stereo).build()), Error::Rig(_)));
    let none = Rig { cameras: Vec::new(), ..rig() };
    assert!(matches!(refused(Slam::builder(&none).build()), Error::Rig(_)));
    let mut config = Config::default();
    config.front_end.orb.features = 70_000;
    assert!(matches!(refused(Slam::builder(&rig()).config(&config).build()), Error::Config(_)));
}

#[test]
fn files_and_commands_that_cannot_be_served_say_why() {
    let mut slam = slam();
    let nowhere = std::env::temp_dir().join("cairn-no-such-folder/file");
    assert!(matches!(slam.save(&nowhere), Err(Error::EmptyMap)));
    assert!(matches!(Slam::load_map(&nowhere), Err(Error::MapFile(_))));
    assert!(matches!(slam.load_route(&nowhere), Err(Error::Route(_))));
    assert!(matches!(slam.stop_recording(), Err(Error::Refused(_))));
    assert!(matches!(slam.guide_home(Facing::Home), Err(Error::Refused(_))));
    assert!(matches!(slam.halt(), Err(Error::Refused(_))));
    assert!(matches!(cairn::open(&nowhere.display().to_string()), Err(Error::Source(_))));
    // A recording goes on in memory where its file cannot be created.
    assert!(slam.record(&nowhere).unwrap().starts_with("Recording in memory only"));
    assert!(matches!(slam.record(&nowhere), Err(Error::Refused(_))));
}
