//! The merge of streams: order, waiting, dropped and synthesised data.

use cairn_geometry::Vec3;
use cairn_sensor::{DropReason, Dropped, ImuSample, Merge, MergeConfig, Merged, Stamp, Stream};

const MS: i64 = 1_000_000;

fn ms(t: f64) -> Stamp {
    Stamp((t * MS as f64).round() as i64)
}

fn sample(t: f64) -> ImuSample {
    ImuSample::new(ms(t), Vec3::new(t, 0.0, 0.0), Vec3::z() * 9.8)
}

fn merge(config: MergeConfig) -> Merge<u32, u32> {
    Merge::new(config)
}

fn with_imu() -> MergeConfig {
    MergeConfig { imu_period_s: Some(0.005), ..Default::default() }
}

fn times(m: &Merged<u32, u32>) -> Vec<f64> {
    m.imu.iter().map(|s| s.stamp.0 as f64 / MS as f64).collect()
}

#[test]
fn set_has_imu_samples_up_to_one_at_or_after_the_image() {
    let mut m = merge(with_imu());
    m.push_image(0, ms(12.0), 1).unwrap();
    for t in [0.0, 5.0, 10.0] {
        m.push_imu(sample(t)).unwrap();
        assert_eq!(m.lacks(), Some(Stream::Imu));
    }
    assert!(m.pop().is_none(), "the sample after the image has not arrived");
    m.push_imu(sample(15.0)).unwrap();
    assert_eq!(times(&m.pop().unwrap()), [0.0, 5.0, 10.0, 15.0]);
    // An image already covered by the last sample needs no further one.
    m.push_image(0, ms(14.0), 2).unwrap();
    assert!(m.pop().unwrap().imu.is_empty());
    m.push_image(0, ms(20.0), 3).unwrap();
    m.push_imu(sample(20.0)).unwrap();
    let third = m.pop().unwrap();
    assert_eq!((times(&third), third.images), (vec![20.0], vec![3]));
    assert_eq!(m.lacks(), Some(Stream::Camera(0)));
}

#[test]
fn missing_imu_sample_is_synthesised_and_marked() {
    let mut m = merge(with_imu());
    m.push_imu(sample(8.0)).unwrap();
    m.push_image(0, ms(12.0), 1).unwrap();
    m.advance(ms(100.0));
    assert!(m.pop().is_none(), "still waiting");
    m.advance(ms(113.0));
    let first = m.pop().unwrap();
    assert_eq!(times(&first), [8.0, 12.0]);
    let held = first.imu[1];
    assert!(held.is_synthesised() && held.noise_scale > 5.0 && held.gyro.x == 8.0);
    assert!(!first.imu[0].is_synthesised());
    // The real sample arrived late: it goes with the next image.
    for t in [10.0, 13.0, 22.0] {
        m.push_imu(sample(t)).unwrap();
    }
    m.push_image(0, ms(22.0), 2).unwrap();
    assert_eq!(times(&m.pop().unwrap()), [10.0, 13.0, 22.0]);
    assert_eq!((m.counts().synthesised, m.counts().without_imu), (1, 0));
}

#[test]
fn no_sample_is_synthesised_beyond_one_period() {
    let mut m = merge(with_imu());
    m.push_imu(sample(0.0)).unwrap();
    m.end(Stream::Imu);
    m.push_image(0, ms(5.1), 1).unwrap();
    assert_eq!(times(&m.pop().unwrap()), [0.0]);
    assert_eq!((m.counts().synthesised, m.counts().without_imu), (0, 1));
}

