//! `cairn team scale`: how the costs of a team that shares its maps grow with robots and key frames, and what runs out first.

use super::fleet;
use crate::failure::Failure;
use crate::number::positive;
use crate::output::{Output, note};
use crate::outputs::Outputs;
use cairn::Config;
use cairn::team::peer::MAX_HELD_BYTES;
use cairn::team_scale::{Budgets, Costs, Load, Resource, Team, measure_costs};
use cairn_eval::{Labels, Mark, Series, Tone, line_chart};
use cairn_files::MIB;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Estimates what a team of 2 to 100 robots with 10^3 to 10^6 key frames costs each robot, and what breaks first.
///
/// Measures first what one robot pays on this machine (two short simulated walks, half a minute), and prints that as the inputs of
/// a model: bytes on the network, memory, and times of a place query, of comparing words, of making the shared atlas, and of
/// relaxing its pose graph.
#[derive(clap::Args)]
pub struct Arguments {
    /// Robots that share places with each other; words still go to all of the team. Without it all do.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=100))]
    group: Option<u16>,
    /// Memory of a robot's machine, GB.
    #[arg(long, default_value_t = 8.0, value_name = "GB", value_parser = positive())]
    memory: f64,
    /// Bytes that a robot may send in a second, kB.
    #[arg(long, default_value_t = 100.0, value_name = "KB", value_parser = positive())]
    bandwidth: f64,
    /// Compares the model with a real run: what cairn demo --team N --json has printed.
    #[arg(long, value_name = "DEMO.json")]
    check: Option<PathBuf>,
    /// Estimates instead what it costs to build an atlas of 10^3 to 10^5 recorded walks: from what cairn fleet build --json has
    /// printed of a build into a new store.
    #[arg(long, value_name = "BUILD.json", conflicts_with_all = ["group", "bandwidth", "check", "svg"])]
    fleet: Option<PathBuf>,
    /// Draws each cost over its budget for ten robots.
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
    /// Replace the drawing if it exists.
    #[arg(long)]
    overwrite: bool,
}

/// The robots and key frames of the table, and those at which growth is stated.
const ROBOTS: [usize; 6] = [2, 5, 10, 20, 50, 100];
const KEY_FRAMES: [f64; 4] = [1e3, 1e4, 1e5, 1e6];
const TYPICAL: (usize, f64) = (10, 1e5);
/// A key frame each tenth of a second; a map is not fetched again sooner; what closing a loop may take.
const QUERY_S: f64 = 0.1;
const RENEW_S: f64 = super::join::REFRESH_S as f64;
const RELAX_S: f64 = 5.0;

#[derive(Serialize)]
struct Report {
    costs: Costs,
    budgets: Budgets,
    group: Option<u16>,
    table: Vec<Row>,
    most_key_frames: Vec<Most>,
    growth: Vec<Growth>,
    check: Option<Check>,
}

/// What each robot of a team pays.
#[derive(Serialize)]
struct Row {
    #[serde(flatten)]
    team: Team,
    load: Load,
    /// What is over its budget, with how many times, worst first.
    broken: Vec<(Resource, f64)>,
}

/// Up to how many key frames, of all robots together, each budget is kept; `null` where it does not depend on them or is not known.
#[derive(Serialize)]
struct Most {
    robots: usize,
    key_frames: Vec<(Resource, Option<f64>)>,
}

/// The exponents with which a cost grows, around the typical team: with twice the key frames of each robot, and with twice the
/// robots of as many key frames each.
#[derive(Serialize)]
struct Growth {
    resource: Resource,
    with_key_frames: f64,
    with_robots: f64,
}

/// The model beside a run.
#[derive(Serialize)]
struct Check {
    robots: usize,
    key_frames: usize,
    seconds: f64,
    measured_kb_per_s: f64,
    predicted_kb_per_s: f64,
}

/// What of a demo's report is compared.
#[derive(Deserialize)]
struct Demo {
    seconds: f64,
    robots: Vec<DemoRobot>,
}

#[derive(Deserialize)]
struct DemoRobot {
    key_frames: usize,
    sent_kb_per_s: f64,
}

/// Measures, computes, prints.
///
/// # Errors
/// When a file cannot be read or written, or the costs cannot be measured.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let outputs = Outputs::new(a.overwrite).input("--check", a.check.as_deref());
    let outputs = outputs.output("--svg", a.svg.as_deref()).checked()?;
    let demo = a.check.as_deref().map(demo).transpose()?;
    let built = a.fleet.as_deref().map(fleet::built).transpose()?;
    let costs = measure_costs(&Config::default(), |what| note(&format!("measuring: {what}")))
        .map_err(|e| Failure::new("what one robot costs", e.to_string(), "run cairn doctor"))?;
    if let Some(built) = built {
        return output.result(&fleet::report(&built, &costs), fleet::text);
    }
    let budgets = Budgets {
        bandwidth: a.bandwidth * 1e3,
        memory: a.memory * 1e9,
        held: MAX_HELD_BYTES as f64,
        query_s: QUERY_S,
        renew_s: RENEW_S,
        relax_s: RELAX_S,
    };
    let report = report(a.group, costs, budgets, demo);
    outputs.write("--svg", || Ok(chart(&report).into_bytes()))?;
    output.result(&report, text)
}

