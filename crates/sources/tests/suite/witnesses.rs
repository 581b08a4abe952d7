//! Sensors that fail in silence, and what the validator says of them; sound recordings have no doubt.

use crate::common;

use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{
    DepthImage, FramePacket, GrayImage, ImuSample, Rig, SkipKind, Source, SourceError, SourceInfo, Stamp,
};
use cairn_sources::{OpenOptions, PacketValidator, Validator, open};
use common::data;
use std::sync::Arc;

/// The doubts about the first seconds of a source whose rig and packets are changed.
fn doubts(
    name: &str,
    rig: impl Fn(&mut Rig),
    mut change: impl FnMut(usize, &mut FramePacket),
) -> Vec<String> {
    let mut source = open(name, OpenOptions::default()).unwrap();
    let mut changed = source.rig().clone();
    rig(&mut changed);
    let mut checks = PacketValidator::new(&changed);
    let mut found = Vec::new();
    for k in 0..200 {
        let Some(mut packet) = source.next_packet().unwrap() else { break };
        change(k, &mut packet);
        found.extend(checks.packet(&packet));
    }
    found
}

fn as_it_is(_: &mut Rig) {}

/// What is said of 7-Scenes as published: its colour camera is another than its depth camera.
fn unregistered(doubt: &str) -> bool {
    doubt.contains("0.90 times as large as the depth")
}

/// A simulated world, and the recordings of the data folder that are there.
fn sources(simulated: &str, recorded: &[&str]) -> Vec<String> {
    let recorded = recorded.iter().filter_map(|name| data(name));
    let recorded = recorded.map(|path| path.to_str().unwrap().to_owned());
    std::iter::once(simulated.to_owned()).chain(recorded).collect()
}

fn stereo() -> Vec<String> {
    sources("sim:office?sensor=stereo&duration=4&rate=10", &["euroc-mh01", "kitti-a"])
}

/// What a source delivers, except its pixels: stamps, and readings.
fn delivered(source: &mut dyn Source) -> Vec<(Stamp, Vec<ImuSample>)> {
    let packets = std::iter::from_fn(|| source.next_packet().unwrap());
    packets.take(200).map(|packet| (packet.stamp, packet.imu)).collect()
}

#[test]
fn sound_recordings_have_no_doubt_and_are_delivered_as_they_are() {
    let simulated = "sim:office?duration=4&resolution=320x240&detail=0.2";
    for name in sources(
        simulated,
        &["euroc-mh01", "kitti-a", "7scenes-kitchen", "atrium", "house", "phone/a", "phone/b"],
    ) {
        let mut found = doubts(&name, as_it_is, |_, _| {});
        assert_eq!(
            found.iter().any(|doubt| unregistered(doubt)),
            name.contains("7scenes"),
            "{name}: {found:?}"
        );
        found.retain(|doubt| !unregistered(doubt));
        assert!(found.is_empty(), "{name}: {found:?}");
        let opened = || open(&name, OpenOptions::default()).unwrap();
        let mut validated = Validator::new(opened(), |_| {});
        assert_eq!(delivered(&mut validated), delivered(opened().as_mut()), "{name}");
    }
}

#[test]
fn a_right_image_that_is_one_frame_late_is_doubted() {
    for name in stereo() {
        let mut before: Option<Arc<GrayImage>> = None;
        let found = doubts(&name, as_it_is, |_, packet| {
            let now = packet.images[1].clone();
            packet.images[1] = before.replace(now.clone()).unwrap_or(now);
        });
        assert!(matches!(&found[..], [one] if one.contains("not of one time")), "{name}: {found:?}");
    }
}

#[test]
fn left_and_right_pictures_that_are_exchanged_are_told() {
    for name in stereo() {
        let found = doubts(&name, as_it_is, |_, packet| packet.images.swap(0, 1));
        assert!(matches!(&found[..], [one] if one.contains("are exchanged")), "{name}: {found:?}");
        // With the calibration exchanged too the pair is sound, whichever camera is first.
        let exchanged = |rig: &mut Rig| rig.cameras.swap(0, 1);
        let found = doubts(&name, exchanged, |_, packet| packet.images.swap(0, 1));
        assert!(!found.iter().any(|doubt| doubt.contains("exchanged")), "{name}: {found:?}");
    }
}