#[test]
fn invalid_samples_are_dropped_and_counted() {
    let mut m = merge(with_imu());
    let why = |r: Result<Option<cairn_sensor::ImuGap>, Dropped>| r.err().map(|d| d.why);
    assert_eq!(why(m.push_imu(sample(5.0))), None);
    assert_eq!(why(m.push_imu(sample(5.0))), Some(DropReason::Repeated));
    assert_eq!(why(m.push_imu(sample(4.0))), Some(DropReason::Backwards));
    let nan = ImuSample { accel: Vec3::new(0.0, f64::NAN, 0.0), ..sample(6.0) };
    assert_eq!(why(m.push_imu(nan)), Some(DropReason::NotFinite));
    // One wrong stamp far ahead does not block the following samples.
    assert_eq!(why(m.push_imu(sample(900_000.0))), None);
    let dropped = m.push_imu(sample(10.0)).unwrap_err();
    assert_eq!((dropped.stamp, dropped.why), (ms(900_000.0), DropReason::JumpsAhead));
    assert_eq!(why(m.push_imu(sample(15.0))), None);
    m.push_image(0, ms(12.0), 1).unwrap();
    assert_eq!(m.push_image(0, ms(12.0), 2).unwrap_err().why, DropReason::Repeated);
    assert_eq!(m.push_image(7, ms(13.0), 2).unwrap_err().why, DropReason::Unknown);
    assert_eq!(times(&m.pop().unwrap()), [5.0, 10.0, 15.0]);
    assert_eq!((m.counts().imu_dropped, m.counts().images_dropped), (4, 2));
}

#[test]
fn long_gap_is_accepted_when_confirmed() {
    let mut m = merge(with_imu());
    m.push_imu(sample(0.0)).unwrap();
    assert_eq!(m.push_imu(sample(3000.0)), Ok(None), "not confirmed yet");
    let gap = m.push_imu(sample(3005.0)).unwrap().unwrap();
    assert_eq!((gap.from, gap.to), (ms(0.0), ms(3000.0)));
    assert_eq!((m.counts().imu_gaps, m.counts().longest_imu_gap_s), (1, 3.0));
    assert_eq!(m.push_imu(sample(3010.0)), Ok(None));
    assert!(m.push_imu(sample(3025.0)).unwrap().is_some(), "two samples are missing");
}

#[test]
fn imu_offset_is_applied() {
    let mut m = merge(MergeConfig { imu_offset_s: 0.0015, ..with_imu() });
    m.push_image(0, ms(10.0), 1).unwrap();
    m.push_imu(sample(8.4)).unwrap();
    assert_eq!(m.lacks(), Some(Stream::Imu));
    m.push_imu(sample(8.6)).unwrap();
    assert_eq!(times(&m.pop().unwrap()), [9.9, 10.1]);
}

#[test]
fn first_image_has_one_second_of_imu_samples() {
    let mut m = merge(with_imu());
    for i in 0..601 {
        m.push_imu(sample(5.0 * i as f64)).unwrap();
    }
    m.push_image(0, ms(2500.0), 1).unwrap();
    let first = m.pop().unwrap();
    assert_eq!((first.imu[0].stamp, first.imu.len()), (ms(1500.0), 201));
}

#[test]
fn stereo_images_are_paired_and_unpaired_ones_dropped() {
    let mut m = merge(MergeConfig { cameras: 2, same_instant_s: 0.001, ..Default::default() });
    m.push_image(0, ms(0.0), 10).unwrap();
    assert_eq!(m.lacks(), Some(Stream::Camera(1)));
    m.push_image(1, ms(0.4), 20).unwrap();
    let first = m.pop().unwrap();
    assert_eq!((first.stamp, first.images), (ms(0.0), vec![10, 20]));
    m.push_image(0, ms(50.0), 11).unwrap();
    m.push_image(1, ms(100.0), 21).unwrap();
    m.push_image(0, ms(100.2), 12).unwrap();
    assert_eq!(m.pop().unwrap().images, [12, 21]);
    assert_eq!(m.counts().unpaired, 1);
    // A camera that stops delivering stops the sets; once it has ended, images waiting for it are dropped.
    for i in 3..9 {
        m.push_image(0, ms(50.0 * i as f64), i).unwrap();
    }
    assert!(m.pop().is_none());
    m.end(Stream::Camera(1));
    assert!(m.pop().is_none());
    assert_eq!(m.counts().unpaired, 7);
}

