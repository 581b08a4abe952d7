//! Free, occupied and unknown space: log-odds in sparse blocks, updated by every pixel.
//!
//! Blocks of 8x8x8 voxels are grouped by 4x4x4. A block whose voxels are all equal is stored as one number. Groups
//! and blocks are first compared as a whole with the least and greatest depth of the pixels they cover, which decides
//! most of them.

mod kernel;
#[cfg(target_arch = "x86_64")]
mod kernel_x86;

use crate::backend::dispatch;
use crate::block::{BlockKey, BlockTable, KEY_LIMIT, Pages, SIDE, VOXELS};
use crate::frame::DepthFrame;
use crate::project::{Offsets, Projection};
use crate::view::{BlockView, Visibility};
use crate::{Backend, DenseError, DepthNoise};
use cairn_geometry::{Se3, Vec3};
use kernel::{Evidence, Nearest, Odds, Pass, add_all, apply};

/// Configuration of the occupancy grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OccupancyConfig {
    /// Edge of a voxel in metres, 0.01 to 0.2.
    pub voxel_m: f64,
    /// Log-odds added to a voxel by an image in which it is hit.
    pub hit: i8,
    /// Log-odds subtracted from a voxel by an image that sees through it.
    pub miss: i8,
    /// Bound of the absolute log-odds: `limit / miss` images suffice to free what was occupied.
    pub limit: i8,
    /// Range within which a surface would surely be seen: an occupied voxel nearer than this where neither it nor its
    /// surroundings return a depth any more is taken to be gone. 0 disables this (for a sensor that fails on dark or
    /// shiny surfaces near by).
    pub silent_m: f64,
    /// Depth noise model: space within twice the noise in front of a depth is not called free.
    pub noise: DepthNoise,
}

impl Default for OccupancyConfig {
    fn default() -> Self {
        Self { voxel_m: 0.05, hit: 12, miss: 6, limit: 60, silent_m: 3.0, noise: DepthNoise::default() }
    }
}

/// State of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occupancy {
    /// Never seen, or with balanced evidence.
    Unknown,
    /// Seen through.
    Free,
    /// Hit by a depth.
    Occupied,
}

/// Blocks along an edge of a group.
const GROUP: i32 = 4;
/// A view that covers more groups than this is refused: it would take seconds.
const MOST_GROUPS: f64 = 2e6;
/// Set in an entry that holds the slot of a block rather than one number for all of its voxels.
const FULL: u32 = 1 << 31;
/// With a greater share of pixels without depth than this, missing depth is no evidence: the sensor may be covered.
const LEAST_VALID: f64 = 0.02;

/// The blocks of a group: for each a slot, or one value in the lowest byte.
#[derive(Clone)]
struct Group([u32; 64]);

impl Default for Group {
    fn default() -> Self {
        Self([0; 64])
    }
}

/// A sparse grid of log-odds; positions are in its own frame, in metres.
#[derive(Clone)]
pub struct OccupancyGrid {
    config: OccupancyConfig,
    backend: Backend,
    table: BlockTable,
    keys: Vec<BlockKey>,
    groups: Pages<Group>,
    blocks: Pages<Odds>,
    full: usize,
    silent: Vec<u32>,
}

impl OccupancyGrid {
    /// Creates an empty grid.
    ///
    /// # Errors
    /// A config value out of range.
    pub fn new(config: OccupancyConfig) -> Result<Self, DenseError> {
        let OccupancyConfig { voxel_m, hit, miss, limit, silent_m, .. } = config;
        let numbers = hit > 0 && miss > 0 && (1..=63).contains(&limit) && hit <= limit && miss <= limit;
        if !((0.01..=0.2).contains(&voxel_m) && numbers && (0.0..=20.0).contains(&silent_m)) {
            return Err(DenseError::Config(format!("occupancy: {config:?}")));
        }
        Ok(Self {
            config,
            backend: Backend::best(),
            table: BlockTable::default(),
            keys: Vec::new(),
            groups: Pages::default(),
            blocks: Pages::default(),
            full: 0,
            silent: Vec::new(),
        })
    }

