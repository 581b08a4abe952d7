//! How long the way would have to be for the corners of a simulated walk to lie where they were found, by how far the size at which a
//! corner was found is from that of its landmark: the table of docs/figures/team.md, "Corners found at another size".

use cairn::geometry::Se3;
use cairn::sensor::{Camera, DepthImage, GrayImage, Source, Stamp};
use cairn::sim::{Renderer, SimSource};
use cairn::{Slam, map_file, open};
use cairn_atlas::store::MapFile;
use cairn_atlas::{KeyFrame, KeyFrameId};
use std::collections::BTreeMap;

/// Depth is rendered with so many pixels for each of the camera, in x and in y.
const FINER: f64 = 4.0;
/// A corner is on a plane where inverse depths around it depart from one by less than this part, within three pixels of its level.
const FLAT: f64 = 0.004;
/// Squared residuals beyond this many pixels of the level are of wrong matches.
const GROSS: f64 = 6.0;

fn walk(world: &str) -> (MapFile, BTreeMap<Stamp, Se3>) {
    let mut source = open(world).expect("a world");
    let mut slam = Slam::for_source(&*source).build().expect("it can be built");
    while let Some(frame) = source.next_packet().expect("a simulated world can be read") {
        slam.track(&frame).expect("a frame in order");
    }
    slam.finish();
    let truth = source.info().truth.iter().copied().collect();
    (map_file(slam.session(), &BTreeMap::new()).expect("a map with key frames"), truth)
}

/// The true depths of the features of key frames that show a landmark on a plane.
struct TrueDepths {
    renderer: Renderer,
    image: GrayImage,
    depth: DepthImage,
}

impl TrueDepths {
    fn new(world: &str) -> Self {
        let source = SimSource::open(world).expect("a world");
        let c = source.rig().cameras[0].camera;
        let finer = |at: f64| (at + 0.5) * FINER - 0.5;
        let size = [c.width, c.height].map(|n| n * FINER as usize);
        let camera = Camera::pinhole(size[0], size[1], c.fx * FINER, c.fy * FINER, finer(c.cx), finer(c.cy));
        let renderer = Renderer::new(source.world(), camera).expect("a pinhole");
        Self { renderer, image: GrayImage::new(8, 8), depth: DepthImage::new(8, 8) }
    }

    fn look(&mut self, world_from_camera: &Se3) {
        self.renderer.render(world_from_camera, &mut self.image, Some(&mut self.depth));
    }

    fn at(&self, px: [f32; 2], scale: f64) -> Option<f64> {
        let [x, y] = px.map(|at| ((f64::from(at) + 0.5) * FINER - 0.5).round() as i64);
        let inverse = |dx: i64, dy: i64| {
            let inside = |at: i64, size: usize| at.clamp(0, size as i64 - 1) as usize;
            let (x, y) = (inside(x + dx, self.depth.width()), inside(y + dy, self.depth.height()));
            1000.0 / f64::from(self.depth.at(x, y))
        };
        let (reach, middle) = ((3.0 * scale * FINER).round() as i64, inverse(0, 0));
        let bent = [(1, 0), (0, 1), (1, 1), (1, -1)].map(|(dx, dy)| {
            let sides = inverse(dx * reach, dy * reach) + inverse(-dx * reach, -dy * reach);
            (sides / (2.0 * middle) - 1.0).abs() * 2.0
        });
        (middle.is_finite() && bent.iter().all(|b| *b < FLAT)).then_some(1.0 / middle)
    }
}

