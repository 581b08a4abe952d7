//! Where the surface is off: its depth in twelve images of a 7-Scenes folder that were not fused, by depth, angle and edges, and how much
//! of it whole squares of the image have in common:
//! `cargo run --release -p cairn-dense --example held_out -- [VOXEL_M [BAND_VOXELS]]`.

use cairn_dense::{DepthConfig, DepthPreparer, TsdfConfig, TsdfVolume, raycast};
use std::error::Error;

#[path = "../tests/suite/common/mod.rs"]
mod common;

/// Greatest depth of a ray in metres, and of a measured depth that counts.
const FARTHEST_M: [f64; 2] = [6.0, 5.0];
/// Pixels along an edge of a square.
const SQUARE: usize = 40;
/// A square with fewer errors is left out.
const LEAST: usize = 50;
/// Pixels to an edge that counts as near.
const NEAR: usize = 4;

/// Errors in metres, the surface less what was measured, under a heading.
type Group = (String, Vec<f32>);

fn main() -> Result<(), Box<dyn Error>> {
    let number = |i, otherwise| std::env::args().nth(i).map_or(Ok(otherwise), |v| v.parse::<f64>());
    let (voxel_m, band_voxels) = (number(1, 0.02)?, number(2, 4.0)?);
    let Some(folder) = common::kitchen() else { return Ok(()) };
    let camera = common::camera();
    let mut preparer = DepthPreparer::new(DepthConfig::default(), camera, 0.001)?;
    let mut volume = TsdfVolume::new(TsdfConfig { voxel_m, band_voxels, ..TsdfConfig::default() })?;
    for number in (0..300).step_by(5) {
        let (depth, pose) = common::frame(&folder, number);
        volume.integrate(preparer.prepare(&depth)?, None, &pose)?;
    }
    let group = |name: String| -> Group { (name, Vec::new()) };
    let mut depths: Vec<Group> = (0..10).map(|i| group(format!("{:.1} m on", f64::from(i) * 0.5))).collect();
    let mut edges = [group("away from edges".into()), group(format!("within {NEAR} pixels of an edge"))];
    let mut angles: Vec<Group> =
        (0..5).map(|i| group(format!("cosine {:.1} on", f64::from(i) * 0.2))).collect();
    // The median of each square, and of single pixels what differs from it.
    let mut squares = [Vec::new(), Vec::new()];
    let (mut all, mut measured) = (group("all".into()), 0usize);
    for number in (12..300).step_by(25) {
        let (depth, pose) = common::frame(&folder, number);
        let cast = raycast(&volume, &camera, &pose, FARTHEST_M[0])?;
        let metres: Vec<f32> = depth.data().iter().map(|&raw| f32::from(raw) * 0.001).collect();
        let (width, height) = (camera.width, camera.height);
        let mut by_square = vec![Vec::new(); width.div_ceil(SQUARE) * height.div_ceil(SQUARE)];
        for (i, (&truth, &z)) in metres.iter().zip(cast.depth_m.data()).enumerate() {
            if truth <= 0.0 || f64::from(truth) > FARTHEST_M[1] {
                continue;
            }
            measured += 1;
            if z <= 0.0 {
                continue;
            }
            let (x, y, error) = (i % width, i / width, z - truth);
            all.1.push(error);
            depths[(truth * 2.0) as usize % 10].1.push(error);
            let rows = y.saturating_sub(NEAR)..(y + NEAR + 1).min(height);
            let columns = x.saturating_sub(NEAR)..(x + NEAR + 1).min(width);
            let mut around = rows.flat_map(|v| &metres[v * width..][columns.clone()]);
            let is_edge = around.any(|&o| o > 0.0 && (o - truth).abs() > (0.05 * truth).max(0.04));
            edges[usize::from(is_edge)].1.push(error);
            let (ray, normal) =
                ([x as f64 - camera.cx, y as f64 - camera.cy, camera.fx], cast.normals.data()[i]);
            let length = ray.iter().map(|v| v * v).sum::<f64>().sqrt();
            let cosine = -(0..3).map(|k| ray[k] * f64::from(normal[k])).sum::<f64>() / length;
            angles[(cosine.clamp(0.0, 0.999) * 5.0) as usize].1.push(error);
            by_square[y / SQUARE * width.div_ceil(SQUARE) + x / SQUARE].push(error);
        }
        for square in by_square.into_iter().filter(|s| s.len() >= LEAST) {
            let middle = median(square.clone());
            squares[0].push(middle.abs());
            squares[1].extend(square.iter().map(|e| (e - middle).abs()));
        }
    }
    let total = all.1.len();
    println!(
        "| voxels of {voxel_m} m, truncated at {:.3} m | share | bias | median error |\n|---|---|---|---|",
        volume.band_m()
    );
    for (name, errors) in
        std::iter::once(all).chain(depths).chain(angles).chain(edges).filter(|g| !g.1.is_empty())
    {
        let share = 100.0 * errors.len() as f64 / total.max(1) as f64;
        let absolute = errors.iter().map(|e| e.abs()).collect();
        let [bias, error] = [median(errors), median(absolute)].map(|v| v * 1e3);
        println!("| {name} | {share:.1} % | {bias:.1} mm | {error:.2} mm |");
    }
    let [common, rest] = squares.map(|errors| median(errors) * 1e3);
    println!(
        "\nmedians of squares of {SQUARE} pixels: {common:.2} mm off; single pixels {rest:.2} mm off that of their square"
    );
    println!("seen: {:.2} % of the measured pixels", 100.0 * total as f64 / measured.max(1) as f64);
    Ok(())
}

/// The median; NaN of nothing.
fn median(mut values: Vec<f32>) -> f32 {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f32::NAN)
}
