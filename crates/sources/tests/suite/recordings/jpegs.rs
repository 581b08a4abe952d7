//! Pictures that are JPEGs: gray, coloured, progressive, cut off and broken.

use super::common::{Folder, data, gray_png};
use super::play;
use cairn_sensor::{Camera, Rig};
use cairn_sources::{OpenOptions, open, write_rig};

#[test]
fn truncated_jpegs_are_skipped() {
    let Some(path) = data("euroc-mh01/mav0/cam0/data/1403636584763555584.jpg") else { return };
    let jpeg = std::fs::read(path).unwrap();
    let folder = Folder::new();
    let rig = Rig::mono(Camera::pinhole(752, 480, 458.0, 457.0, 367.0, 248.0));
    folder.write("rig.toml", write_rig(&rig).unwrap());
    let mut noise = jpeg.clone();
    for (i, byte) in noise.iter_mut().enumerate().skip(700) {
        *byte = (i * 7919 % 251) as u8;
    }
    folder.write("cam0/data/a.jpg", &jpeg);
    folder.write("cam0/data/b.jpg", &jpeg[..jpeg.len() * 2 / 3]);
    folder.write("cam0/data/c.jpg", &jpeg[..300]);
    folder.write("cam0/data/d.jpg", &noise);
    folder.write("cam0/data.csv", "100000000,a.jpg\n200000000,b.jpg\n300000000,c.jpg\n400000000,d.jpg\n");
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!((packets.len(), source.skipped().len()), (1, 3), "{:?}", source.skipped());
}

/// JPEGs of 16x8 pixels, made with a common encoder: two halves, in gray (0 and 200), in colour (Y 80 and
/// 68), and the latter progressive.
const GRAY_JPEG: &str = "ffd8ffe000104a46494600010100000100010000ffdb004300100b0c0e0c0a100e0d0e1211101318281a181616183123 \
     251d283a333d3c3933383740485c4e404457453738506d51575f626768673e4d71797064785c656763ffc0000b080008 \
     001001011100ffc40014000100000000000000000000000000000007ffc4001410010000000000000000000000000000 \
     0000ffda0008010100003f003f323fffd9";
const COLOUR_JPEG: &str = "ffd8ffe000104a46494600010100000100010000ffdb004300100b0c0e0c0a100e0d0e1211101318281a181616183123 \
     251d283a333d3c3933383740485c4e404457453738506d51575f626768673e4d71797064785c656763ffdb0043011112 \
     121815182f1a1a2f63423842636363636363636363636363636363636363636363636363636363636363636363636363 \
     6363636363636363636363636363ffc00011080008001003011100021101031101ffc400150001010000000000000000 \
     0000000000000305ffc40014100100000000000000000000000000000000ffc400150101010000000000000000000000 \
     0000000604ffc40014110100000000000000000000000000000000ffda000c03010002110311003f008e84a026c14fff \
     d9";
const PROGRESSIVE_JPEG: &str = "ffd8ffe000104a46494600010100000100010000ffdb004300100b0c0e0c0a100e0d0e1211101318281a181616183123 \
     251d283a333d3c3933383740485c4e404457453738506d51575f626768673e4d71797064785c656763ffdb0043011112 \
     121815182f1a1a2f63423842636363636363636363636363636363636363636363636363636363636363636363636363 \
     6363636363636363636363636363ffc20011080008001003011100021101031101ffc400150001010000000000000000 \
     0000000000000204ffc4001501010100000000000000000000000000000503ffda000c030100021003100000018e0a06 \
     c4ffc40014100100000000000000000000000000000010ffda00080101000105023fffc4001411010000000000000000 \
     0000000000000010ffda0008010301013f013fffc40014110100000000000000000000000000000010ffda0008010201 \
     013f013fffc40014100100000000000000000000000000000010ffda0008010100063f023fffc4001410010000000000 \
     0000000000000000000010ffda0008010100013f213fffda000c0301000200030000001007ffc4001411010000000000 \
     0000000000000000000010ffda0008010301013f103fffc40014110100000000000000000000000000000010ffda0008 \
     010201013f103fffc40014100100000000000000000000000000000010ffda0008010100013f103fffd9";

fn bytes(hex: &str) -> Vec<u8> {
    let digits: Vec<u8> = hex.bytes().filter(u8::is_ascii_hexdigit).collect();
    digits.chunks(2).map(|d| u8::from_str_radix(std::str::from_utf8(d).unwrap(), 16).unwrap()).collect()
}

fn jpeg_folder(files: &[Vec<u8>]) -> Folder {
    let folder = Folder::new();
    folder.write("rig.toml", write_rig(&Rig::mono(Camera::pinhole(16, 8, 9.0, 9.0, 8.0, 4.0))).unwrap());
    let mut csv = String::new();
    for (i, file) in files.iter().enumerate() {
        folder.write(&format!("cam0/data/{i}.jpg"), file);
        csv += &format!("{i}00000000,{i}.jpg\n");
    }
    folder.write("cam0/data.csv", csv);
    folder
}

