//! `cairn ekf --script`: the robot of a log records routes and is guided along them, as commands ask.

use super::Arguments;
use crate::failure::Failure;
use crate::output::Output;
use cairn_filter::ekf::EkfConfig;
use cairn_filter::log::{Log, Step, Target};
use cairn_filter::run::noise_of;
use cairn_guide::length;
use cairn_sensor::{FramePacket, Stamp};
use cairn_session::{Command, Event, Script, Session, SessionConfig, Wheels};
use serde::Serialize;
use std::path::Path;

/// Largest script.
const MOST_BYTES: u64 = 16 << 20;
/// Seconds between two poses where nothing is seen.
const STEP_S: f64 = 0.1;

#[derive(Serialize)]
struct Walked {
    log: String,
    robot: String,
    seconds: f64,
    /// Steps of the filter, and those at which it knew where the robot is.
    steps: usize,
    tracked: usize,
    beacons: usize,
    said: Vec<Said>,
    routes: Vec<Recorded>,
    arrived: bool,
}

#[derive(Serialize)]
struct Said {
    t_s: f64,
    text: String,
}

#[derive(Serialize)]
struct Recorded {
    file: Option<String>,
    points: usize,
    metres: f64,
}

/// The commands of `--script`.
pub fn script(path: &Path) -> Result<Script, Failure> {
    let shown = path.display().to_string();
    let text = cairn_files::read_text(path, MOST_BYTES)
        .map_err(|e| Failure::new(&shown, e.to_string(), "check the path"))?;
    Script::parse(&text)
        .map_err(|e| Failure::new(format!("{shown}, line {}", e.line), e.why, "see cairn ekf --help"))
}

/// Drives the first robot of a log through a session.
pub fn run(
    a: &Arguments,
    log: &Log,
    config: EkfConfig,
    mut script: Script,
    output: &Output,
) -> Result<(), Failure> {
    let Some(robot) = log.robots.first() else {
        return Err(Failure::new(&log.name, "it has no robot", "give another log"));
    };
    let failed = |why: String| Failure::new(&robot.name, why, "check the noise of the log");
    let wheels = Wheels::new(config).map_err(|e| failed(e.to_string()))?;
    let session = SessionConfig {
        folder: a.routes.clone(),
        source: a.log.display().to_string(),
        phrases: a.speaking.phrases(),
        announcer: a.speaking.announcer(),
        ..SessionConfig::default()
    };
    let mut session = Session::new(wheels, session);
    let noise = noise_of(log, robot, &config);
    let ends = [robot.entries.first(), robot.entries.last()].map(|e| e.map_or(0.0, |e| e.time_s));
    let cuts: Vec<f64> =
        (0..).map(|k| ends[0] + STEP_S * f64::from(k)).take_while(|t| *t < ends[1]).collect();
    let steps = robot.steps(&noise, &cuts).map_err(|e| failed(e.to_string()))?;
    let (mut said, mut driven, mut seconds) = (Vec::new(), 0, 0.0);
    for step in steps {
        (driven, seconds) = (driven + 1, step.time_s - ends[0]);
        if !drive(&mut session, step, &mut script, &mut said, output)? || crate::interrupt::requested() {
            break;
        }
    }
    let closed = session.close();
    let routes = session.recorded().map(|(path, route)| Recorded {
        file: path.map(|p| p.display().to_string()),
        points: route.points.len(),
        metres: length(route.points.iter().map(|p| p.anchor_from_camera.translation)),
    });
    let walked = Walked {
        log: log.name.clone(),
        robot: robot.name.clone(),
        seconds,
        steps: driven,
        tracked: session.tracked(),
        beacons: session.engine().filter().landmarks().len(),
        routes: routes.collect(),
        arrived: session.has_arrived(),
        said,
    };
    output.result(&walked, text)?;
    closed.map_err(|e| {
        Failure::new(a.routes.display().to_string(), e.to_string(), "make room, or give another --routes")
    })
}

/// One step; false after "quit".
fn drive(
    session: &mut Session<Wheels>,
    mut step: Step,
    script: &mut Script,
    said: &mut Vec<Said>,
    output: &Output,
) -> Result<bool, Failure> {
    // The filter knows one robot.
    step.sightings.retain(|s| !matches!(s.target, Target::Robot(_)));
    let stamp = Stamp::from_seconds(step.time_s);
    session.engine_mut().measured(step);
    let packet = FramePacket { stamp, images: Vec::new(), depth: None, imu: Vec::new(), decode_ms: 0.0 };
    session
        .on_packet(&packet)
        .map_err(|e| Failure::new(format!("{:.2} s", stamp.seconds()), e.to_string(), "check the log"))?;
    let mut goes_on = true;
    for command in script.due(session) {
        if let Err(why) = session.command(&command) {
            crate::output::warn(&why.words);
        }
        goes_on &= command != Command::Quit;
    }
    for event in session.events() {
        if let Event::Said(words) = event {
            output.text(&format!("{:8.1} s  {}", words.t_s, words.text))?;
            said.push(Said { t_s: words.t_s, text: words.text });
        }
    }
    Ok(goes_on)
}

fn text(w: &Walked) -> String {
    let mut lines = vec![
        format!("{}, {}", w.log, w.robot),
        format!("  place known  {} of {} steps in {:.0} s", w.tracked, w.steps, w.seconds),
        format!("  beacons      {}", w.beacons),
    ];
    let routes = w.routes.iter().map(|r| {
        let file = r.file.as_deref().unwrap_or("not in a file");
        format!("  route        {:.1} m, {} points, {file}", r.metres, r.points)
    });
    lines.extend(routes);
    lines.join("\n")
}
