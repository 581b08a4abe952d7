//! `cairn plan`: a path on a map of the ground, or a way over the recorded routes of a saved map, with its picture.

mod walked;

use crate::failure::Failure;
use crate::output::Output;
use crate::outputs::Outputs;
use cairn_geometry::Vec2;
use cairn_plan::map_server::{self, MapFileError};
use cairn_plan::picture::Picture;
use cairn_plan::route::{self, OpenError, PlanError, PlannedPath, Search};
use cairn_plan::search::NoPath;
use cairn_plan::{CostConfig, Grid};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Finds a path on a map that never cuts a corner and keeps the body clear of walls; or the way over recorded routes.
///
/// On a grid, unknown ground is not entered. In a map that cairn run saved, the way leads only where someone walked: routes
/// that meet are joined there. Places are the starts and ends of the routes.
#[derive(clap::Args)]
pub struct Arguments {
    /// The map: the YAML of a ROS map_server map, a Moving AI `.map`, or a saved map `.cairn`.
    grid: PathBuf,
    /// Where it begins, in metres of the map (cells of a `.map`), or by its name in a saved map.
    #[arg(long, value_name = "X,Y|NAME", value_parser = place, allow_hyphen_values = true)]
    from: Place,
    /// Where it leads, likewise: "kitchen" is where the route kitchen.route ends, "kitchen start" where it starts.
    #[arg(long, value_name = "X,Y|NAME", value_parser = place, allow_hyphen_values = true)]
    to: Place,
    /// Recorded routes to go by in a saved map, instead of those saved with it.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    routes: Vec<PathBuf>,
    /// Write the way as a route, for cairn run to be guided along it ("guide home again").
    #[arg(long, value_name = "FILE.route")]
    route_out: Option<PathBuf>,
    /// Radius of the body in metres [default: 0.2; 0 for a `.map`].
    #[arg(long, value_name = "M")]
    radius: Option<f64>,
    /// Room left beyond the radius in metres [default: 0.05; 0 for a `.map`].
    #[arg(long, value_name = "M")]
    margin: Option<f64>,
    /// costs: keeps to wide passages; astar and jump: the shortest over the grid; any-angle: shorter still.
    #[arg(long, value_name = "KIND", default_value = "costs", value_parser = kind)]
    search: Search,
    /// Draw the map and the path here.
    #[arg(long, value_name = "FILE.svg|png")]
    out: Option<PathBuf>,
    /// Replace the picture if it exists.
    #[arg(long)]
    overwrite: bool,
}

/// What is printed.
#[derive(Serialize)]
struct Planned {
    width: usize,
    height: usize,
    resolution_m: f64,
    length_m: f64,
    grid_length_m: f64,
    cost: f64,
    clearance_m: f64,
    expanded: usize,
    /// Of distances, costs, search and smoothing, without reading and drawing.
    ms: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    written: Option<PathBuf>,
    cells: Vec<[u32; 2]>,
    points: Vec<[f64; 2]>,
}

/// A place on the command line.
#[derive(Clone, Debug)]
enum Place {
    /// By its coordinates.
    At(Vec2),
    /// By its name.
    Named(String),
}

pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    match arguments.grid.extension().is_some_and(|e| e == "cairn") {
        true => walked::run(arguments, output),
        false => on_grid(arguments, output),
    }
}

/// The point of a place on a grid.
fn at(place: &Place) -> Result<Vec2, Failure> {
    match place {
        Place::At(at) => Ok(*at),
        Place::Named(name) => {
            let why = "this map has no places with names";
            Err(Failure::new(name.clone(), why, "give --from and --to as X,Y, or a saved map (.cairn)"))
        }
    }
}

/// What to do about a map that cannot be read.
fn map_hint(error: &OpenError) -> &'static str {
    match error {
        OpenError::MapServer(MapFileError::File { .. }) => {
            "check the path; the YAML names its image relative to itself, so that both may lie in one folder"
        }
        OpenError::MapServer(MapFileError::Yaml { .. }) => {
            "correct the YAML: image, resolution, origin, negate, occupied_thresh and free_thresh as map_server has them"
        }
        OpenError::MapServer(MapFileError::Image { .. }) => "save the image as PGM, PNG or BMP",
        OpenError::MapServer(_) => "correct resolution and origin in the YAML, or the size of the image",
        OpenError::MovingAi { .. } => "give the YAML of a map_server map, or a Moving AI .map",
    }
}

