//! Key frames' depth: how much it takes, and a loop closure over 1,000 key frames.

use super::Row;
use super::kitchen::{Kitchen, least, median};
use crate::processor::now_ms;
use cairn_dense::{
    AnchorId, Backend, DenseError, DenseMap, MapId, OccupancyConfig, OccupancyGrid, PackedDepth,
    SubmapConfig, TsdfConfig,
};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::GrayImage;

/// Key frames of the loop.
const KEY_FRAMES: usize = 1000;

/// Poses swapped and frames fused again; occupancy fused afresh from the stored depth.
pub fn submaps(kitchen: &Kitchen) -> Result<Vec<Row>, DenseError> {
    let mut rows = codec(kitchen)?;
    // All fields stay: what is measured is fusing them again.
    let config = SubmapConfig { most_bytes: usize::MAX, ..SubmapConfig::default() };
    let mut map = DenseMap::new(config, kitchen.camera, kitchen.metres_per_unit())?;
    let (mut insert, mut poses) = (Vec::new(), Vec::new());
    let images = kitchen.fused.len();
    let looped = kitchen.raw().zip(&kitchen.fused).cycle().take(KEY_FRAMES);
    for (i, (image, (_, _, pose))) in looped.enumerate() {
        // Each repetition of the recording is placed in a kitchen of its own.
        let aside = Vec3::new((i / images) as f64 * 20.0, 0.0, 0.0);
        let pose = Se3::new(pose.rotation, pose.translation + aside);
        let start = now_ms();
        map.insert(AnchorId(i as u64), MapId(0), pose, Se3::identity(), image, None)?;
        insert.push(now_ms() - start);
        poses.push((AnchorId(i as u64), pose));
    }
    rows.push(Row::told("a key frame into submaps, median", median(insert), "ms"));
    let bent: Vec<_> =
        poses.iter().map(|(id, p)| (*id, bend(id.0 as f64 / KEY_FRAMES as f64) * *p)).collect();
    let (ms, ()) = least(5, || map.align(&bent))?;
    rows.push(Row::at_most("poses of 1,000 key frames swapped", ms, "ms", 1.0));
    let start = now_ms();
    let mut fused = 0;
    loop {
        let done = map.step(&Vec3::zeros(), 16);
        fused += done.images;
        if done.waiting == 0 {
            break;
        }
    }
    let what = format!("{fused} images fused again, field and occupancy, slices of 16");
    rows.push(Row::told(what, now_ms() - start, "ms"));
    let packed: Vec<_> = kitchen.raw().map(PackedDepth::pack).collect();
    let mut preparer = kitchen.preparer(Backend::best())?;
    let (ms, _) = least(3, || {
        let mut grid = OccupancyGrid::new(OccupancyConfig::default())?;
        for ((_, pose), packed) in bent.iter().zip(packed.iter().cycle()) {
            grid.integrate(preparer.prepare_packed_for_occupancy(packed)?, pose)?;
        }
        Ok(grid)
    })?;
    rows.push(Row::at_most("occupancy at 5 cm of 1,000 key frames fused again", ms, "ms", 500.0));
    rows.extend(colours(kitchen)?);
    Ok(rows)
}

/// The same images into submaps without and with the gray images kept beside them, in turn.
fn colours(kitchen: &Kitchen) -> Result<Vec<Row>, DenseError> {
    let (mut insert, mut bytes) = ([Vec::new(), Vec::new()], [0, 0]);
    for _ in 0..3 {
        let config = |colour| {
            let submaps = SubmapConfig::default();
            SubmapConfig { tsdf: TsdfConfig { colour, ..submaps.tsdf }, ..submaps }
        };
        let new = |colour| DenseMap::new(config(colour), kitchen.camera, kitchen.metres_per_unit());
        let mut maps = [new(false)?, new(true)?];
        for (i, (image, (_, colours, pose))) in kitchen.raw().zip(&kitchen.fused).enumerate() {
            let gray = colours.data().iter().map(|c| c[0]).collect();
            let gray = GrayImage::from_vec(colours.width(), colours.height(), gray);
            for (map, ms) in maps.iter_mut().zip(&mut insert) {
                let start = now_ms();
                map.insert(AnchorId(i as u64), MapId(0), *pose, Se3::identity(), image, gray.as_ref())?;
                ms.push(now_ms() - start);
            }
        }
        bytes = [maps[0].bytes()[1], maps[1].bytes()[1]];
    }
    let [plain, coloured] = insert.map(median);
    let kept = |bytes| bytes as f64 / kitchen.fused.len() as f64 / 1e3;
    Ok(vec![
        Row::told("a key frame into submaps, median of 180, in turn with the next", plain, "ms"),
        Row::at_most("a key frame into submaps with colour", coloured, "ms", 2.0 * plain),
        Row::told("a key frame's depth and shades, packed", kept(bytes[1]), "kB"),
    ])
}

/// Rotates and moves by a share of the loop's error.
fn bend(share: f64) -> Se3 {
    Se3::new(So3::exp(&Vec3::new(0.0, 0.2 * share, 0.0)), Vec3::new(share, 0.0, -0.5 * share))
}

/// Lossless compression of the images of key frames.
fn codec(kitchen: &Kitchen) -> Result<Vec<Row>, DenseError> {
    let n = kitchen.fused.len() as f64;
    let (pack_ms, packed) = least(5, || Ok(kitchen.raw().map(PackedDepth::pack).collect::<Vec<_>>()))?;
    let (unpack_ms, same) = least(5, || {
        let mut same = 0;
        for (one, raw) in packed.iter().zip(kitchen.raw()) {
            same += usize::from(one.unpack()? == *raw);
        }
        Ok(same)
    })?;
    let bytes: usize = packed.iter().map(PackedDepth::bytes).sum();
    Ok(vec![
        Row::told("a key frame's depth, packed", bytes as f64 / n / 1e3, "kB"),
        Row::told("packing it", pack_ms / n, "ms"),
        Row::told("unpacking it, and comparing", unpack_ms / n, "ms"),
        Row::at_least("unpacked bit by bit the same", same as f64, "images", n),
    ])
}
