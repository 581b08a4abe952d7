//! Prints how well a recorded motion and its readings agree, and writes one image of the room built around it.
//!
//! `cargo run --release -p cairn-sim --example recorded_motion -- GT.tum IMU.csv [OUT.png [SECONDS]]`

use cairn_sensor::Source;
use cairn_sim::SimSource;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [poses, readings, rest @ ..] = arguments.as_slice() else {
        return Err("give a file of poses and one of readings".into());
    };
    let seconds = rest.get(1).map_or("10", String::as_str);
    let mount = rest.get(2).map_or(String::new(), |m| format!("&mount={m}"));
    let address = format!("sim:arena?trajectory={poses}&imu={readings}&start={seconds}&duration=1{mount}");
    let mut source = SimSource::open(&address)?;
    println!("{:#?}", source.agreement());
    println!("{:?} {} faces", source.info().truth.first(), source.world().face_count());
    let Some(packet) = source.next_packet()? else { return Ok(()) };
    if let Some(path) = rest.first() {
        let image = &packet.images[0];
        let file = std::fs::File::create(path)?;
        let mut encoder = png::Encoder::new(file, image.width() as u32, image.height() as u32);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.write_header()?.write_image_data(image.data())?;
    }
    Ok(())
}