#[test]
fn a_second_camera_that_is_turned_is_doubted_with_its_angle() {
    for name in stereo() {
        for (axis, degrees, told) in [(Vec3::x(), 0.5, ["0.5", "0.4"]), (Vec3::y(), 3.0, ["3.", "2."])] {
            let turned = |rig: &mut Rig| {
                let turn = Se3::new(So3::exp(&(axis * f64::to_radians(degrees))), Vec3::zeros());
                rig.cameras[1].body_from_camera = rig.cameras[1].body_from_camera * turn;
            };
            let found = doubts(&name, turned, |_, _| {});
            let [one] = &found[..] else { panic!("{name}: {degrees} {found:?}") };
            let is_named = told.iter().any(|angle| one.contains(&format!(" -{angle}")));
            assert!(is_named, "{name}: {degrees} {one}");
        }
    }
}

#[test]
fn pictures_that_repeat_are_doubted_while_the_imu_turns_or_after_a_second() {
    for name in sources("sim:corridor?sensor=mono-imu&duration=6&rate=10&start=14", &["euroc-mh01"]) {
        let mut held: Option<Arc<GrayImage>> = None;
        let frozen = |seconds: f64, turns: f64| {
            let mut first = None;
            held = None;
            doubts(&name, as_it_is, |_, packet| {
                let t = packet.stamp - *first.get_or_insert(packet.stamp);
                packet.imu.iter_mut().for_each(|sample| sample.gyro *= turns);
                if (0.5..0.5 + seconds).contains(&t) {
                    packet.images[0] = held.get_or_insert(packet.images[0].clone()).clone();
                }
            })
        };
        let mut frozen = frozen;
        let turning = frozen(0.8, 1.0);
        assert!(turning.iter().any(|d| d.contains("while the IMU turns by 0.")), "{name}: {turning:?}");
        let still = frozen(0.8, 0.0);
        assert!(!still.iter().any(|d| d.contains("bit by bit")), "{name}: {still:?}");
        let long = frozen(1.5, 0.0);
        assert!(long.iter().any(|d| d.contains("bit by bit for 1.")), "{name}: {long:?}");
        // A covered lens.
        let dark = doubts(&name, as_it_is, |k, packet| {
            let [width, height] = [packet.images[0].width(), packet.images[0].height()];
            if k > 5 {
                packet.images[0] = Arc::new(GrayImage::new(width, height));
            }
        });
        assert!(!dark.iter().any(|d| d.contains("bit by bit")), "{name}: {dark:?}");
    }
}

#[test]
fn depth_that_changes_its_unit_is_doubted_and_a_hand_before_the_camera_is_not() {
    for name in sources(
        "sim:office?sensor=rgbd&duration=2&rate=20&resolution=320x240&detail=0.2",
        &["7scenes-kitchen"],
    ) {
        let with = |of: &dyn Fn(f64, u16) -> u16| {
            doubts(&name, as_it_is, |k, packet| {
                let Some(depth) = packet.depth.as_ref().filter(|_| k >= 30) else { return };
                let width = depth.width();
                let data = depth.data().iter().enumerate().map(|(at, units)| match units {
                    0 | &u16::MAX => 0,
                    units => of((at % width) as f64 / width as f64, *units),
                });
                packet.depth = DepthImage::from_vec(width, depth.height(), data.collect()).map(Arc::new);
            })
        };
        for factor in [5.0, 0.2, 2.0, 0.1] {
            let mut found = with(&|_, units| (f64::from(units) * factor).min(65534.0) as u16);
            found.retain(|doubt| !unregistered(doubt));
            let [one] = &found[..] else { panic!("{name}: {factor} {found:?}") };
            let told =
                one.split_once("depth is ").and_then(|(_, rest)| rest.split(' ').next()?.parse::<f64>().ok());
            assert!(told.is_some_and(|told| (told / factor - 1.0).abs() < 0.05), "{name}: {factor} {one}");
        }
        // Most of the picture is nearer than the sensor measures or as near as a hand, all at once.
        let mut hand = with(&|x, units| if x < 0.7 { 400 + (70.0 * x) as u16 } else { units });
        hand.retain(|doubt| !unregistered(doubt));
        assert!(hand.is_empty(), "{name}: {hand:?}");
    }
}

/// A source that delivers its picture of 1 s again for a second.
struct Frozen {
    source: Box<dyn Source>,
    first: Option<Stamp>,
    held: Option<Arc<GrayImage>>,
}