#[test]
fn jpegs_become_luminance() {
    let folder = jpeg_folder(&[GRAY_JPEG, COLOUR_JPEG, PROGRESSIVE_JPEG].map(bytes));
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!((packets.len(), source.skipped()), (3, &[][..]));
    for (packet, [left, right]) in packets.iter().zip([[0, 200], [80, 68], [80, 68]]) {
        for y in 0..8 {
            assert!(
                packet.images[0].at(2, y).abs_diff(left) < 5
                    && packet.images[0].at(13, y).abs_diff(right) < 5
            );
        }
    }
}

/// One broken byte gives an image of the right size, or a counted skip.
#[test]
fn broken_bytes_give_at_most_a_skip() {
    for whole in [bytes(GRAY_JPEG), bytes(PROGRESSIVE_JPEG), gray_png(16, 8, 3)] {
        let mut files = vec![whole.clone()];
        for at in 0..whole.len() {
            for value in [0x00, 0xff, whole[at] ^ 0x10] {
                files.push(whole.clone());
                files.last_mut().unwrap()[at] = value;
            }
            files.push(whole[..at].to_vec());
        }
        let folder = jpeg_folder(&files);
        let (source, packets) = play(folder.name(), OpenOptions::default());
        assert_eq!(packets.len() + source.skipped().len(), files.len());
        assert!(source.skipped().len() >= whole.len() - 1, "every truncation is detected");
        assert!(packets.iter().all(|p| (p.images[0].width(), p.images[0].height()) == (16, 8)));
    }
}

#[test]
fn pictures_marked_as_turned_are_as_stored_or_as_the_calibration_has_them() {
    let plain = bytes(GRAY_JPEG);
    let marked = |orientation: u8, big: bool| {
        let tiff = match big {
            true => {
                [&b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0"[..], &[orientation], b"\0\0\0\0\0\0"]
                    .concat()
            }
            false => {
                [&b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0"[..], &[orientation], b"\0\0\0\0\0\0\0"]
                    .concat()
            }
        };
        let length = (tiff.len() + 8) as u16;
        [&plain[..2], &[0xff, 0xe1], &length.to_be_bytes(), b"Exif\0\0", &tiff, &plain[2..]].concat()
    };
    let read = |jpeg: Vec<u8>, size: [usize; 2]| {
        let folder = Folder::new();
        (0..2).for_each(|k| drop(folder.write(&format!("{k}.jpg"), &jpeg)));
        let rig = Rig::mono(Camera::pinhole(
            size[0],
            size[1],
            9.0,
            9.0,
            size[0] as f64 / 2.0,
            size[1] as f64 / 2.0,
        ));
        let (source, packets) = play(folder.name(), OpenOptions { rig: Some(rig), ..Default::default() });
        (source.skipped().join(" "), packets.first().map(|packet| packet.images[0].clone()))
    };
    // The left half is 0, the right one 200.
    for big in [true, false] {
        let (said, image) = read(marked(6, big), [16, 8]);
        assert!(said.contains("EXIF orientation 6") && said.contains("as they are stored"), "{said}");
        let image = image.unwrap();
        assert!(image.row(0)[0] < 20 && image.row(0)[15] > 180 && image.row(7)[15] > 180);
        for (orientation, above) in [(6, 0), (8, 200)] {
            let (said, image) = read(marked(orientation, big), [8, 16]);
            assert!(said.contains("as the calibration is of turned pictures"), "{said}");
            let image = image.unwrap();
            let at = |y: usize| (i32::from(image.row(y)[3]) - above).abs() < 20;
            assert!(at(0) && at(7) && !at(8) && !at(15), "{orientation}");
        }
    }
    assert_eq!(read(plain.clone(), [16, 8]).0, "");
    // Not marked, a picture of another size stays a picture of another size.
    let folder = Folder::new();
    (0..2).for_each(|k| drop(folder.write(&format!("{k}.jpg"), &plain)));
    let rig = Some(Rig::mono(Camera::pinhole(8, 16, 9.0, 9.0, 4.0, 8.0)));
    let error = open(folder.name(), OpenOptions { rig, ..Default::default() }).err().unwrap().to_string();
    assert!(error.contains("16x8 pixels, the rig says 8x16"), "{error}");
    // A directory that lies outside its data.
    let tiff = b"\xff\xe1\0\x10Exif\0\0MM\0*\0\0\xff\xff";
    assert_eq!(read([&plain[..2], tiff, &plain[2..]].concat(), [16, 8]).0, "");
}
