//! The EuRoC layout: `mav0/cam0/data/*.png`, `data.csv`, `sensor.yaml`, `imu0`, `state_groundtruth_estimate0`.
//!
//! Source: Burri et al., "The EuRoC micro aerial vehicle datasets" (2016), and the files of the data set.

use super::folder::Folder;
use cairn_geometry::Se3;
use cairn_sensor::{ImuSensor, RigCamera, Source, SourceError};
use std::fmt::Write;
use std::path::Path;

/// Writes the rest of a source and returns how many frames it had. The ground truth is that of the body.
///
/// # Errors
/// When the target is not empty, the source fails or has a depth sensor (the layout has no place for one), or
/// writing fails; then nothing is left behind.
pub fn write_euroc(target: &Path, source: &mut dyn Source) -> Result<usize, SourceError> {
    if source.rig().depth.is_some() {
        let why = "the EuRoC layout has no depth images";
        return Err(SourceError::new(
            &source.info().name,
            why,
            "write the TUM layout, or simulate mono or stereo",
        ));
    }
    let folder = Folder::begin(target)?;
    let rig = source.rig().clone();
    let rate = source.info().rate_hz;
    for (i, camera) in rig.cameras.iter().enumerate() {
        folder.folder(&format!("mav0/cam{i}/data"))?;
        let lens = super::radial_tangential(&camera.name, &camera.camera)?;
        folder.text(&format!("mav0/cam{i}/sensor.yaml"), &camera_yaml(camera, lens, rate))?;
    }
    let mut lists = vec![String::from("#timestamp [ns],filename\n"); rig.cameras.len()];
    let mut imu = String::from(
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n",
    );
    let mut frames = 0;
    while let Some(packet) = source.next_packet()? {
        let t = packet.stamp.0;
        for (i, (image, list)) in packet.images.iter().zip(&mut lists).enumerate() {
            folder.gray(&format!("mav0/cam{i}/data/{t}.png"), image)?;
            let _ = writeln!(list, "{t},{t}.png");
        }
        for s in &packet.imu {
            let (g, a) = (s.gyro, s.accel);
            let _ = writeln!(imu, "{},{},{},{},{},{},{}", s.stamp.0, g.x, g.y, g.z, a.x, a.y, a.z);
        }
        frames += 1;
    }
    for (i, list) in lists.iter().enumerate() {
        folder.text(&format!("mav0/cam{i}/data.csv"), list)?;
    }
    if let Some(sensor) = &rig.imu {
        folder.folder("mav0/imu0")?;
        folder.text("mav0/imu0/sensor.yaml", &imu_yaml(sensor))?;
        folder.text("mav0/imu0/data.csv", &imu)?;
    }
    if !source.info().truth.is_empty() {
        let at = "mav0/state_groundtruth_estimate0";
        folder.folder(at)?;
        let mut csv = String::from(
            "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n",
        );
        for (stamp, pose) in &source.info().truth {
            let (p, q) = (pose.translation, pose.rotation.quaternion());
            let _ = writeln!(csv, "{},{},{},{},{},{},{},{}", stamp.0, p.x, p.y, p.z, q.w, q.i, q.j, q.k);
        }
        folder.text(&format!("{at}/data.csv"), &csv)?;
        folder.text(
            &format!("{at}/sensor.yaml"),
            &format!("sensor_type: visual-inertial\ncomment: exact\n{}", extrinsics(&Se3::identity())),
        )?;
    }
    folder.text("mav0/body.yaml", &format!("comment: {}\n", source.info().name))?;
    folder.finish()?;
    Ok(frames)
}

fn extrinsics(body_from_sensor: &Se3) -> String {
    let m = body_from_sensor.matrix();
    let rows: Vec<String> =
        (0..4).map(|r| (0..4).map(|c| format!("{:?}", m[(r, c)])).collect::<Vec<_>>().join(", ")).collect();
    format!("T_BS:\n  cols: 4\n  rows: 4\n  data: [{}]\n", rows.join(",\n         "))
}

fn camera_yaml(c: &RigCamera, coefficients: [f64; 4], rate_hz: f64) -> String {
    let k = &c.camera;
    format!(
        "sensor_type: camera\ncomment: {}\n{}rate_hz: {rate_hz:?}\nresolution: [{}, {}]\ncamera_model: pinhole\nintrinsics: [{:?}, {:?}, {:?}, {:?}] #fu, fv, cu, cv\ndistortion_model: radial-tangential\ndistortion_coefficients: {coefficients:?}\n",
        c.name,
        extrinsics(&c.body_from_camera),
        k.width,
        k.height,
        k.fx,
        k.fy,
        k.cx,
        k.cy,
    )
}

fn imu_yaml(s: &ImuSensor) -> String {
    let n = &s.noise;
    format!(
        "sensor_type: imu\ncomment: simulated\n{}rate_hz: {:?}\ngyroscope_noise_density: {:?}\ngyroscope_random_walk: {:?}\naccelerometer_noise_density: {:?}\naccelerometer_random_walk: {:?}\n",
        extrinsics(&s.body_from_imu),
        s.rate_hz,
        n.gyro,
        n.gyro_walk,
        n.accel,
        n.accel_walk,
    )
}
