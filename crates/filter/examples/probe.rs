//! probe
use cairn_filter::{ekf::*, log::*};
use cairn_filter::covariance::Form;
use cairn_geometry::*;
use nalgebra::Matrix3;
fn main() {
    let base = std::env::args().nth(1).unwrap_or("/work/shared/data/ekf/mrclam1".into());
    let read = |n: String| std::fs::read_to_string(format!("{base}/{n}")).unwrap();
    let (b, s) = (read("Barcodes.dat".into()), read("Landmark_Groundtruth.dat".into()));
    for r in 1..=3u32 {
        let (o, m) = (read(format!("Robot{r}_Odometry.dat")), read(format!("Robot{r}_Measurement.dat")));
        let log = parse_mrclam(("b", &b), Some(("s", &s)), &[(r, ("o", &o), ("m", &m))]).unwrap();
        for p in [[0.01, 0.1, 0.0, 0.02, 0.0, 0.2, 0.05, 0.05, 0.04, 0.2], [0.005, 0.07, 0.02, 0.01, 0.02, 0.1, 0.05, 0.05, 0.02, 0.2], [0.0035, 0.05, 0.02, 0.0035, 0.02, 0.05, 0.1, 0.05, 0.02, 0.21], [0.0035, 0.07, 0.02, 0.005, 0.03, 0.1, 0.1, 0.08, 0.015, 0.2]] {
        let mut log = log.clone();
            let noise = &mut log.noise;
            noise.velocity = cairn_filter::motion::VelocityModel { speed: p[0], speed_by_speed: p[1], speed_by_turn: p[2], turn: p[3], turn_by_speed: p[4], turn_by_turn: p[5] };
            noise.range_m = p[6]; noise.range_by_range = p[7]; noise.bearing_rad = p[8]; noise.sighting_delay_s = p[9];
        for (gate, assoc, form, local) in [(3.0, Association::Known, Form::Joseph, None), (6.0, Association::Known, Form::Joseph, None), (9.0, Association::Known, Form::Joseph, None), (14.0, Association::Known, Form::Joseph, None), (1e9, Association::Known, Form::Joseph, None), (9.0, Association::Known, Form::SquareRoot, None),
            (9.0, Association::Known, Form::Joseph, Some(4.0)), (9.0, Association::Nearest, Form::Joseph, None), (9.0, Association::Joint, Form::Joseph, None)] {
            let t0 = std::time::Instant::now();
            let steps = log.robots[0].steps(&log.noise, &[]).unwrap();
            let t1 = t0.elapsed();
            let mut f = EkfSlam::new(EkfConfig { association: assoc, form, local_radius_m: local, ..Default::default() }.with_gate_of_two(gate));
            let id = f.add_robot(&Se2::identity(), &(Matrix3::identity() * 1e-12)).unwrap();
            let (mut nis, mut n, mut rej) = (0.0, 0.0, 0);
            let mut votes: std::collections::BTreeMap<LandmarkId, std::collections::BTreeMap<u32, usize>> = Default::default();
            for step in &steps {
                f.predict(id, &step.motion).unwrap();
                let si: Vec<Sighting> = step.sightings.iter().filter(|s| matches!(s.target, Target::Landmark(_))).copied().collect();
                for (s, v) in si.iter().zip(f.observe(id, &si).unwrap()) {
                    let Target::Landmark(l) = s.target else { continue };
                    match v { Verdict::Taken{nis: a, dof, landmark} => {nis += a; n += dof as f64; *votes.entry(landmark.unwrap()).or_default().entry(l).or_default() += 1;}, Verdict::New{landmark} => { *votes.entry(landmark).or_default().entry(l).or_default() += 1; }  Verdict::Rejected{..}|Verdict::Ambiguous{..} => rej += 1, _=>{} }
                }
            }
            let el = t0.elapsed();
            let (mut right, mut all) = (0, 0);
            for v in votes.values() { right += v.values().max().unwrap(); all += v.values().sum::<usize>(); }
            let name = |i: LandmarkId| votes.get(&i).and_then(|v| v.iter().max_by_key(|x| x.1)).map(|x| *x.0);
            let lms = f.landmarks();
            let pairs: Vec<(Vec2, Vec2)> = lms.iter().filter(|l| l.confirmed).filter_map(|l| Some((*log.surveyed.get(&name(l.id)?)?, l.position))).collect();
            println!("robot {r} gate {gate} {assoc:?} {form:?} {local:?} steps {} landmarks {} conf {} rmse {:.4} nis/dof {:.2} taken {n} rej {rej} rec {} steps {t1:.0?} all {el:.0?} wrong {:.3}%", steps.len(), lms.len(), pairs.len(), rmse(&pairs), nis / n, f.recoveries(), 100.0 * (1.0 - right as f64 / all as f64));
        }}
    }
}
fn rmse(pairs: &[(Vec2, Vec2)]) -> f64 {
    let n = pairs.len() as f64;
    let ca = pairs.iter().map(|p| p.0).sum::<Vec2>() / n;
    let cb = pairs.iter().map(|p| p.1).sum::<Vec2>() / n;
    let (mut s, mut c) = (0.0, 0.0);
    for (a, b) in pairs { let (a, b) = (a - ca, b - cb); c += a.dot(&b); s += b.x * a.y - b.y * a.x; }
    let r = So2::exp(s.atan2(c));
    (pairs.iter().map(|(a, b)| (a - ca - r * (b - cb)).norm_squared()).sum::<f64>() / n).sqrt()
}