fn demo(path: &Path) -> Result<Demo, Failure> {
    let fail = |why: String| {
        Failure::new(path.display().to_string(), why, "save what cairn demo --team 4 --json prints")
    };
    let text = cairn_files::read_text(path, 16 * MIB).map_err(|e| fail(e.to_string()))?;
    let demo: Demo = serde_json::from_str(&text).map_err(|e| fail(e.to_string()))?;
    if demo.seconds <= 0.0 || demo.robots.is_empty() {
        return Err(fail("it has no robots or no time".into()));
    }
    Ok(demo)
}

fn report(group: Option<u16>, costs: Costs, budgets: Budgets, demo: Option<Demo>) -> Report {
    let team = |robots, key_frames| Team { robots, key_frames, group: group.map_or(robots, usize::from) };
    let row = |robots, key_frames| {
        let team = team(robots, key_frames);
        let load = team.load(&costs);
        Row { team, load, broken: load.broken(&budgets) }
    };
    let table = ROBOTS.iter().flat_map(|r| KEY_FRAMES.iter().map(|k| row(*r, *k))).collect();
    let most = |robots: usize| {
        let of = |r: Resource| team(robots, 0.0).most_key_frames(&costs, &budgets, r);
        let key_frames = Resource::ALL.map(|r| (r, Some(of(r)).filter(|n| n.is_finite()))).to_vec();
        Most { robots, key_frames }
    };
    let (robots, key_frames) = TYPICAL;
    let at = |robots, key_frames, resource| team(robots, key_frames).load(&costs).of(resource);
    let growth = Resource::ALL.into_iter().filter_map(|resource| {
        let now = at(robots, key_frames, resource).filter(|load| *load > 0.0)?;
        let exponent = |more: Option<f64>| Some((more? / now).log2());
        Some(Growth {
            resource,
            with_key_frames: exponent(at(robots, 2.0 * key_frames, resource))?,
            with_robots: exponent(at(2 * robots, 2.0 * key_frames, resource))?,
        })
    });
    let growth = growth.collect();
    let check = demo.map(|demo| check(&demo, &costs));
    let most_key_frames = ROBOTS.into_iter().map(most).collect();
    Report { table, most_key_frames, growth, check, costs, budgets, group }
}

/// The bytes of a run in which all share places: each key frame goes to every other robot.
fn check(demo: &Demo, costs: &Costs) -> Check {
    let robots = demo.robots.len() as f64;
    let key_frames: usize = demo.robots.iter().map(|r| r.key_frames).sum();
    let each = costs.map_bytes * costs.sent_again + costs.words_bytes;
    let said = robots * (robots - 1.0) * costs.have_bytes.at(robots) * demo.seconds;
    let bytes = key_frames as f64 * (robots - 1.0) * each + said;
    Check {
        robots: demo.robots.len(),
        key_frames,
        seconds: demo.seconds,
        measured_kb_per_s: demo.robots.iter().map(|r| r.sent_kb_per_s).sum::<f64>() / robots,
        predicted_kb_per_s: bytes / demo.seconds / robots / 1e3,
    }
}

