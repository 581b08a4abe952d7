//! Images through the bytes of a slot are the same; bytes that are none are refused.
#![cfg(unix)]

use cairn_random::Random;
use cairn_sensor::{DepthImage, FramePacket, GrayImage, Stamp};
use cairn_workers::pixels;
use std::sync::Arc;

fn packet(random: &mut Random, images: usize, with_depth: bool) -> FramePacket {
    let mut image = || {
        let (w, h) = (1 + random.below(40), 1 + random.below(30));
        let data = (0..w * h).map(|_| random.below(256) as u8).collect();
        Arc::new(GrayImage::from_vec(w, h, data).unwrap())
    };
    let images = (0..images).map(|_| image()).collect();
    let depth = (0..20 * 10).map(|_| random.below(65536) as u16).collect();
    let depth = with_depth.then(|| Arc::new(DepthImage::from_vec(20, 10, depth).unwrap()));
    FramePacket { stamp: Stamp(5), images, depth, imu: Vec::new(), decode_ms: 0.0 }
}

#[test]
fn images_round_trip_and_cut_bytes_are_refused() {
    let mut random = Random::new(1);
    for (images, with_depth) in [(1, false), (2, false), (1, true), (0, true), (0, false)] {
        let packet = packet(&mut random, images, with_depth);
        let bytes = pixels::pieces(&packet, |pieces| pieces.concat());
        let (read, depth) = pixels::read(&bytes).unwrap();
        assert_eq!((read, depth), (packet.images.clone(), packet.depth.clone()));
        assert!((0..bytes.len()).all(|cut| pixels::read(&bytes[..cut]).is_none()));
    }
}

#[test]
fn any_bytes_are_images_or_refused() {
    let mut random = Random::new(2);
    let packet = packet(&mut random, 2, true);
    let whole = pixels::pieces(&packet, |pieces| pieces.concat());
    for _ in 0..20_000 {
        let mut bytes = whole.clone();
        let at = random.below(32);
        bytes[at] = random.below(256) as u8;
        let _ = pixels::read(&bytes);
    }
}
