//! Fuses a 7-Scenes folder with its own poses, writes a mesh and a picture of it:
//! `cargo run --release -p cairn-dense --example kitchen -- OUT_FOLDER [VOXEL_M]`.

use cairn_dense::{
    DepthConfig, DepthPreparer, MeshConfig, Mesher, TsdfConfig, TsdfVolume, raycast, write_glb, write_ply,
};
use cairn_geometry::{Se3, So3, Vec3};
use std::error::Error;
use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;

#[path = "../tests/suite/common/mod.rs"]
mod common;

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(std::env::args().nth(1).ok_or("name a folder for the mesh and the picture")?);
    let voxel_m = std::env::args().nth(2).map_or(Ok(0.02), |v| v.parse())?;
    let Some(folder) = common::kitchen() else { return Ok(()) };
    let mut preparer = DepthPreparer::new(DepthConfig::default(), common::camera(), 0.001)?;
    let mut volume = TsdfVolume::new(TsdfConfig { voxel_m, colour: true, ..TsdfConfig::default() })?;
    for number in (0..300).step_by(5) {
        let (depth, pose) = common::frame(&folder, number);
        volume.integrate(preparer.prepare(&depth)?, Some(&common::colour(&folder, number)), &pose)?;
    }
    let mesh = Mesher::new(MeshConfig::default()).whole(&volume);
    write_ply(&mesh, &mut BufWriter::new(File::create(out.join("kitchen.ply"))?))?;
    write_glb(&mesh, [0.0, -1.0, 0.0], &mut BufWriter::new(File::create(out.join("kitchen.glb"))?))?;
    println!(
        "{} vertices, {} triangles in kitchen.ply and kitchen.glb",
        mesh.positions.len(),
        mesh.triangles.len()
    );
    // From one step behind and above the start of the recording.
    let (_, start) = common::frame(&folder, 100);
    let back = Se3::new(So3::exp(&Vec3::new(-0.25, 0.0, 0.0)), Vec3::new(0.0, -0.5, -0.8));
    let cast = raycast(&volume, &common::camera(), &(start * back), 8.0)?;
    let shade = |n: &[f32; 3]| n.map(|v| (127.5 - 127.5 * v) as u8);
    let rgb: Vec<u8> =
        cast.normals.data().iter().flat_map(|n| if *n == [0.0; 3] { [0; 3] } else { shade(n) }).collect();
    let mut encoder = png::Encoder::new(BufWriter::new(File::create(out.join("kitchen.png"))?), 640, 480);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(&rgb)?;
    println!("normals in kitchen.png");
    Ok(())
}