    /// The same with these instructions, when the processor has them.
    pub fn with_backend(mut self, backend: Backend) -> Self {
        self.backend = if backend.available() { backend } else { Backend::Scalar };
        self
    }

    /// The configuration.
    pub fn config(&self) -> &OccupancyConfig {
        &self.config
    }

    /// Updates each voxel in view with an image, as far as the image's greatest depth.
    ///
    /// # Errors
    /// A pose that is not finite or out of range; depths too far for such small voxels. The grid is then unchanged.
    pub fn integrate(&mut self, frame: &DepthFrame, volume_from_camera: &Se3) -> Result<(), DenseError> {
        if !volume_from_camera.is_finite() {
            return Err(DenseError::Pose("a number is not finite".into()));
        }
        let Some([low, high]) = self.groups_in_view(frame, volume_from_camera)? else { return Ok(()) };
        let mut silent = std::mem::take(&mut self.silent);
        mark_silent(frame, &mut silent);
        let voxel = self.config.voxel_m;
        let side = SIDE as f64 * voxel;
        let projection = Projection::new(frame, volume_from_camera, voxel);
        let offsets = projection.offsets();
        let scene = Scene {
            frame,
            groups: BlockView::new(frame, volume_from_camera, side * f64::from(GROUP), 3),
            blocks: BlockView::new(frame, volume_from_camera, side, 3),
            pass: self.pass(frame, projection.half_depth_m(), &offsets, &silent),
            projection,
        };
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    self.group(BlockKey([x, y, z]), &scene);
                }
            }
        }
        self.silent = silent;
        Ok(())
    }

    /// First and last group that the image may reach; `None` for an image without depth.
    fn groups_in_view(&self, frame: &DepthFrame, pose: &Se3) -> Result<Option<[[i32; 3]; 2]>, DenseError> {
        let Some((_, far)) = frame.range_m() else { return Ok(None) };
        let far = f64::from(far).max(self.config.silent_m) + self.config.voxel_m;
        let camera = frame.camera();
        let (mut low, mut high) = (pose.translation, pose.translation);
        for (u, v) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let x = (u * camera.width as f64 - 0.5 - camera.cx) / camera.fx;
            let y = (v * camera.height as f64 - 0.5 - camera.cy) / camera.fy;
            let corner = *pose * (Vec3::new(x, y, 1.0) * far);
            (low, high) = (low.inf(&corner), high.sup(&corner));
        }
        let group_m = self.config.voxel_m * (SIDE as i32 * GROUP) as f64;
        if !low.iter().chain(high.iter()).all(|v| (v / group_m).abs() < f64::from(KEY_LIMIT / GROUP)) {
            return Err(DenseError::Pose(format!("camera at {:?} m is out of range", pose.translation)));
        }
        let key = |v: Vec3| [0, 1, 2].map(|i| (v[i] / group_m).floor() as i32);
        let groups: f64 = (high - low).iter().map(|v| v / group_m + 1.0).product();
        if groups > MOST_GROUPS {
            let why = format!(
                "{far:.1} m of depth at voxels of {} m: drop far depths or take larger voxels",
                self.config.voxel_m
            );
            return Err(DenseError::Config(why));
        }
        Ok(Some([key(low), key(high)]))
    }

    fn pass<'a>(
        &self,
        frame: &'a DepthFrame,
        half_m: f64,
        offsets: &'a Offsets,
        silent: &'a [u32],
    ) -> Pass<'a> {
        let (c, noise) = (frame.camera(), &self.config.noise);
        let enough = frame.valid() as f64 >= LEAST_VALID * (c.width * c.height) as f64;
        Pass {
            size: [c.width, c.height],
            offsets,
            half_m: half_m as f32,
            noise: [noise.floor_m, noise.growth, noise.nearest_m].map(|v| v as f32),
            silent,
            silent_m: if enough { self.config.silent_m as f32 } else { 0.0 },
            hit: self.config.hit,
            miss: self.config.miss,
            limit: self.config.limit,
        }
    }

    /// What the image says of a whole cube.
    fn verdict(&self, look: Visibility, pass: &Pass) -> Verdict {
        let Visibility::Inside(c) = look else {
            return if look == Visibility::Outside { Verdict::Nothing } else { Verdict::Mixed };
        };
        let noise = |z: f32| 2.0 * (pass.noise[0] + pass.noise[1] * (z - pass.noise[2]).powi(2));
        if c.greatest == 0.0 {
            return if c.cube[0] < pass.silent_m { Verdict::Silent } else { Verdict::Nothing };
        }
        if c.cube[0] > c.greatest {
            return Verdict::Nothing;
        }
        if c.whole && c.cube[1] + noise(c.sure) < c.sure { Verdict::Free } else { Verdict::Mixed }
    }

    fn group(&mut self, key: BlockKey, scene: &Scene) {
        let verdict = self.verdict(scene.groups.visibility(key), &scene.pass);
        let known = self.table.get(&key).copied();
        if verdict == Verdict::Nothing || (verdict == Verdict::Silent && known.is_none()) {
            return;
        }
        let slot = known.unwrap_or_else(|| self.groups.take());
        let mut entries = self.groups.at(slot).0;
        for (i, entry) in entries.iter_mut().enumerate() {
            if verdict == Verdict::Free {
                self.free(entry);
                continue;
            }
            let place = [i & 3, i >> 2 & 3, i >> 4].map(|v| v as i32);
            let block = BlockKey(std::array::from_fn(|k| key.0[k] * GROUP + place[k]));
            match self.verdict(scene.blocks.visibility(block), &scene.pass) {
                Verdict::Nothing => {}
                Verdict::Free => self.free(entry),
                // Only what was occupied can have disappeared.
                Verdict::Silent if *entry & FULL == 0 && value(*entry) <= 0 => {}
                Verdict::Silent | Verdict::Mixed => self.mixed(entry, block, scene),
            }
        }
        if known.is_some() || entries.iter().any(|&e| e != 0) {
            self.groups.at_mut(slot).0 = entries;
            if known.is_none() {
                self.table.insert(key, slot);
                self.keys.push(key);
            }
        } else {
            self.groups.give_back(slot);
        }
    }

    /// All voxels of a block are seen through.
    fn free(&mut self, entry: &mut u32) {
        let (miss, limit) = (self.config.miss, self.config.limit);
        if *entry & FULL == 0 {
            *entry = uniform((value(*entry) - miss).max(-limit));
            return;
        }
        let slot = *entry & !FULL;
        let odds = self.blocks.at_mut(slot);
        let step = -miss;
        if dispatch!(self.backend, add_all(odds: &mut Odds, step: i8, limit: i8) -> bool) {
            *entry = uniform(odds.0[0]);
            self.blocks.give_back(slot);
            self.full -= 1;
        }
    }

    /// Updates each voxel by itself.
    fn mixed(&mut self, entry: &mut u32, key: BlockKey, scene: &Scene) {
        let origin = scene.projection.origin(key);
        // Depth of the block's centre.
        let offsets = &scene.pass.offsets.z;
        let centre = origin[2] + 0.5 * offsets[VOXELS - 1];
        let covered = (scene.frame.camera().fx * self.config.voxel_m) as f32 / centre.max(0.2);
        let level = ((covered.max(2.0) as u32).ilog2() as usize).min(scene.frame.pyramid.top());
        let squares = scene.frame.pyramid.level(level);
        let nearest = Nearest { level, width: squares.width, least: &squares.least };
        let was = *entry;
        let slot = if was & FULL != 0 { was & !FULL } else { self.blocks.take() };
        let odds = self.blocks.at_mut(slot);
        if was & FULL == 0 {
            odds.0 = [value(was); VOXELS];
        }
        let mut evidence = Evidence([0; VOXELS]);
        let pass = &scene.pass;
        let steps = [pass.hit, pass.miss, pass.limit];
        let says = classify(self.backend, &mut evidence, origin, nearest, pass);
        let from = &evidence;
        let changed =
            says && dispatch!(self.backend, apply(odds: &mut Odds, from: &Evidence, steps: [i8; 3]) -> bool);
        if was & FULL == 0 {
            if changed {
                *entry = FULL | slot;
                self.full += 1;
            } else {
                self.blocks.give_back(slot);
            }
        }
    }

    /// The state at a point.
    pub fn at(&self, p: &Vec3) -> Occupancy {
        state(self.odds_at(p))
    }

    /// The log-odds at a point, as [`Self::odds`] gives them.
    pub fn odds_at(&self, p: &Vec3) -> i8 {
        let voxel = p.map(|v| (v / self.config.voxel_m).floor());
        if !voxel.iter().all(|v| v.abs() < f64::from(i32::MAX)) {
            return 0;
        }
        self.odds([voxel.x as i32, voxel.y as i32, voxel.z as i32])
    }

    /// The corners of a box around all that is known; `None` where nothing is.
    pub fn extent(&self) -> Option<[Vec3; 8]> {
        let group_m = self.config.voxel_m * f64::from(SIDE as i32 * GROUP);
        let mut keys = self.keys.iter();
        let first = keys.next()?.0;
        let [low, high] = keys.fold([first; 2], |[low, high], key| {
            let bound = |b: [i32; 3], f: fn(i32, i32) -> i32| std::array::from_fn(|k| f(b[k], key.0[k]));
            [bound(low, i32::min), bound(high, i32::max)]
        });
        let end = |corner: usize, k: usize| if corner >> k & 1 == 0 { low[k] } else { high[k] + 1 };
        Some(std::array::from_fn(|corner| Vec3::from_fn(|k, _| group_m * f64::from(end(corner, k)))))
    }

    /// The state of a voxel; the one with index `i` has its centre at `(i + 0.5) * voxel_m`.
    pub fn voxel(&self, voxel: [i32; 3]) -> Occupancy {
        state(self.odds(voxel))
    }

    /// The log-odds of a voxel, in the units of the config; 0 where unknown.
    pub fn odds(&self, voxel: [i32; 3]) -> i8 {
        let (block, i) = BlockKey::of_voxel(voxel);
        let place = block.0.map(|v| (v & 3) as usize);
        let Some(&slot) = self.table.get(&BlockKey(block.0.map(|v| v >> 2))) else { return 0 };
        let entry = self.groups.at(slot).0[place[0] | place[1] << 2 | place[2] << 4];
        if entry & FULL == 0 { value(entry) } else { self.blocks.at(entry & !FULL).0[i] }
    }

    /// Calls `f` with the centre of each voxel in a box (metres, of the grid's frame) whose log-odds are at least
    /// `least`, which is above zero; in a fixed order.
    pub fn occupied_within(&self, low: &Vec3, high: &Vec3, least: i8, mut f: impl FnMut(Vec3)) {
        let voxel = self.config.voxel_m;
        let group_m = voxel * f64::from(SIDE as i32 * GROUP);
        let least = least.max(1);
        let inside = |p: &Vec3| (0..3).all(|k| p[k] >= low[k] && p[k] <= high[k]);
        let touches =
            |corner: &Vec3, side: f64| (0..3).all(|k| corner[k] <= high[k] && corner[k] + side >= low[k]);
        for key in &self.keys {
            let corner = Vec3::from(key.0.map(f64::from)) * group_m;
            let Some(&slot) = self.table.get(key).filter(|_| touches(&corner, group_m)) else { continue };
            for (i, &entry) in self.groups.at(slot).0.iter().enumerate() {
                let place = [i & 3, i >> 2 & 3, i >> 4].map(|v| v as f64 * SIDE as f64 * voxel);
                let corner = corner + Vec3::from(place);
                let full = entry & FULL != 0;
                if !full && value(entry) < least || !touches(&corner, voxel * SIDE as f64) {
                    continue;
                }
                let odds = |j: usize| if full { self.blocks.at(entry & !FULL).0[j] } else { value(entry) };
                for j in (0..VOXELS).filter(|&j| odds(j) >= least) {
                    let local = [j & 7, j >> 3 & 7, j >> 6].map(|v| (v as f64 + 0.5) * voxel);
                    let centre = corner + Vec3::from(local);
                    if inside(&centre) {
                        f(centre);
                    }
                }
            }
        }
    }

    /// Forgets what is known of a voxel.
    pub fn forget(&mut self, voxel: [i32; 3]) {
        let (block, i) = BlockKey::of_voxel(voxel);
        let place = block.0.map(|v| (v & 3) as usize);
        let Some(&group) = self.table.get(&BlockKey(block.0.map(|v| v >> 2))) else { return };
        let place = place[0] | place[1] << 2 | place[2] << 4;
        let entry = self.groups.at(group).0[place];
        let slot = if entry & FULL != 0 {
            entry & !FULL
        } else if value(entry) == 0 {
            return;
        } else {
            let slot = self.blocks.take();
            self.blocks.at_mut(slot).0 = [value(entry); VOXELS];
            self.groups.at_mut(group).0[place] = FULL | slot;
            self.full += 1;
            slot
        };
        self.blocks.at_mut(slot).0[i] = 0;
    }

    /// Forgets what lies farther from a place than `radius_m`, by groups of 32 voxels along each axis: memory stays
    /// bounded on a long walk.
    pub fn forget_beyond(&mut self, centre: &Vec3, radius_m: f64) {
        let group_m = self.config.voxel_m * f64::from(SIDE as i32 * GROUP);
        let far = |key: &BlockKey| {
            let corner = Vec3::from(key.0.map(f64::from)) * group_m;
            let near = centre.sup(&corner).inf(&corner.add_scalar(group_m));
            (near - centre).norm() > radius_m
        };
        let mut keys = std::mem::take(&mut self.keys);
        keys.retain(|key| {
            let gone = far(key).then(|| self.table.remove(key)).flatten();
            if let Some(slot) = gone {
                for &entry in self.groups.at(slot).0.iter().filter(|e| **e & FULL != 0) {
                    self.blocks.give_back(entry & !FULL);
                    self.full -= 1;
                }
                self.groups.give_back(slot);
            }
            gone.is_none()
        });
        self.keys = keys;
    }

    /// Bytes of all blocks and tables.
    pub fn bytes(&self) -> usize {
        self.groups.bytes() + self.blocks.bytes() + self.table.capacity() * 17 + self.keys.capacity() * 12
    }
}

