//! `cairn demo --robot`: prints how robots fared in an unknown apartment, and writes a page about one of them.

use crate::failure::Failure;
use crate::interrupt;
use crate::output::Output;
use crate::outputs::Outputs;
use crate::progress::Progress;
use cairn_eval::{Figure, Marker, Page, Percentiles, Plan, PlanLine, Tone, process};
use cairn_geometry::Vec2;
use cairn_sources::std_host;
use cairn_trial::robot::{Collision, End, Goal, Moment, RobotConfig, Touched, Trial};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The files of a demo, in its folder.
const FILES: [&str; 3] = ["report.html", "plan.svg", "demo.json"];

/// The figures of one robot.
#[derive(Clone, Debug, Serialize)]
struct Figures {
    seed: u64,
    /// All goals reached without a collision.
    passed: bool,
    goals: Vec<Goal>,
    collisions: Vec<Collision>,
    /// Least distance from the rim of the robot to a wall and to a person, metres.
    wall_clearance_m: f64,
    person_clearance_m: f64,
    explored_s: f64,
    /// Share of the floor where the robot fits that it knows to be free.
    known: f64,
    /// When the door closed, seconds.
    door_closed_s: Option<f64>,
    driven_m: f64,
    plans: usize,
    /// Root mean square and greatest error of the position, metres.
    position_rmse_m: f64,
    position_max_m: f64,
    /// Frames that were not tracked, and those whose tracked pose was not that of the wheels.
    lost: usize,
    refused: usize,
    loops: usize,
    /// Milliseconds from image to pose, and of mapping the ground and deciding.
    step_ms: Option<Percentiles>,
    plan_ms: Option<Percentiles>,
    /// Simulated time.
    drive_s: f64,
    wall_s: f64,
    cpu_s: Option<f64>,
}

/// Runs one robot, prints its figures and writes its page.
///
/// # Errors
/// When the trial fails, a file cannot be written, or the robot collided or did not reach a goal.
pub fn one(seed: u64, folder: &Path, overwrite: bool, output: &Output) -> Result<(), Failure> {
    let elsewhere = |f: Failure| Failure { hint: "choose another folder with --out".into(), ..f };
    crate::outputs::folder(folder).map_err(elsewhere)?;
    let made = folder.to_owned();
    interrupt::before_exit(move || drop(std::fs::remove_dir(&made)));
    let paths = FILES.map(|name| (name, folder.join(name)));
    let add = |outputs: Outputs, (name, path): &(&'static str, PathBuf)| outputs.output(name, Some(path));
    let outputs = paths.iter().fold(Outputs::new(overwrite), add).checked()?;
    let (figures, end) = run(seed)?;
    interrupt::in_order();
    let plan = plan(&figures, &end);
    let json = serde_json::to_string_pretty(&figures).map_err(|e| bug(e.to_string()))?;
    let contents =
        [page(&figures, &end, &plan).into_bytes(), plan.standalone().into_bytes(), json.into_bytes()];
    let written = FILES.into_iter().zip(contents).map(|(name, bytes)| outputs.write(name, || Ok(bytes)));
    Failure::all(written.filter_map(Result::err))?;
    let report = folder.join("report.html");
    let text = |f: &Figures| format!("{}\nreport     {}", summary(f), report.display());
    if figures.passed {
        return output.result(&figures, text);
    }
    output.text(&text(&figures))?;
    Err(Failure::new("the robot", why(&figures), format!("see {} for what happened", report.display())))
}

/// The results of many robots.
#[derive(Serialize)]
struct Tally {
    runs: usize,
    /// Robots that touched something.
    collided: usize,
    /// Robots that reached all three goals.
    reached: usize,
    each: Vec<Figures>,
}

/// Runs robots with several seeds and prints a row as each ends.
///
/// # Errors
/// When a trial fails, or a robot collided or did not reach a goal.
pub fn many(seeds: impl Iterator<Item = u64>, output: &Output) -> Result<(), Failure> {
    output.text(HEAD)?;
    let mut each = Vec::new();
    for seed in seeds {
        let (figures, _) = run(seed)?;
        output.text(&row(&figures))?;
        each.push(figures);
    }
    let tally = Tally {
        runs: each.len(),
        collided: each.iter().filter(|f| !f.collisions.is_empty()).count(),
        reached: each.iter().filter(|f| f.goals.iter().all(|g| g.reached)).count(),
        each,
    };
    let text = |t: &Tally| format!("{} of {} reached all goals, {} collided", t.reached, t.runs, t.collided);
    if tally.each.iter().all(|f| f.passed) {
        return output.result(&tally, text);
    }
    output.text(&text(&tally))?;
    Err(Failure::new(
        "the robots",
        text(&tally),
        "run cairn demo --robot --seed N with a seed that failed and look at its report",
    ))
}

fn run(seed: u64) -> Result<(Figures, End), Failure> {
    let (began, cpu) = (Instant::now(), process::cpu_s());
    let progress = Progress::new(Some(100));
    let config = RobotConfig::new(seed);
    let most_s = config.explore_s;
    let failed = |e: cairn_trial::robot::TrialError| bug(e.to_string());
    let trial = Trial::new(config, &std_host()).map_err(failed)?;
    let end = trial
        .run(|p| {
            progress.step(
                (if p.goals > 0 { 60 + 13 * p.goals } else { (60.0 * p.t_s / most_s) as usize }).min(99),
            )
        })
        .map_err(failed)?;
    drop(progress);
    let figures = Figures {
        seed,
        passed: end.collisions.is_empty() && end.goals.iter().all(|g| g.reached),
        goals: end.goals.clone(),
        collisions: end.collisions.clone(),
        wall_clearance_m: end.clearance_m[0],
        person_clearance_m: end.clearance_m[1],
        explored_s: end.explored_s,
        known: end.known,
        door_closed_s: end.door_closed_s,
        driven_m: end.driven_m,
        plans: end.plans,
        position_rmse_m: end.position_error_m[0],
        position_max_m: end.position_error_m[1],
        lost: end.lost,
        refused: end.refused,
        loops: end.loops[0],
        step_ms: Percentiles::of(&end.step_ms),
        plan_ms: Percentiles::of(&end.plan_ms),
        drive_s: end.seconds,
        wall_s: began.elapsed().as_secs_f64(),
        cpu_s: process::cpu_s().zip(cpu).map(|(now, before)| now - before),
    };
    Ok((figures, end))
}

fn bug(why: String) -> Failure {
    Failure::new("the robot", why, "report this with the command line")
}

/// What went wrong, in a sentence.
fn why(f: &Figures) -> String {
    let touched = f.collisions.iter().map(|c| format!("touched {} at {:.1} s", what(c.with), c.t_s));
    let missed = f.goals.iter().filter(|g| !g.reached).map(|g| {
        let reason = g.reason.as_deref().map_or_else(String::new, |r| format!(" ({r})"));
        format!("{}: {}, {:.2} m from the goal{reason}", g.name, g.state, g.error_m)
    });
    touched.chain(missed).collect::<Vec<_>>().join("; ")
}

fn what(touched: Touched) -> &'static str {
    match touched {
        Touched::Wall => "a wall or furniture",
        Touched::Person => "a person",
    }
}