impl Source for Frozen {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn rig(&self) -> &Rig {
        self.source.rig()
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let mut packet = self.source.next_packet()?;
        if let Some(packet) = &mut packet {
            let t = packet.stamp - *self.first.get_or_insert(packet.stamp);
            if (0.99..2.0).contains(&t) {
                packet.images[0] = self.held.get_or_insert(packet.images[0].clone()).clone();
            }
        }
        Ok(packet)
    }

    fn skipped(&self) -> &[String] {
        &[]
    }
}

#[test]
fn repeated_pictures_are_left_out_while_the_imu_turns_and_no_reading_is() {
    let name = "sim:corridor?sensor=mono-imu&duration=3&rate=10&start=14&resolution=64x48&detail=0.05";
    let all = |validated: bool| {
        let source = open(name, OpenOptions::default()).unwrap();
        let frozen: Box<dyn Source> = Box::new(Frozen { source, first: None, held: None });
        let mut source = if validated { Box::new(Validator::new(frozen, |_| {})) } else { frozen };
        let packets: Vec<FramePacket> = std::iter::from_fn(|| source.next_packet().unwrap()).collect();
        (packets, source.skips())
    };
    let readings = |packets: &[FramePacket]| {
        let all = packets.iter().flat_map(|p| &p.imu).filter(|s| !s.is_synthesised());
        all.map(|s| s.stamp).collect::<Vec<_>>()
    };
    let ((before, _), (after, skips)) = (all(false), all(true));
    let frozen = skips.count(SkipKind::Frame);
    assert_eq!(before.len() - after.len(), frozen + skips.count(SkipKind::Repeat));
    assert!(frozen >= 6, "{skips:?}");
    assert_eq!(readings(&before), readings(&after));
    assert!(skips.iter().any(|s| s.kind == SkipKind::Other && s.first.contains("bit by bit")), "{skips:?}");
}

#[test]
fn a_part_of_the_picture_that_stays_the_same_while_the_rest_moves_is_doubted() {
    let simulated = "sim:office?sensor=mono&duration=6&rate=10";
    for name in sources(simulated, &["euroc-mh01", "kitti-a", "atrium"]) {
        let found = doubts(&name, as_it_is, |_, packet| {
            // A logo of 96x64 pixels whose letters are 8 pixels wide.
            let mut image = GrayImage::clone(&packet.images[0]);
            let bottom = image.height() - 80;
            for y in 0..64 {
                let letters = (0..96).map(|x| 40 + 170 * u8::from((x / 8 * 7 + y / 8 * 5) % 4 < 2));
                image.row_mut(bottom + y)[32..128].iter_mut().zip(letters).for_each(|(px, v)| *px = v);
            }
            packet.images[0] = Arc::new(image);
        });
        let found: Vec<&String> = found.iter().filter(|d| d.contains("stay the same")).collect();
        assert!(matches!(&found[..], [one] if one.contains("parts of 16x16 pixels")), "{name}: {found:?}");
    }
}

/// The picture turned over: where the pixel at a column and row of it comes from.
fn turned_over(image: &GrayImage, from: fn([usize; 2], [usize; 2]) -> [usize; 2]) -> GrayImage {
    let (width, height) = (image.width(), image.height());
    let data = (0..width * height).map(|k| {
        let [x, y] = from([k % width, k / width], [width, height]);
        image.at(x, y)
    });
    GrayImage::from_vec(width, height, data.collect()).expect("as large")
}

#[test]
fn pictures_that_turn_otherwise_than_the_gyroscope_are_doubted_with_how_they_lie() {
    let simulated = "sim:office?sensor=mono-imu&duration=20&rate=10&resolution=320x240&detail=0.3";
    for name in sources(simulated, &["euroc-mh01", "atrium"]) {
        let with = |from: fn([usize; 2], [usize; 2]) -> [usize; 2]| {
            doubts(
                &name,
                |rig| rig.cameras.truncate(1),
                |_, packet| {
                    packet.images.truncate(1);
                    packet.images[0] = Arc::new(turned_over(&packet.images[0], from));
                },
            )
        };
        let found = with(|at, _| at);
        assert!(found.is_empty(), "{name}: {found:?}");
        let mirrored = with(|[x, y], [width, _]| [width - 1 - x, y]);
        let of = |found: &[String], how: &str| found.len() == 1 && found[0].contains(how);
        assert!(of(&mirrored, "mirrored left to right"), "{name}: {mirrored:?}");
        let upside_down = with(|[x, y], [width, height]| [width - 1 - x, height - 1 - y]);
        assert!(of(&upside_down, "upside down"), "{name}: {upside_down:?}");
        let mounted = doubts(
            &name,
            |rig| {
                rig.cameras.truncate(1);
                let imu = rig.imu.as_mut().expect("an IMU");
                let quarter = So3::exp(&(Vec3::new(1.0, 1.0, 1.0).normalize() * f64::to_radians(120.0)));
                imu.body_from_imu.rotation = imu.body_from_imu.rotation * quarter;
            },
            |_, packet| packet.images.truncate(1),
        );
        assert!(of(&mounted, "other axes than calibrated"), "{name}: {mounted:?}");
    }
}