/// What one image says of a whole cube.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Nothing,
    Free,
    Silent,
    Mixed,
}

struct Scene<'a> {
    frame: &'a DepthFrame,
    groups: BlockView<'a>,
    blocks: BlockView<'a>,
    pass: Pass<'a>,
    projection: Projection,
}

fn classify(backend: Backend, out: &mut Evidence, origin: [f32; 3], nearest: Nearest, pass: &Pass) -> bool {
    match backend {
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code)]
        // SAFETY: a backend is only set when it is available; frames, pyramids and silent squares cover the whole
        // image.
        Backend::Avx512 => unsafe { kernel_x86::classify_avx512(out, origin, nearest, pass) },
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code)]
        // SAFETY: as above.
        Backend::Avx2 => unsafe { kernel_x86::classify_avx2(out, origin, nearest, pass) },
        _ => kernel::classify(out, origin, nearest, pass),
    }
}

fn value(entry: u32) -> i8 {
    entry as u8 as i8
}

fn uniform(value: i8) -> u32 {
    u32::from(value as u8)
}

/// Squares of eight pixels without any depth whose neighbours (up to eight, inside the image) have none either.
fn mark_silent(frame: &DepthFrame, out: &mut Vec<u32>) {
    let tiles = frame.pyramid.level(3);
    let (w, h) = (tiles.width, tiles.height);
    out.clear();
    for y in 0..h {
        for x in 0..w {
            let rows = y.saturating_sub(1)..(y + 2).min(h);
            let mut around = rows.flat_map(|v| (x.saturating_sub(1)..(x + 2).min(w)).map(move |u| v * w + u));
            let none = tiles.greatest[y * w + x] == 0.0 && around.all(|i| tiles.greatest[i] == 0.0);
            out.push(u32::from(none));
        }
    }
}

fn state(odds: i8) -> Occupancy {
    match odds {
        0 => Occupancy::Unknown,
        v if v < 0 => Occupancy::Free,
        _ => Occupancy::Occupied,
    }
}
