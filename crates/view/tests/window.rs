//! The program in a display: maps in, pictures out.

use cairn_view::{Palette, begin, walker, write_message};
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// A picture: its width, and its pixels.
struct Picture(usize, Vec<[u8; 3]>);

impl Picture {
    /// How many pixels have this colour, but for `off` in each part.
    fn count(&self, [r, g, b]: [f32; 3], off: u8) -> usize {
        let colour = [r, g, b].map(|v| (255.0 * v).round() as u8);
        self.1.iter().filter(|p| (0..3).all(|i| p[i].abs_diff(colour[i]) <= off)).count()
    }

    /// The mean column of the pixels of this colour, as a share of the width.
    fn column(&self, [r, g, b]: [f32; 3]) -> f64 {
        let colour = [r, g, b].map(|v| (255.0 * v).round() as u8);
        let found = (0..self.1.len()).filter(|&k| self.1[k] == colour).map(|k| (k % self.0) as f64);
        let columns: Vec<f64> = found.collect();
        columns.iter().sum::<f64>() / columns.len() as f64 / self.0 as f64
    }
}

fn shown(name: &str, messages: &[Vec<u8>]) -> Picture {
    let folder = std::env::var_os("CAIRN_VIEW_PICTURES").map_or_else(std::env::temp_dir, PathBuf::from);
    let path = folder.join(format!("{name}.png"));
    let _ = std::fs::remove_file(&path);
    let mut window = Command::new(env!("CARGO_BIN_EXE_cairn-view"));
    let mut window = window.arg("--picture").arg(&path).stdin(Stdio::piped()).spawn().expect("the program");
    let mut to = window.stdin.take().expect("a pipe");
    messages.iter().for_each(|message| write_message(&mut to, message).expect("it listens"));
    drop(to);
    assert!(window.wait().expect("it ends").success());
    let file = std::io::BufReader::new(std::fs::File::open(&path).expect("a picture"));
    let mut reader = png::Decoder::new(file).read_info().expect("PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut bytes).expect("pixels");
    println!("{}: {} x {}", path.display(), info.width, info.height);
    Picture(info.width as usize, bytes.as_chunks().0.to_vec())
}

fn put(out: &mut Vec<u8>, numbers: &[u32]) {
    out.extend(numbers.iter().flat_map(|v| v.to_le_bytes()));
}

/// A map with up along z: key frames along y, and a route at x = -2.
fn map() -> Vec<u8> {
    let mut out = vec![2, 1, 0, 0];
    [0.01_f32, 0.0, 0.0, 1.0].iter().for_each(|v| out.extend(v.to_le_bytes()));
    let place = |out: &mut Vec<u8>, p: [i16; 3]| p.iter().for_each(|v| out.extend(v.to_le_bytes()));
    put(&mut out, &[0, 0, 0, 5]);
    for k in 0..5_i16 {
        put(&mut out, &[k as u32]);
        place(&mut out, [0, 100 * k, 150]);
        put(&mut out, &[0]);
    }
    put(&mut out, &[0, 0, 2]);
    place(&mut out, [-200, 0, 0]);
    place(&mut out, [-200, 400, 0]);
    put(&mut out, &[0, 0]);
    out
}

/// A square of 4 m at a height, in a block of voxels of half a metre, seen from above or from below.
fn square(height: u16, from_above: bool) -> Vec<u8> {
    let mut out = vec![3, 1, 0, 0];
    out.extend(0.5_f32.to_le_bytes());
    put(&mut out, &[0, 1, 0]);
    let pose = [1.0, 0.0, 0.0, -2.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0_f32];
    pose.iter().for_each(|v| out.extend(v.to_le_bytes()));
    put(&mut out, &[1, 0, 0, 0, 0, 0]);
    out.extend([4, 0, 2, 0]);
    for [x, y] in [[0, 0], [8, 0], [8, 8], [0, 8]] {
        [x * 4095, y * 4095, height].iter().for_each(|v: &u16| out.extend(v.to_le_bytes()));
    }
    out.extend(if from_above { [0, 1, 2, 0, 2, 3] } else { [0, 2, 1, 0, 3, 2] });
    out
}

#[test]
#[ignore = "needs a display: see tools/test_view"]
fn what_is_told_is_in_the_picture() {
    let colours = Palette::DARK;
    let first = || [begin("a test", true), map()];
    let empty = shown("empty", &[begin("nothing", true)]);
    let points = shown("map", &first());
    assert!(empty.count(colours.canvas, 0) > 300_000, "the ground");
    assert_eq!(empty.count(colours.way, 0), 0, "there is no map");
    assert!(points.count(colours.way, 2) > 100, "the way of the camera");
    assert!(points.count(colours.route, 2) > 300, "the route");
    // At first one looks along x, turned to the right: what is farther to the left along y is farther to the left on the screen, and so is
    // what is farther away along x.
    assert!(points.column(colours.route) > points.column(colours.way), "the map is drawn as in a mirror");
    let with_walker = walker(Some([[0.0, 2.0, 1.5], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]));
    let walked = shown("walker", &[first().as_slice(), &[with_walker]].concat());
    assert!(walked.count(colours.eye, 2) > points.count(colours.eye, 2) + 50, "the walker");
    // A floor is seen from above, and through a ceiling one looks into the room.
    let [floor, ceiling] = [true, false].map(|from_above| {
        let name = if from_above { "floor" } else { "ceiling" };
        shown(name, &[first().as_slice(), &[square(100, from_above)]].concat())
    });
    let changed = |a: &Picture, b: &Picture| a.1.iter().zip(&b.1).filter(|(p, q)| p != q).count();
    println!("{} {} pixels differ", changed(&floor, &ceiling), changed(&floor, &points));
    assert!(changed(&floor, &ceiling) > 20_000, "the floor is not drawn, or the ceiling too");
    assert!(ceiling.count(colours.canvas, 0) > floor.count(colours.canvas, 0) + 15_000);
}