fn text(r: &Report) -> String {
    let (c, b) = (&r.costs, &r.budgets);
    let mut text = String::new();
    let memory =
        c.memory_bytes.map_or("unknown (this system does not tell)".into(), |m| format!("{:.0} kB", m / 1e3));
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "measured  here, one thread: {} key frames in {:.0} s of walking, {:.2} a second\n\
         key frame {:.0} words, {:.0} B on the network; map {:.1} kB there, sent {:.2} times; {memory} in memory\n\
         every s   to each other robot {:.0} B and {:.0} B for each of the team\n\
         query     {:.3} ms and {:.3} ms for each 1000 key frames\n\
         words     {:.0} ns to compare two key frames\n\
         atlas     {:.1} ms a key frame to join, and {:.1} ms to adjust all up to {} key frames, or {:.1} ms around the places where maps \
         meet\n\
         relax     {:.2} s for 10^4 key frames of {:.1} edges each, growing with their power {:.2}",
        c.key_frames,
        c.walked_s,
        c.key_frames_per_s(),
        c.words,
        c.words_bytes,
        c.map_bytes / 1e3,
        c.sent_again,
        c.have_bytes.at_zero,
        c.have_bytes.each,
        c.query_s.at_zero * 1e3,
        c.query_s.each * 1e6,
        c.compare_s * 1e9,
        c.join_s * 1e3,
        c.adjust_s * 1e3,
        c.adjusted_as_a_whole,
        c.around_s * 1e3,
        c.relax_s.at(1e4),
        c.edges,
        c.relax_s.exponent
    );
    let shared = r.group.map_or("all robots share places".into(), |g| format!("groups of {g} share places"));
    let _ = writeln!(
        text,
        "budgets   {:.0} kB/s, {:.1} GB, maps held {:.0} MB, query {:.1} s, words and atlas {:.0} s each, relax {:.0} s\n\
         assumed   all walk where nobody was; {shared}; maps go to each of them, words to all\n",
        b.bandwidth / 1e3,
        b.memory / 1e9,
        b.held / 1e6,
        b.query_s,
        b.renew_s,
        b.relax_s
    );
    let _ = writeln!(
        text,
        "{:>6} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10}  over the budget, times",
        "robots", "key frames", "kB/s", "memory MB", "held MB", "query ms", "words s", "atlas s", "relax s"
    );
    for Row { team, load, broken } in &r.table {
        let over: Vec<String> = broken.iter().map(|(r, times)| format!("{r} {}", short(*times))).collect();
        let _ = writeln!(
            text,
            "{:>6} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10}  {}",
            team.robots,
            team.key_frames,
            short(load.bandwidth / 1e3),
            load.memory.map_or("-".into(), |m| short(m / 1e6)),
            short(load.held / 1e6),
            short(load.query_s * 1e3),
            short(load.compare_s),
            short(load.atlas_s),
            short(load.relax_s),
            over.join(", ")
        );
    }
    let _ = write!(text, "\nkey frames of all up to which a budget is kept\n{:>6}", "robots");
    for resource in Resource::ALL {
        let _ = write!(text, " {resource:>10}");
    }
    text.push('\n');
    for most in &r.most_key_frames {
        let _ = write!(text, "{:>6}", most.robots);
        for (_, n) in &most.key_frames {
            let _ = write!(text, " {:>10}", n.map_or("-".into(), short));
        }
        text.push('\n');
    }
    let (robots, key_frames) = TYPICAL;
    let _ = writeln!(
        text,
        "\ngrowth at {robots} robots and {key_frames} key frames: the power of key frames of each, of robots"
    );
    for g in &r.growth {
        let _ = writeln!(text, "{:<10} {:>5.2} {:>5.2}", g.resource, g.with_key_frames, g.with_robots);
    }
    if let Some(c) = &r.check {
        let _ = writeln!(
            text,
            "\ncheck     {} robots, {} key frames in {:.0} s: {:.1} kB/s a robot measured, {:.1} predicted ({:+.0} %)",
            c.robots,
            c.key_frames,
            c.seconds,
            c.measured_kb_per_s,
            c.predicted_kb_per_s,
            100.0 * (c.predicted_kb_per_s / c.measured_kb_per_s - 1.0)
        );
    }
    text
}

/// Three digits that count.
fn short(v: f64) -> String {
    match v {
        0.0 => "0".into(),
        v if v >= 1e5 => format!("{v:.1e}"),
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 1.0 => format!("{v:.1}"),
        v if v >= 0.01 => format!("{v:.3}"),
        v => format!("{v:.0e}"),
    }
}

/// Costs over their budgets by key frames.
fn chart(r: &Report) -> String {
    let (robots, _) = TYPICAL;
    let tones = [Tone::First, Tone::Second, Tone::Third, Tone::Fourth];
    let lines = Resource::ALL.iter().enumerate().map(|(n, resource)| {
        let at = |step: i32| {
            let log = 3.0 + f64::from(step) / 10.0;
            let group = r.group.map_or(robots, usize::from);
            let load = Team { robots, key_frames: 10f64.powf(log), group }.load(&r.costs);
            (log, load.of(*resource).map_or(f64::NAN, |load| (load / r.budgets.of(*resource)).log10()))
        };
        Series {
            label: resource.to_string(),
            points: (0..=30).map(at).collect(),
            tone: tones[n % tones.len()],
            dashed: n >= tones.len(),
        }
    });
    let labels = Labels {
        title: format!("Costs of each of {robots} robots over their budgets"),
        description: "Each cost over its budget by the key frames of all robots, both as powers of ten; above 0 it is broken".into(),
        x: "key frames of all robots, power of ten".into(),
        y: "cost over budget, power of ten".into(),
    };
    let broken = Mark { label: "budget".into(), value: 0.0 };
    line_chart(&labels, &lines.collect::<Vec<_>>(), &[broken]).standalone()
}