/// For each class of pairs of views of a corner, by how many levels its size differs between them: the normal equation of the length of
/// the way from one view to the other, `[information times excess, information]`.
fn by_size(file: &MapFile, truth: &BTreeMap<Stamp, Se3>, world: &str) -> BTreeMap<u32, [f64; 2]> {
    let (snapshot, camera) = (&file.snapshot, file.about.camera);
    let octaves = snapshot.octaves();
    let mut true_depths = TrueDepths::new(world);
    let pose = |k: &KeyFrame| truth[&k.stamp] * camera.body_from_camera;
    let mut seen: BTreeMap<(KeyFrameId, usize), f64> = BTreeMap::new();
    for k in snapshot.key_frames() {
        true_depths.look(&pose(k));
        for feature in (0..k.landmarks.len()).filter(|i| k.landmarks[*i].is_some()) {
            let scale = octaves.scale(k.frame.octave[feature]);
            let depth = true_depths.at(k.frame.px[feature], scale);
            seen.extend(depth.map(|z| ((k.id, feature), z)));
        }
    }
    let mut classes: BTreeMap<u32, [f64; 2]> = BTreeMap::new();
    for l in snapshot.landmarks() {
        let views: Vec<(&KeyFrame, usize, f64)> = (l.observations.iter())
            .filter_map(|o| {
                let feature = usize::from(o.feature);
                Some((snapshot.key_frame(o.key_frame)?, feature, *seen.get(&(o.key_frame, feature))?))
            })
            .collect();
        for (a, i, z_a) in &views {
            for (b, j, z_b) in views.iter().filter(|(b, ..)| b.id != a.id) {
                let (world_from_a, world_from_b) = (pose(a), pose(b));
                let b_from_world = world_from_b.inverse();
                let p = b_from_world * (world_from_a * camera.unproject(a.frame.px[*i], *z_a));
                let Some([u, v, _]) = camera.project(&p) else { continue };
                let way = b_from_world.rotation * (world_from_b.translation - world_from_a.translation);
                // A longer way moves the point the other way in the view at its end.
                let moves = [
                    camera.fx * (p.x * way.z / p.z - way.x) / p.z,
                    camera.fy * (p.y * way.z / p.z - way.y) / p.z,
                ];
                let found = b.frame.px[*j].map(f64::from);
                let off = [found[0] - u, found[1] - v];
                let [scale_a, scale_b] = [a.frame.octave[*i], b.frame.octave[*j]].map(|o| octaves.scale(o));
                let weight = scale_b.powi(-2);
                if weight * (off[0].powi(2) + off[1].powi(2)) > GROSS {
                    continue;
                }
                let levels = ((scale_b * z_b) / (scale_a * z_a)).ln() / octaves.factor.ln();
                let class = classes.entry((levels.abs().round() as u32).min(4)).or_default();
                class[0] += weight * (moves[0] * off[0] + moves[1] * off[1]);
                class[1] += weight * (moves[0].powi(2) + moves[1].powi(2));
            }
        }
    }
    classes
}

#[test]
#[ignore = "a table for docs/figures/team.md: two minutes"]
fn table() {
    for (name, options) in [
        ("RGB-D 320x240", "sensor=rgbd&resolution=320x240&rate=10&duration=24"),
        (
            "stereo-imu 400x300",
            "sensor=stereo-imu&resolution=400x300&focal=300&rate=10&start=6&duration=16&speed=1.05&height=1.4",
        ),
        ("mono 480x360", "sensor=mono&resolution=480x360&focal=270&rate=20&start=3&duration=18&height=1.45"),
    ] {
        let mut all: BTreeMap<u32, [f64; 2]> = BTreeMap::new();
        for seed in [5, 7] {
            let world = format!("sim:demo?detail=0.5&seed={seed}&{options}");
            let (file, truth) = walk(&world);
            for (class, [excess, information]) in by_size(&file, &truth, &world) {
                let sum = all.entry(class).or_default();
                *sum = [sum[0] + excess, sum[1] + information];
            }
        }
        let total: f64 = all.values().map(|sum| sum[1]).sum();
        let cells: Vec<String> = (all.values())
            .map(|[excess, information]| {
                format!("{:+.2} ({:.0} %)", 100.0 * excess / information, 100.0 * information / total)
            })
            .collect();
        let whole: f64 = all.values().map(|sum| sum[0]).sum::<f64>() / total;
        println!("| {name} | {} | {:+.2} |", cells.join(" | "), 100.0 * whole);
    }
}
