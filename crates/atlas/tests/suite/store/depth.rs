//! Depth attached to a map round-trips, in parts of their own, and damage costs only what it hits.

use crate::store::history::{Dice, file};
use cairn_atlas::KeyFrameName;
use cairn_atlas::store::{DEPTH_PREFIX, DepthPart, MapFile, Place, SavedDepth, inspect};
use cairn_sensor::{Camera, Distortion};
use std::collections::BTreeSet;

fn parts(dice: &mut Dice, images: &[usize], with_gray: bool) -> Vec<DepthPart> {
    let camera = Camera {
        distortion: Distortion::InverseRadialTangential([0.1, -0.2, 0.001, 0.002, 0.03]),
        ..Camera::pinhole(64, 48, 50.0, 51.0, 31.5, 23.5)
    };
    let mut place = || Place {
        key_frame: KeyFrameName { robot: dice.roll(3) as u16, seq: dice.roll(100) as u32 },
        key_frame_from_it: dice.pose(),
    };
    let mut part = |n: usize| DepthPart {
        camera,
        metres_per_unit: 0.001,
        submap: place(),
        images: (0..n)
            .map(|i| SavedDepth {
                place: place(),
                packed: vec![i as u8; 40 + i].into(),
                gray: vec![3; if with_gray { i % 3 } else { 0 }].into(),
            })
            .collect(),
    };
    images.iter().map(|&n| part(n)).collect()
}

#[test]
fn depth_round_trips_and_splits_into_parts() {
    for with_gray in [false, true] {
        round_trips(with_gray);
    }
}

fn round_trips(with_gray: bool) {
    let mut saved = file(3, 8, 6);
    assert_eq!((saved.depth().unwrap(), saved.depth_bytes()), (vec![], 0));
    let before = saved.clone();
    let mut depth = parts(&mut Dice::new(7), &[3, 1, 70], with_gray);
    saved.add_depth(&depth);
    let names: Vec<&String> = saved.attached.keys().filter(|n| n.starts_with(DEPTH_PREFIX)).collect();
    assert_eq!(names.len(), 5, "70 images in three parts: {names:?}");
    let mut reloaded = MapFile::read(&saved.write().unwrap()).unwrap();
    assert_eq!(reloaded.attached, saved.attached);
    let mut read = reloaded.take_depth().unwrap();
    assert_eq!(reloaded.attached, before.attached, "nothing else was touched");
    let rest = read.split_off(3);
    read[2].images.extend(rest.into_iter().flat_map(|part| part.images));
    assert_eq!(read, depth);
    // What is added to a map that has some keeps it.
    depth.truncate(1);
    saved.add_depth(&depth);
    assert_eq!(saved.depth().unwrap().len(), 6);
}

#[test]
fn damage_costs_the_part_it_hits() {
    let mut saved = file(3, 4, 6);
    saved.attached.clear();
    saved.add_depth(&parts(&mut Dice::new(9), &[2, 2, 2], true));
    let whole = saved.write().unwrap();
    let mut lost = BTreeSet::new();
    for cut in 1..90 {
        let bytes = &whole[..whole.len() - cut * 7];
        assert!(MapFile::read(bytes).is_err());
        let Ok((mended, notes)) = MapFile::salvage(bytes) else { continue };
        let left = mended.depth().unwrap().len();
        lost.insert(3 - left);
        assert!(notes.iter().any(|n| n.contains("attached/depth/00002")), "{notes:?}");
        assert_eq!(
            inspect(bytes).unwrap().iter().filter(|(_, wrong)| wrong.is_some()).count(),
            notes.len() - 1
        );
        assert_eq!(mended.snapshot.key_frame_count(), saved.snapshot.key_frame_count());
    }
    assert!(lost.contains(&1) && lost.contains(&2) && !lost.contains(&0), "{lost:?}");
}

#[test]
fn every_altered_byte_of_a_part_is_an_error_or_other_numbers() {
    let mut saved = file(3, 4, 6);
    saved.add_depth(&parts(&mut Dice::new(11), &[2], false));
    let name = format!("{DEPTH_PREFIX}00000");
    let whole = saved.attached[&name].clone();
    let mut refused = 0;
    for at in 0..whole.len() {
        for flip in [0x01, 0x80, 0xff] {
            let part = saved.attached.get_mut(&name).unwrap();
            part.clone_from(&whole);
            part[at] ^= flip;
            if let Err(e) = saved.depth() {
                assert!(e.to_string().contains("part 'attached/depth/00000'"), "{e}");
                refused += 1;
            }
        }
    }
    assert!(refused > 100, "{refused}");
    for cut in 0..whole.len() {
        saved.attached.insert(name.clone(), whole[..cut].to_vec());
        assert!(saved.depth().is_err(), "cut at {cut}");
    }
    saved.attached.get_mut(&name).unwrap().clear();
    assert!(saved.take_depth().is_err() && saved.attached.contains_key(&name));
}

#[test]
fn older_layouts_are_read_and_newer_ones_refused() {
    let mut saved = file(3, 4, 6);
    let depth = parts(&mut Dice::new(13), &[2], false);
    saved.add_depth(&depth);
    let name = format!("{DEPTH_PREFIX}00000");
    for (layout, read) in [(0, false), (1, true), (2, true), (4, false)] {
        saved.attached.get_mut(&name).unwrap()[0] = layout;
        match saved.depth() {
            Ok(found) => assert!(read && found == depth, "layout {layout}"),
            Err(e) => assert!(!read && e.to_string().contains(&format!("layout {layout}")), "{e}"),
        }
    }
}
