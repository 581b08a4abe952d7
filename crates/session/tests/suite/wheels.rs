//! A wheeled robot among beacons records a route and is guided back along it: the filter tracks instead of the visual engine.

use cairn_filter::ekf::EkfConfig;
use cairn_filter::log::{Sighting, Step, Target};
use cairn_filter::measure::{Kind, Measurement, expected};
use cairn_filter::motion::VelocityModel;
use cairn_geometry::{Se2, Vec2};
use cairn_random::Random;
use cairn_sensor::{FramePacket, Stamp};
use cairn_session::{Command, Event, Refused, Session, SessionConfig, Wheels};
use nalgebra::Vector3;

/// Seconds from step to step, and the speed in m/s.
const DT_S: f64 = 0.1;
const SPEED: f64 = 0.6;

/// Poor wheels, by the deviation of their turn in rad/sqrt(s): they drift by metres on the way.
fn wheels(turn: f64) -> VelocityModel {
    VelocityModel {
        speed: 0.05,
        speed_by_speed: 0.0,
        speed_by_turn: 0.0,
        turn,
        turn_by_speed: 0.0,
        turn_by_turn: 0.0,
    }
}

struct Robot {
    truth: Se2,
    by_wheels: Se2,
    time_s: f64,
    kind: Kind,
    wheels: VelocityModel,
    beacons: Vec<Vec2>,
    random: Random,
    session: Session<Wheels>,
    said: Vec<String>,
}

impl Robot {
    fn new(kind: Kind, turn: f64, beacons: Vec<Vec2>) -> Self {
        let folder = std::env::temp_dir().join(format!("cairn-wheels-{}-{kind:?}", std::process::id()));
        let config = SessionConfig { folder, ..SessionConfig::default() };
        let session = Session::new(Wheels::new(EkfConfig::default()).unwrap(), config);
        let (truth, by_wheels) = (Se2::identity(), Se2::identity());
        Self {
            truth,
            by_wheels,
            time_s: 0.0,
            kind,
            wheels: wheels(turn),
            beacons,
            random: Random::new(5),
            session,
            said: Vec::new(),
        }
    }

    fn ask(&mut self, line: &str) -> Result<String, Refused> {
        self.session.command(&Command::parse(line).unwrap())
    }

    /// Drives for one step at these velocities; the wheels measure them with their noise.
    fn step(&mut self, speed_m_s: f64, turn_rad_s: f64) {
        let (noise_v, noise_w) = (self.wheels.speed / DT_S.sqrt(), self.wheels.turn / DT_S.sqrt());
        self.truth = self.truth * self.wheels.motion(speed_m_s, turn_rad_s, DT_S).before_from_after;
        let measured = self.wheels.motion(
            speed_m_s + noise_v * self.random.standard_normal(),
            turn_rad_s + noise_w * self.random.standard_normal(),
            DT_S,
        );
        self.by_wheels = self.by_wheels * measured.before_from_after;
        self.time_s += DT_S;
        let at = Vector3::new(self.truth.translation.x, self.truth.translation.y, self.truth.rotation.log());
        let mut sightings = Vec::new();
        for (k, beacon) in self.beacons.iter().enumerate() {
            let z = expected(self.kind, &at, &beacon.push(0.0));
            if (beacon - at.xy()).norm() > 9.0 {
                continue;
            }
            let range = (z.x + 0.05 * self.random.standard_normal()).max(0.0);
            let measurement = match self.kind {
                Kind::Range => Measurement::range(range, 0.05),
                _ => {
                    Measurement::range_bearing(range, z.y + 0.02 * self.random.standard_normal(), 0.05, 0.02)
                }
            };
            sightings
                .push(Sighting { target: Target::Landmark(k as u32), measurement: measurement.unwrap() });
        }
        self.session.engine_mut().measured(Step { time_s: self.time_s, motion: measured, sightings });
        let stamp = Stamp::from_seconds(self.time_s);
        let packet = FramePacket { stamp, images: Vec::new(), depth: None, imu: Vec::new(), decode_ms: 0.0 };
        self.session.on_packet(&packet).unwrap();
        for event in self.session.events() {
            if let Event::Said(said) = event {
                self.said.push(said.text);
            }
        }
    }

    fn has_arrived(&self) -> bool {
        self.said.iter().any(|s| s.contains("You have arrived"))
    }

    /// Drives along a line by the truth; stops when guidance has arrived.
    fn drive(&mut self, line: &[Vec2]) {
        for to in line {
            while (to - self.truth.translation).norm() > 0.3 {
                let seen = self.truth.inverse() * *to;
                let bearing = seen.y.atan2(seen.x);
                let speed = if bearing.abs() > 0.5 { 0.0 } else { SPEED };
                self.step(speed, bearing.clamp(-0.6, 0.6));
                if self.has_arrived() {
                    return;
                }
                assert!(self.time_s < 300.0, "{:?}", self.truth);
            }
        }
    }
}

#[test]
fn a_robot_among_beacons_records_a_route_and_is_guided_home() {
    let beacons: Vec<Vec2> = [
        (3.0, 3.0),
        (6.0, -3.0),
        (10.0, 2.5),
        (15.0, -1.0),
        (15.0, 5.0),
        (9.0, 8.0),
        (14.0, 11.0),
        (10.0, 13.0),
    ]
    .map(|(x, y)| Vec2::new(x, y))
    .to_vec();
    // Beacons of which only the range is known need better wheels until they are placed.
    for (kind, turn) in [(Kind::RangeBearing, 0.06), (Kind::Range, 0.03)] {
        let mut robot = Robot::new(kind, turn, beacons.clone());
        robot.step(0.0, 0.0);
        robot.ask("record").unwrap();
        robot.drive(&[Vec2::new(12.0, 0.0), Vec2::new(12.0, 12.0)]);
        robot.ask("stop").unwrap();
        robot.said.clear();
        robot.ask("guide home").unwrap();
        robot.drive(&[Vec2::new(12.0, 0.0), Vec2::new(-2.0, 0.0)]);
        let off_m = robot.truth.translation.norm();
        let drift_m = (robot.by_wheels.translation - robot.truth.translation).norm();
        println!(
            "{kind:?}: arrived {off_m:.2} m from the start, the wheels are {drift_m:.1} m off; {:?}",
            robot.said
        );
        assert!(robot.has_arrived(), "{:?}", robot.said);
        assert!(off_m < 1.2, "{kind:?}: {off_m} m");
        assert!(drift_m > 2.0, "{kind:?}: the wheels alone would do: {drift_m} m");
        let says = |words: &str| robot.said.iter().any(|s| s.contains(words));
        assert!(says("25 metres") && says("turn right"), "{:?}", robot.said);
    }
}

#[test]
fn without_beacons_the_place_is_lost_and_that_is_said() {
    let mut robot = Robot::new(Kind::RangeBearing, 0.06, Vec::new());
    robot.step(0.0, 0.0);
    robot.ask("record").unwrap();
    for _ in 0..3000 {
        robot.step(SPEED, 0.0);
    }
    assert!(!robot.session.engine_status().valid, "{:?}", robot.session.engine_status());
    assert!(robot.said.iter().any(|s| s.contains("lost my place")), "{:?}", robot.said);
}