fn on_grid(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    let (from, to) = (at(&arguments.from)?, at(&arguments.to)?);
    if !arguments.routes.is_empty() || arguments.route_out.is_some() {
        let why = "routes lie in a map that cairn run saved";
        return Err(Failure::new("--routes", why, "give a saved map (.cairn)"));
    }
    let name = arguments.grid.display().to_string();
    let form = arguments.out.as_deref().map(Form::of).transpose()?;
    let image = image_of(&arguments.grid);
    let outputs = Outputs::new(arguments.overwrite)
        .input("the map", Some(&arguments.grid))
        .input("the image of the map", image.as_deref())
        .output("--out", arguments.out.as_deref())
        .checked()?;
    let map =
        route::open_map(&arguments.grid).map_err(|e| Failure::new(&name, e.to_string(), map_hint(&e)))?;
    let in_cells = arguments.grid.extension().is_some_and(|e| e == "map");
    let usual = CostConfig::default();
    let (radius_m, margin_m) = if in_cells { (0.0, 0.0) } else { (usual.radius_m, usual.margin_m) };
    let radius_m = arguments.radius.unwrap_or(radius_m);
    let margin_m = arguments.margin.unwrap_or(margin_m);
    let inflation_m = usual.inflation_m.max(2.0 * (radius_m + margin_m) + 2.0 * map.frame().resolution_m());
    let costs = CostConfig { radius_m, margin_m, inflation_m, ..usual };
    let began = Instant::now();
    let found = route::plan(&map, &costs, arguments.search, from, to);
    let ms = began.elapsed().as_secs_f64() * 1e3;
    let route = found.map_err(|e| Failure::new(&name, e.to_string(), hint(&e)))?;
    if let Some(form) = form {
        outputs.write("--out", || draw(form, &map, &route))?;
    }
    let frame = map.frame();
    let planned = Planned {
        width: frame.width(),
        height: frame.height(),
        resolution_m: frame.resolution_m(),
        length_m: route.smooth.length_m,
        grid_length_m: route.path.length_m(frame),
        cost: route.path.cost,
        clearance_m: route.smooth.clearance_m,
        expanded: route.path.expanded,
        ms,
        written: arguments.out.clone(),
        cells: route.path.cells.iter().map(|c| [c.x, c.y]).collect(),
        points: route.smooth.points.iter().map(|p| [p.x, p.y]).collect(),
    };
    output.result(&planned, told)
}

fn told(p: &Planned) -> String {
    let mut lines = vec![
        format!("map         {} x {} cells of {} m", p.width, p.height, p.resolution_m),
        format!(
            "path        {:.2} m ({:.2} m over the grid), cost {:.2}",
            p.length_m, p.grid_length_m, p.cost
        ),
        format!("clearance   {:.2} m", p.clearance_m),
        format!("expanded    {} cells in {:.1} ms, with distances, costs and smoothing", p.expanded, p.ms),
    ];
    lines.extend(p.written.as_ref().map(|out| format!("picture     {}", out.display())));
    lines.join("\n")
}

fn hint(reason: &PlanError) -> &'static str {
    match reason {
        PlanError::Costs(_) => "give a radius and a margin that are not negative",
        PlanError::Path(NoPath::NotFinite(_) | NoPath::Outside(_)) => {
            "give --from and --to as X,Y inside the map"
        }
        PlanError::Path(NoPath::Blocked { .. }) => "choose a point farther from walls, or a smaller --radius",
        PlanError::Path(_) => "try a smaller --radius or --margin",
    }
}

/// The form of a picture.
#[derive(Clone, Copy)]
enum Form {
    Svg,
    Png,
}

impl Form {
    /// Chosen by the ending of the file.
    fn of(out: &Path) -> Result<Self, Failure> {
        match out.extension().and_then(|e| e.to_str()) {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => Err(Failure::new(
                out.display().to_string(),
                "neither .svg nor .png",
                "name the picture so that it ends in .svg or .png",
            )),
        }
    }
}

/// The image that the YAML of a map names; errors are reported when the map is opened.
fn image_of(grid: &Path) -> Option<PathBuf> {
    let text = cairn_files::read_text_lossy(grid, 16 * cairn_files::MIB).ok()?;
    let root = cairn_files::yaml::parse(&text).ok()?;
    Some(map_server::image_beside(grid, Path::new(root.get("image")?.text()?)))
}

fn draw(form: Form, map: &Grid<i8>, route: &PlannedPath) -> Result<Vec<u8>, Failure> {
    let colour = |value: i8| match value {
        0 => [250, 250, 247],
        v if v < 0 => [200, 204, 210],
        _ => [40, 44, 52],
    };
    let picture = Picture::new(map, colour)
        .path(&route.path.cells, [240, 170, 60])
        .points(&route.smooth.points, [30, 90, 200]);
    let bytes = match form {
        Form::Png => picture.png(),
        Form::Svg => picture.svg().map(String::into_bytes),
    };
    bytes.map_err(|e| Failure::new("the picture", e.to_string(), "use a smaller map"))
}

/// A word is not what is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
enum ArgumentError {
    #[error("expected two numbers as X,Y, or a name")]
    Place,
    #[error("expected costs, astar, jump or any-angle")]
    Search,
}

/// Two numbers with a comma between, or a name. What is no finite point is told by the search.
fn place(text: &str) -> Result<Place, ArgumentError> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y]) => Ok(Place::At(Vec2::new(x, y))),
        None if text.chars().any(char::is_alphabetic) => Ok(Place::Named(text.to_owned())),
        _ => Err(ArgumentError::Place),
    }
}

fn kind(text: &str) -> Result<Search, ArgumentError> {
    match text {
        "costs" => Ok(Search::Costs),
        "astar" => Ok(Search::AStar),
        "jump" => Ok(Search::JumpPoint),
        "any-angle" => Ok(Search::AnyAngle),
        _ => Err(ArgumentError::Search),
    }
}