#[test]
fn depth_is_paired_with_limited_waiting() {
    let mut m = merge(MergeConfig { depth: true, same_instant_s: 0.010, ..Default::default() });
    m.push_image(0, ms(0.0), 1).unwrap();
    assert_eq!(m.lacks(), Some(Stream::Depth));
    m.push_depth(ms(6.0), 100).unwrap();
    assert_eq!(m.pop().unwrap().depth, Some(100));
    // The nearer of two.
    m.push_depth(ms(25.0), 101).unwrap();
    m.push_depth(ms(32.0), 102).unwrap();
    m.push_image(0, ms(33.0), 2).unwrap();
    assert_eq!(m.pop().unwrap().depth, Some(102));
    assert_eq!(m.counts().depth_dropped, 1);
    // A later depth image shows that none will come for this image.
    m.push_image(0, ms(66.0), 3).unwrap();
    m.push_depth(ms(90.0), 103).unwrap();
    assert_eq!(m.pop().unwrap().depth, None);
    // A dead depth sensor delays the sets by no more than the waiting time.
    m.push_image(0, ms(130.0), 4).unwrap();
    assert_eq!(m.lacks(), Some(Stream::Depth));
    m.push_image(0, ms(231.0), 5).unwrap();
    assert_eq!(m.pop().unwrap().images, [4]);
}

#[test]
fn dead_imu_does_not_block_and_old_samples_are_discarded() {
    let mut m = merge(with_imu());
    for i in 0..20 {
        m.push_image(0, ms(33.0 * i as f64), i).unwrap();
    }
    let returned = std::iter::from_fn(|| m.pop()).count();
    assert_eq!(returned, 16, "sets older than the waiting time");
    for i in 0..20_000 {
        m.push_imu(sample(1000.0 + 5.0 * i as f64)).unwrap();
    }
    assert!((7_999..=8_000).contains(&m.counts().imu_given_up), "{:?}", m.counts());
}

/// With delays of up to 40 ms on every stream, in any order, the sets equal those of streams without delay.
#[test]
fn order_of_arrival_does_not_change_the_sets() {
    #[derive(Clone, Copy)]
    enum Item {
        Image(usize, f64),
        Depth(f64),
        Imu(f64),
    }
    let mut items = Vec::new();
    for i in 0..40 {
        let t = 33.3 * i as f64;
        items.extend([Item::Image(0, t), Item::Image(1, t + 0.2), Item::Depth(t - 0.3)]);
    }
    items.extend((0..270).map(|i| Item::Imu(-10.0 + 5.0 * i as f64)));
    let time = |item: &Item| match *item {
        Item::Image(_, t) | Item::Depth(t) | Item::Imu(t) => t,
    };
    let run = |delays: [f64; 4]| {
        let delay = |item: &Item| match item {
            Item::Image(c, _) => delays[*c],
            Item::Depth(_) => delays[2],
            Item::Imu(_) => delays[3],
        };
        let mut order = items.clone();
        order.sort_by(|a, b| (time(a) + delay(a)).total_cmp(&(time(b) + delay(b))));
        let config = MergeConfig { cameras: 2, depth: true, same_instant_s: 0.001, ..with_imu() };
        let (mut m, mut out) = (merge(config), Vec::new());
        for item in order {
            match item {
                Item::Image(c, t) => m.push_image(c, ms(t), (t * 10.0) as u32).unwrap(),
                Item::Depth(t) => m.push_depth(ms(t), (t * 10.0) as u32).unwrap(),
                Item::Imu(t) => assert_eq!(m.push_imu(sample(t)), Ok(None)),
            }
            out.extend(std::iter::from_fn(|| m.pop()));
        }
        out
    };
    let undelayed = run([0.0; 4]);
    assert_eq!(undelayed.len(), 40);
    assert!(undelayed.windows(2).all(|w| w[0].stamp < w[1].stamp));
    for delays in
        [[40.0, 0.0, 0.0, 0.0], [0.0, 13.0, 40.0, 7.0], [0.0, 0.0, 0.0, 40.0], [3.0, 40.0, 1.0, 21.0]]
    {
        assert!(run(delays) == undelayed, "{delays:?}");
    }
}