const HEAD: &str = "seed  reached  touched  wall m  person m  explored s  known  driven m  plans  error m    max  lost  refused  loops  drive s  cpu s";

fn row(f: &Figures) -> String {
    let reached = f.goals.iter().filter(|g| g.reached).count();
    let mut text = format!(
        "{:>4}  {:>7}  {:>7}  {:>6.2}  {:>8.2}  {:>10.0}  {:>5.3}  {:>8.1}  {:>5}  {:>7.3}  {:>5.3}  {:>4}  {:>7}  {:>5}  {:>7.0}  {:>5.0}",
        f.seed,
        format!("{reached} of {}", f.goals.len()),
        f.collisions.len(),
        f.wall_clearance_m,
        f.person_clearance_m,
        f.explored_s,
        f.known,
        f.driven_m,
        f.plans,
        f.position_rmse_m,
        f.position_max_m,
        f.lost,
        f.refused,
        f.loops,
        f.drive_s,
        f.cpu_s.unwrap_or(f.wall_s)
    );
    if !f.passed {
        let _ = write!(text, "\n      {}", why(f));
    }
    text
}

fn summary(f: &Figures) -> String {
    let mut lines = vec![format!(
        "explored   {:.0} s, {:.1} % of the floor where it fits is known",
        f.explored_s,
        100.0 * f.known
    )];
    for g in &f.goals {
        let reason = g.reason.as_deref().map_or_else(String::new, |r| format!(": {r}"));
        lines.push(format!(
            "goal       {}, {} after {:.0} s{}, {:.2} m from it{reason}",
            g.name,
            g.state,
            g.seconds,
            if g.tries > 1 { " in two tries" } else { "" },
            g.error_m
        ));
    }
    let door = f.door_closed_s.map_or("stayed open".to_owned(), |t| format!("closed at {t:.0} s"));
    lines.push(format!("door       {door}"));
    let touched: Vec<String> =
        f.collisions.iter().map(|c| format!("{} at {:.1} s", what(c.with), c.t_s)).collect();
    let touched = if touched.is_empty() { "nothing".to_owned() } else { touched.join(", ") };
    lines.push(format!(
        "touched    {touched}; {:.2} m to walls and {:.2} m to people at least",
        f.wall_clearance_m, f.person_clearance_m
    ));
    lines.push(format!("driven     {:.1} m in {:.0} s, {} paths planned", f.driven_m, f.drive_s, f.plans));
    lines.push(format!(
        "position   {:.3} m RMS from the truth, {:.3} m at most; {} frames lost, {} refused, {} loops closed",
        f.position_rmse_m, f.position_max_m, f.lost, f.refused, f.loops
    ));
    for (name, ms) in [("step", &f.step_ms), ("plan", &f.plan_ms)] {
        lines.extend(ms.as_ref().map(|ms| format!("{name:<10} {ms} ms per frame")));
    }
    let cpu = f.cpu_s.map_or_else(String::new, |s| format!(", {s:.1} s of processor time"));
    lines.push(format!("time       {:.1} s{cpu}", f.wall_s));
    lines.join("\n")
}