/// Who gives each picture a second time, between two of them, has shown none that lacks a pose.
#[test]
fn pictures_that_are_each_given_twice_count_as_repeats_and_not_as_frames() {
    /// Gives the picture before once more between two, with the readings until then.
    struct Doubled(Box<dyn Source>, Option<Vec<Arc<GrayImage>>>, Option<FramePacket>);
    impl Source for Doubled {
        fn info(&self) -> &SourceInfo {
            self.0.info()
        }
        fn rig(&self) -> &Rig {
            self.0.rig()
        }
        fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
            if let Some(second) = self.2.take() {
                return Ok(Some(second));
            }
            let Some(mut packet) = self.0.next_packet()? else { return Ok(None) };
            let Some(images) = self.1.replace(packet.images.clone()) else { return Ok(Some(packet)) };
            let stamp = packet.stamp.plus_seconds(-0.05);
            let until = packet.imu.iter().position(|sample| sample.stamp >= stamp).map_or(0, |k| k + 1);
            let imu = packet.imu.drain(..until).collect();
            let repeat = FramePacket { stamp, images, imu, ..packet.clone() };
            self.2 = Some(packet);
            Ok(Some(repeat))
        }
        fn skipped(&self) -> &[String] {
            &[]
        }
    }
    let name = "sim:corridor?sensor=mono-imu&duration=4&rate=10&start=14&resolution=64x48&detail=0.05";
    let all = |doubled: bool| {
        let source = open(name, OpenOptions::default()).unwrap();
        let source = if doubled { Box::new(Doubled(source, None, None)) } else { source };
        let mut source = Validator::new(source, |doubt| panic!("{doubt}"));
        let count = std::iter::from_fn(|| source.next_packet().unwrap()).count();
        (count, source.skips())
    };
    let ((once, _), (twice, skips)) = (all(false), all(true));
    assert_eq!(skips.count(SkipKind::Frame), 0, "{skips:?}");
    assert_eq!(twice + skips.count(SkipKind::Repeat), 2 * once - 1);
    assert!(twice < once + once / 4, "{twice} of {once}: {skips:?}");
}

#[test]
fn depth_that_is_not_of_the_picture_s_time_is_doubted_with_its_lag() {
    for name in sources(
        "sim:corridor?sensor=rgbd&duration=10&rate=20&resolution=160x120&detail=0.2&start=10",
        &["7scenes-kitchen"],
    ) {
        let real = name.contains("7scenes");
        for late in if real { vec![1, 2, 3, 6] } else { vec![3, 6] } {
            let mut before = std::collections::VecDeque::new();
            let mut found = doubts(&name, as_it_is, |_, packet| {
                before.extend(packet.depth.clone());
                if before.len() > late {
                    packet.depth = before.pop_front();
                }
            });
            found.retain(|doubt| !doubt.contains("depth is not registered"));
            let [one] = &found[..] else { panic!("{name}: {late} {found:?}") };
            assert!(
                one.contains(&format!("depth moves {late} image{} (0.", if late == 1 { "" } else { "s" }))
                    && one.contains("later"),
                "{name}: {one}"
            );
        }
    }
}

#[test]
fn depth_of_the_picture_s_time_has_no_lag_however_one_moves() {
    for world in ["corridor", "office", "hall", "apartment", "street", "demo"] {
        for seed in 1..=2 {
            let name = format!(
                "sim:{world}?sensor=rgbd&duration=20&rate=10&resolution=160x120&detail=0.2&seed={seed}"
            );
            let found = doubts(&name, as_it_is, |_, _| {});
            assert!(!found.iter().any(|doubt| doubt.contains("depth moves")), "{name}: {found:?}");
        }
    }
}
