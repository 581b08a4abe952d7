//! Two-view initialisation on recordings, against the ground-truth motion.

use crate::common;

use cairn_sensor::{FramePacket, Rig, Stamp};
use cairn_vision::{
    Frame, FrontEnd, FrontEndConfig, OrbConfig, SensorMode, TwoViewConfig, best_two_of, two_view,
};
use common::recordings::{Shot, euroc_rig, euroc_shots, jpeg, kitti_rig, kitti_shots};

/// Tries pairs `apart` frames apart; prints how many initialise and their errors; returns `[tried, initialised,
/// wrong]`.
fn initialise_pairs(name: &str, rig: &Rig, shots: &[Shot], apart: usize, every: usize) -> [usize; 3] {
    let orb = OrbConfig { features: 2000, ..OrbConfig::default() };
    let mut camera =
        FrontEnd::new(rig, SensorMode::Mono, FrontEndConfig { orb, ..FrontEndConfig::default() }).unwrap();
    let model = *camera.model();
    let mut extract = |s: &Shot| -> Frame {
        let images = vec![jpeg(&s.0)];
        camera
            .extract(&FramePacket { stamp: Stamp(0), images, depth: None, imu: vec![], decode_ms: 0.0 })
            .unwrap()
    };
    let (mut tried, mut wrong) = (0, 0);
    let (mut rotation_errors, mut directions, mut points, mut rejected) = (vec![], vec![], 0, vec![]);
    let mut fastest = f64::INFINITY;
    for k in (0..shots.len() - apart).step_by(every) {
        let (a, b) = (extract(&shots[k]), extract(&shots[k + apart]));
        let (mut first, mut second) = (vec![], vec![]);
        for i in 0..a.len() {
            let m = best_two_of(&a.descriptors[i], &b.descriptors);
            if m.distance <= 50 && m.distance * 10 <= m.second * 9 {
                first.push(a.px[i]);
                second.push(b.px[m.index as usize]);
            }
        }
        let t = model.body_from_camera;
        let truth = t.inverse() * shots[k + apart].2.inverse() * shots[k].2 * t;
        tried += 1;
        let start = std::time::Instant::now();
        let result = two_view(&model, &first, &second, &TwoViewConfig::default(), k as u64);
        fastest = fastest.min(start.elapsed().as_secs_f64() * 1e3);
        match result {
            Ok(r) => {
                let rotation = (r.second_from_first.rotation.inverse() * truth.rotation).angle().to_degrees();
                let cosine = r.second_from_first.translation.dot(&truth.translation.normalize());
                let direction = cosine.clamp(-1.0, 1.0).acos().to_degrees();
                wrong += usize::from(rotation > 1.5 || direction > 20.0);
                rotation_errors.push(rotation);
                directions.push(direction);
                points += r.point_count();
            }
            Err(e) => rejected.push(e.reason),
        }
    }
    let median = |v: &mut Vec<f64>| {
        v.sort_by(f64::total_cmp);
        v.get(v.len() / 2).copied().unwrap_or(f64::NAN)
    };
    println!(
        "{name}, {apart} frames apart: {} of {tried} initialise, {wrong} wrong; rotation {:.2} deg, direction {:.1} deg (medians), \
         {} points; fastest {fastest:.1} ms; rejected {rejected:?}",
        rotation_errors.len(),
        median(&mut rotation_errors),
        median(&mut directions),
        points / rotation_errors.len().max(1)
    );
    [tried, rotation_errors.len(), wrong]
}

#[test]
fn kitti_initialises() {
    let Some(shots) = kitti_shots() else { return };
    for apart in [1, 2, 4] {
        let [tried, started, wrong] = initialise_pairs("kitti-a", &kitti_rig(), &shots, apart, 3);
        assert!(started * 2 > tried && wrong == 0);
    }
}

#[test]
fn euroc_initialises() {
    let Some(shots) = euroc_shots() else { return };
    let shots = &shots[..280.min(shots.len())];
    let mut sum = [0; 3];
    for apart in [5, 10, 20] {
        let n = initialise_pairs("euroc-mh01", &euroc_rig(), shots, apart, 15);
        sum = [sum[0] + n[0], sum[1] + n[1], sum[2] + n[2]];
    }
    assert!(sum[1] * 4 > sum[0] && sum[2] * 20 <= sum[1], "{sum:?}");
}