/// The apartment from above: true walls, the robot's map as dots, its true paths.
fn plan(f: &Figures, end: &End) -> Figure {
    let dots = end.map.as_ref().map_or_else(Vec::new, |map| {
        let frame = map.frame();
        let occupied = map.values().iter().enumerate().filter(|(_, v)| **v == 100);
        occupied.map(|(i, _)| frame.centre(frame.cell(i))).collect::<Vec<Vec2>>()
    });
    let line = |label: &str, tone, of: &dyn Fn(&Moment) -> bool| PlanLine {
        label: label.to_owned(),
        points: end.path.iter().filter(|m| of(m)).map(|m| m.truth.translation).collect(),
        tone,
        arrows: true,
        ..PlanLine::default()
    };
    let mut lines = vec![PlanLine {
        arrows: false,
        dashed: true,
        ..line("exploring", Tone::Truth, &|m| m.goal.is_none())
    }];
    for (k, goal) in f.goals.iter().enumerate() {
        let tone = [Tone::First, Tone::Second, Tone::Third][k % 3];
        lines.push(line(&format!("to the {}", goal.name), tone, &|m| m.goal == Some(k)));
    }
    lines.retain(|l| l.points.len() > 1);
    let goals = f.goals.iter().map(|g| Marker { label: g.name.clone(), at: g.at.into(), tone: Tone::Second });
    let start = end.path.first().map(|m| Marker {
        label: "start".into(),
        at: m.truth.translation,
        tone: Tone::Third,
    });
    let touches =
        f.collisions.iter().map(|c| Marker { label: "touched".into(), at: c.at.into(), tone: Tone::First });
    let plan = Plan {
        title: format!("A robot in an apartment, seed {}", f.seed),
        description: format!(
            "An apartment seen from above. Grey lines are its true walls and furniture, dots the occupied cells of the \
             robot's map. It explored for {:.0} s and then drove to {} rooms.",
            f.explored_s,
            f.goals.len()
        ),
        walls: end.world.plan().iter().map(|(a, b)| [*a, *b]).collect(),
        dots,
        dots_label: "occupied in its map".into(),
        circles: end.targets.iter().map(|(_, at, _)| *at).collect(),
        circles_label: "frontiers driven to".into(),
        lines,
        markers: goals.chain(start).chain(touches).collect(),
        ..Plan::default()
    };
    plan.figure()
}

fn page(f: &Figures, end: &End, plan: &Figure) -> String {
    let reached = f.goals.iter().filter(|g| g.reached).count();
    let lead = format!(
        "A robot with a small RGB-D camera explored an apartment that it did not know, and reached {reached} of {} rooms \
         while people walked about and a door closed. It touched {} times.",
        f.goals.len(),
        f.collisions.len()
    );
    let mut page = Page::new(&format!("A robot in an apartment, seed {}", f.seed), &lead);
    page.heading("Summary");
    page.facts(&[
        ("Goals reached", &format!("{reached} of {}", f.goals.len())),
        ("Touched", &f.collisions.len().to_string()),
        ("Nearest to a wall", &format!("{:.2} m", f.wall_clearance_m)),
        ("Nearest to a person", &format!("{:.2} m", f.person_clearance_m)),
        ("Explored", &format!("{:.0} s", f.explored_s)),
        ("Floor known", &format!("{:.1} %", 100.0 * f.known)),
        ("Driven", &format!("{:.1} m", f.driven_m)),
        ("Position, RMS", &format!("{:.3} m", f.position_rmse_m)),
        ("Paths planned", &f.plans.to_string()),
    ]);
    page.heading("The drive");
    page.figure(
        plan,
        "True walls and true paths; the robot's map is laid into the world by where it was switched on, without alignment.",
    );
    page.heading("Goals");
    let rows: Vec<Vec<String>> = (f.goals.iter())
        .map(|g| {
            let reason = g.reason.clone().unwrap_or_default();
            vec![
                g.name.clone(),
                g.state.clone(),
                format!("{:.0}", g.seconds),
                format!("{:.2}", g.error_m),
                reason,
            ]
        })
        .collect();
    page.table("How each goal ended", &["room", "state", "seconds", "metres off", "reason"], &rows);
    if let Some(t) = f.door_closed_s {
        page.paragraph(&format!("The door of the {} closed at {t:.0} s.", f.goals[1].name));
    }
    for c in &f.collisions {
        page.paragraph(&format!(
            "Touched {} at {:.1} s, driving at {:.2} m/s.",
            what(c.with),
            c.t_s,
            c.speed
        ));
    }
    page.heading("States");
    let rows: Vec<Vec<String>> = (end.states.iter())
        .map(|(t, state, reason)| {
            vec![format!("{t:.1}"), state.to_string(), reason.clone().unwrap_or_default()]
        })
        .collect();
    page.table("Changes of the navigator's state", &["seconds", "state", "reason"], &rows);
    page.finish()
}
